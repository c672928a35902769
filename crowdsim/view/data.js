// Where recordings come from, and how they are unpacked: the other side of blocks.py.

const element = id => document.getElementById(id);

async function inflate(bytes) {
  const { readable, writable } = new DecompressionStream('deflate'), writer = writable.getWriter();
  // What is wrong with them is what reading says. A blob's stream would come by way of another process.
  for (const done of [writer.write(bytes), writer.close()]) done.catch(() => {});
  return new Uint8Array(await new Response(readable).arrayBuffer());
}

function fromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text), bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

const rest = milliseconds => new Promise(resolve => setTimeout(resolve, milliseconds));

// A recording in the page itself: its blocks are elements that come while the page is read.
function embeddedSource(scene) {
  async function block(number) {
    for (;;) {
      const found = element(`block-${number}`), whole = document.readyState !== 'loading';
      if (found && (whole || found.nextSibling)) return fromBase64(found.textContent);
      if (whole) throw Error('The page is incomplete: part of its recording is missing.');
      await rest(4);
    }
  }
  return { scene: async () => fromBase64(scene), block };
}

// A recording that a server poses while it is seen.
function servedSource() {
  async function get(path) {
    let answer;
    try {
      answer = await fetch(path, { cache: 'no-store' });
    } catch {
      throw Error('The connection is lost: crowdsim does not run any more.');
    }
    if (!answer.ok) throw Error(`crowdsim: ${await answer.text()}`);
    return new Uint8Array(await answer.arrayBuffer());
  }
  return {
    scene: () => get('scene'), block: number => get(`block/${number}`),
    camera: number => get(`camera/${number}`).then(inflate).then(bytes => new Float32Array(bytes.buffer)),
  };
}

function unpackTables(bytes) {
  const length = new DataView(bytes.buffer).getUint32(0, true), base = 4 + length;
  const scene = JSON.parse(new TextDecoder().decode(bytes.subarray(4, base)));
  const kinds = { f4: Float32Array, i4: Int32Array, u1: Uint8Array };
  for (const [name, [kind, count, at]] of Object.entries(scene.tables))
    scene.tables[name] = new kinds[kind](bytes.buffer, base + at, count);
  return scene;
}

// One track: second differences with the sign in the lowest bit, in planes of bytes that lie `plane` bytes apart.
function unpackTrack(bytes, at, plane, planes, frames, out, first, stride, factor) {
  let value = 0, step = 0;
  for (let t = 0; t < frames; t++, at++, first += stride) {
    let coded = bytes[at] | bytes[at + plane] << 8;
    if (planes === 4) coded |= bytes[at + 2 * plane] << 16 | bytes[at + 3 * plane] << 24;
    step += (coded >>> 1) ^ -(coded & 1);
    value += step;
    out[first] = value * factor;
  }
}

// Returns what each figure does in a block: rotations (frames, avatars, joints, 4), unnormalised, and places (frames,
// avatars, moving joints, 3). Pauses now and then, so that the picture goes on meanwhile.
async function unpackBlock(bytes, scene, frames, urgent) {
  const parts = [];
  let at = 0, since = performance.now();
  for (const figure of scene.figures) {
    const joints = figure.avatars.length * figure.joints.length, stride = 4 * joints;
    const leftOut = bytes.subarray(at, at + joints);
    at += joints;
    let tracks = 0;
    for (const one of leftOut) tracks += one < 4 ? 3 : 4;
    const plane = tracks * frames, rotations = new Int16Array(frames * stride);
    for (let j = 0; j < joints; j++) {
      const first = 4 * j, without = leftOut[j];
      for (let k = 0; k < 4; k++) {
        if (k === without) continue;
        unpackTrack(bytes, at, plane, 2, frames, rotations, first + k, stride, 1);
        at += frames;
      }
      if (without < 4) {
        const whole = (1 << figure.bits[j % figure.joints.length] - 1) - 1;
        for (let t = 0, o = first; t < frames; t++, o += stride) {
          let left = whole * whole;
          for (let k = 0; k < 4; k++) if (k !== without) left -= rotations[o + k] * rotations[o + k];
          rotations[o + without] = Math.sqrt(Math.max(left, 0)) + 0.5;
        }
      }
      if (!urgent && performance.now() - since > 5) {
        await rest(0);
        since = performance.now();
      }
    }
    at += plane;
    const moves = 3 * figure.avatars.length * figure.moving.length, places = new Float32Array(frames * moves);
    for (let i = 0; i < moves; i++)
      unpackTrack(bytes, at + i * frames, moves * frames, 4, frames, places, i, moves, scene.step);
    at += 4 * moves * frames;
    parts.push({ rotations, places, rotationStride: stride, placeStride: moves });
  }
  return parts;
}

// A recording, of which some blocks are unpacked: those around the time that is seen.
class Recording {
  constructor(source, scene) {
    this.source = source;
    this.scene = scene;
    this.blocks = new Map();
    this.count = Math.ceil(scene.frames / scene.block);
    let size = 0;
    for (const figure of scene.figures)
      size += scene.block * figure.avatars.length * (8 * figure.joints.length + 12 * figure.moving.length);
    this.most = Math.max(8, Math.floor(400e6 / size));
  }

  // Begins to unpack a block where that has not begun; others that were not used for the longest time go.
  load(number, urgent) {
    if (number < 0 || number >= this.count) return null;
    let entry = this.blocks.get(number);
    if (!entry) {
      const frames = Math.min(this.scene.block, this.scene.frames - number * this.scene.block);
      entry = { parts: null };
      entry.promise = this.source.block(number).then(inflate)
        .then(bytes => unpackBlock(bytes, this.scene, frames, urgent)).then(parts => { entry.parts = parts; });
      // One that fails is not asked for again at once.
      entry.promise.catch(() => setTimeout(() => this.blocks.delete(number), 2000));
    }
    this.blocks.delete(number);
    this.blocks.set(number, entry);
    for (const old of [...this.blocks.keys()].slice(0, Math.max(0, this.blocks.size - this.most)))
      if (this.blocks.get(old).parts) this.blocks.delete(old);
    return entry;
  }

  // Returns the block and the row of a frame, or null while that block is being unpacked.
  row(frame) {
    this.load(Math.floor(frame / this.scene.block), true);
    return this.known(frame);
  }

  // The same of a frame whose block is unpacked already; null of others.
  known(frame) {
    const number = Math.floor(frame / this.scene.block), entry = this.blocks.get(number);
    return entry && entry.parts ? { parts: entry.parts, row: frame - number * this.scene.block } : null;
  }
}

async function openRecording() {
  const origin = JSON.parse(element('source').textContent);
  const source = origin.scene ? embeddedSource(origin.scene) : servedSource();
  const scene = unpackTables(await inflate(await source.scene()));
  if (scene.format !== 'crowdsim-recording' || scene.version !== 1)
    throw Error('This is no recording that this player reads.');
  scene.figures.forEach(figure => { figure.avatars = []; });
  scene.tables.figure.forEach((figure, avatar) => scene.figures[figure].avatars.push(avatar));
  const recording = scene.live ? new LiveRecording(scene) : new Recording(source, scene);
  const first = recording.load(0, true);
  // A server poses the first block while the picture is being prepared; a page unpacks it while the browser starts graphics.
  if (origin.scene) await first.promise;
  recording.why = origin.why;
  return recording;
}

// Of a table of changes with CSR offsets, the row that holds at a number for an item; -1 before the first one.
function rowAt(offsets, numbers, item, number) {
  let low = offsets[item], high = offsets[item + 1];
  const first = low;
  while (low < high) {
    const middle = low + high >> 1;
    if (numbers[middle] <= number) low = middle + 1;
    else high = middle;
  }
  return low - 1 >= first ? low - 1 : -1;
}

// The place of the first of ascending numbers that is greater than one.
function placeAfter(numbers, number) {
  let low = 0, high = numbers.length;
  while (low < high) {
    const middle = low + high >> 1;
    if (numbers[middle] <= number) low = middle + 1;
    else high = middle;
  }
  return low;
}
