// Bodies: forward kinematics between two recorded frames, and the capsules on the joints.

const FLOATS = 12; // of a capsule: an end and its radius, the other end and its radius, linear colour and gloss
const SKIN_PIXELS = [190, 110, 32]; // how tall avatars are in the picture [px] that have the whole skin, a coarser one, and the coarsest
const STAYS = 0.88, MOST_SKINS = 128; // share of that down to which an avatar keeps what it has, and how many have skins
const SKIN_PARTS = 16; // of `parts.SKIN_PARTS`
const CLOUD_POINTS = 2500, MOST_POINTS = 60000; // points a square metre of a capsule, about, and in all
const MARKER_RADIUS = 0.13, MARKER_PAINT = [0.85, 0.5, 0.03, 0.3];

function rotate(out, o, q, i, x, y, z) {
  const w = q[i], a = q[i + 1], b = q[i + 2], c = q[i + 3];
  const u = 2 * (b * z - c * y), v = 2 * (c * x - a * z), t = 2 * (a * y - b * x);
  out[o] = x + w * u + b * t - c * v;
  out[o + 1] = y + w * v + c * u - a * t;
  out[o + 2] = z + w * t + a * v - b * u;
}

function multiply4([w, x, y, z], [a, b, c, d]) {
  return [w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c, w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a];
}

// Colours of labels: hues far from one another, of three lightnesses.
function labelColour(label) {
  const hue = label * 0.618034 % 1, light = [0.85, 0.5, 0.25][label % 3];
  return [0, 1, 2].map(i => light * (0.35 + 0.65 * clamp(Math.abs(((hue + i / 3) % 1) * 6 - 3) - 1, 0, 1)));
}

function edgeShapes(edges, paint) {
  const shapes = [];
  for (let i = 0; i < edges.length; i += 7) {
    const [x, y, z, u, v, w, r] = edges.slice(i, i + 7);
    shapes.push(x, y, z, r, u, v, w, r, ...paint);
  }
  return new Float32Array(shapes);
}

class Crowd {
  constructor(recording) {
    this.recording = recording;
    const scene = this.scene = recording.scene, tables = scene.tables;
    this.count = tables.figure.length;
    let most = 0;
    this.columns = new Int32Array(this.count);
    for (const figure of scene.figures) {
      figure.avatars.forEach((avatar, column) => { this.columns[avatar] = column; });
      const { starts, ends } = figure.capsules, n = figure.capsules.joints.length;
      for (let k = 0; k < n; k++) {
        // A capsule of no length has no axis.
        if ([0, 1, 2].every(i => Math.abs(starts[3 * k + i] - ends[3 * k + i]) < 1e-4)) ends[3 * k + 1] += 5e-4;
      }
      most = Math.max(most, figure.joints.length);
      this.capsules = (this.capsules || 0) + Math.max(n, 2 * figure.joints.length) * figure.avatars.length;
    }
    this.capsules += scene.targets.length;
    // What avatars carry, by their types.
    this.props = [];
    for (const { type, colour, ...prop } of scene.props ?? []) (this.props[type] ??= []).push({ ...prop, paint: [...colour.map(value => value ** 2), 0.2] });
    tables.type?.forEach(type => { this.capsules += this.props[type]?.length ?? 0; });
    this.faces = [];
    for (const { type, colour, ...mesh } of scene.faces ?? []) (this.faces[type] ??= []).push({ ...mesh, paint: [...colour.map(value => value ** 2), 0.2] });
    this.meshes = []; // that skinned avatars carry: mesh, position and rotation of its joint, size
    this.look = 'bodies'; // or skeletons, or cloud
    this.skinned = [];
    this.details = new Uint8Array(this.count).fill(SKIN_PIXELS.length); // which skin each avatar has; the last number is none
    this.grown = new Map(); // bindings of avatars to bones
    this.boneRow = 4 * SKIN_PARTS + 12 * (most + 4);
    this.bones = new Float32Array(MOST_SKINS * this.boneRow);
    this.cloud = new Float32Array(6 * MOST_POINTS);
    this.points = this.visible = 0;
    // Frames of obstacles: of each edge both ends and the radius.
    this.obstacles = (scene.obstacles ?? []).map(({ edges, ...others }) => ({ ...others, shapes: edgeShapes(edges, others.paint) }));
    for (const { shapes } of this.obstacles) this.capsules += shapes.length / FLOATS;
    this.positions = new Float64Array(3 * most);
    this.rotations = new Float64Array(4 * (most + 4)); // and those of helpers, at elbows and knees
    this.shapes = new Float32Array(FLOATS * Math.max(this.capsules, 1));
    this.owners = new Int32Array(Math.max(this.capsules, 1));
    this.drawn = 0;
    // Of each avatar that is there: root, head and where it looks; NaN of others.
    this.roots = new Float32Array(3 * this.count).fill(NaN);
    this.heads = new Float32Array(3 * this.count).fill(NaN);
    this.facing = new Float32Array(3 * this.count);
    // Feet of figures whose contacts are known.
    this.feet = tables.contact ? [] : null;
    this.paints = new Float32Array(tables.paint.length);
    this.colours = tables.paint.length / (4 * this.count); // of an avatar
    // Bytes are the square roots of light; gloss is as it is.
    tables.paint.forEach((value, i) => { this.paints[i] = i % 4 === 3 ? value / 255 : (value / 255) ** 2; });
    this.stays = Array.from({ length: this.count }, () => []);
    for (let i = 0; i < tables.present.length; i += 3)
      this.stays[tables.present[i]].push([tables.present[i + 1], tables.present[i + 2]]);
  }

  isPresent(avatar, frame) {
    return this.stays[avatar].some(([start, stop]) => frame >= start && frame < stop);
  }

  // Finds both frames around a time [frames]; null while a block is being unpacked.
  around(at) {
    const last = this.scene.frames - 1, before = Math.min(Math.max(Math.floor(at), 0), last);
    const low = this.recording.row(before), high = this.recording.row(Math.min(before + 1, last));
    return low && high ? { low, high, before, part: Math.min(Math.max(at - before, 0), 1) } : null;
  }

  // Writes world positions and rotations of an avatar's joints; whether it is there.
  pose(avatar, moment) {
    if (!this.isPresent(avatar, moment.before)) return false;
    const stays = this.isPresent(avatar, moment.before + 1), part = stays ? moment.part : 0;
    const index = this.scene.tables.figure[avatar], figure = this.scene.figures[index], column = this.columns[avatar];
    const J = figure.joints.length, M = figure.moving.length;
    const low = moment.low.parts[index], high = moment.high.parts[index];
    const p = low.rotations, q = high.rotations, u = low.places, v = high.places;
    let a = moment.low.row * low.rotationStride + 4 * column * J;
    let b = moment.high.row * high.rotationStride + 4 * column * J;
    const c = moment.low.row * low.placeStride + 3 * column * M, d = moment.high.row * high.placeStride + 3 * column * M;
    const { scale, stretch } = this.scene.tables, P = this.positions, R = this.rotations, rest = 1 - part;
    for (let j = 0, m = 0; j < J; j++, a += 4, b += 4) {
      const dot = p[a] * q[b] + p[a + 1] * q[b + 1] + p[a + 2] * q[b + 2] + p[a + 3] * q[b + 3];
      const other = dot < 0 ? -part : part;
      let w = p[a] * rest + q[b] * other, x = p[a + 1] * rest + q[b + 1] * other;
      let y = p[a + 2] * rest + q[b + 2] * other, z = p[a + 3] * rest + q[b + 3] * other;
      const over = 1 / (Math.sqrt(w * w + x * x + y * y + z * z) || 1);
      w *= over; x *= over; y *= over; z *= over;
      let ox, oy, oz;
      const parent = figure.parents[j];
      if (figure.moving[m] === j) {
        ox = u[c + 3 * m] * rest + v[d + 3 * m] * part;
        oy = u[c + 3 * m + 1] * rest + v[d + 3 * m + 1] * part;
        oz = u[c + 3 * m + 2] * rest + v[d + 3 * m + 2] * part;
        m++;
      } else {
        const size = scale[avatar] * stretch[3 * avatar + figure.segments[parent]];
        ox = figure.offsets[3 * j] * size;
        oy = figure.offsets[3 * j + 1] * size;
        oz = figure.offsets[3 * j + 2] * size;
      }
      const i = 4 * j, o = 3 * j;
      if (parent < 0) {
        P[o] = ox; P[o + 1] = oy; P[o + 2] = oz;
        R[i] = w; R[i + 1] = x; R[i + 2] = y; R[i + 3] = z;
        continue;
      }
      const k = 4 * parent, W = R[k], X = R[k + 1], Y = R[k + 2], Z = R[k + 3];
      rotate(P, o, R, k, ox, oy, oz);
      P[o] += P[3 * parent]; P[o + 1] += P[3 * parent + 1]; P[o + 2] += P[3 * parent + 2];
      R[i] = W * w - X * x - Y * y - Z * z;
      R[i + 1] = W * x + X * w + Y * z - Z * y;
      R[i + 2] = W * y - X * z + Y * w + Z * x;
      R[i + 3] = W * z + X * y - Y * x + Z * w;
    }
    return true;
  }

  // Poses all avatars that a view shows, or whose shadows it does, with fewer capsules the smaller they are.
  // `near` is how far out of the picture they may be [m], `detail` how many pixels are drawn for one of the view.
  place(moment, view, selected, near, detail) {
    const { shapes, owners, heads, roots } = this, { figure: figures, height } = this.scene.tables, seen = [];
    for (let avatar = 0; avatar < this.count; avatar++) {
      roots[3 * avatar] = heads[3 * avatar] = NaN;
      if (!this.isPresent(avatar, moment.before)) continue;
      const figure = this.scene.figures[figures[avatar]], index = figures[avatar];
      // The root alone says whether an avatar is in sight.
      const part = moment.low.parts[index], place = moment.low.row * part.placeStride
        + 3 * this.columns[avatar] * figure.moving.length;
      const x = part.places[place], y = part.places[place + 1], z = part.places[place + 2];
      roots[3 * avatar] = x; roots[3 * avatar + 1] = y; roots[3 * avatar + 2] = z;
      const pixels = view.pixels(x, y, z, 1.2 * height[avatar] + near);
      if (pixels > 0 || avatar === selected) seen.push([avatar, pixels * height[avatar] * detail]);
    }
    this.skinned = [];
    this.meshes = [];
    if (this.look === 'bodies' && this.scene.tables.bone_skin) {
      const large = [];
      for (const one of seen) {
        if (one[1] > STAYS * SKIN_PIXELS.at(-1)) large.push(one);
        else this.details[one[0]] = SKIN_PIXELS.length;
      }
      large.sort((a, b) => b[1] - a[1]).forEach(([avatar, size], rank) => {
        const had = this.details[avatar], found = SKIN_PIXELS.findIndex((pixels, i) => size > pixels * (had <= i ? STAYS : 1));
        this.details[avatar] = found < 0 || rank >= MOST_SKINS ? SKIN_PIXELS.length : found;
      });
      const key = avatar => (figures[avatar] * 256 + this.scene.tables.bone_skin[avatar]) * 4 + this.details[avatar];
      this.skinned = large.map(([avatar]) => avatar).filter(avatar => this.details[avatar] < SKIN_PIXELS.length).sort((a, b) => key(a) - key(b));
    }
    const behind = new Set(this.skinned);
    let at = 0;
    this.points = 0;
    for (const [avatar, size] of seen) if (!behind.has(avatar)) at = this.placeAvatar(avatar, size, moment, at);
    for (const [x, y, z] of this.targets(moment)) {
      shapes.set([x, y, z, MARKER_RADIUS, x, y + 5e-4, z, MARKER_RADIUS, ...MARKER_PAINT], FLOATS * at);
      owners[at++] = -1;
    }
    const seconds = (this.scene.first + moment.before + moment.part) / this.scene.fps;
    for (const one of this.obstacles) {
      if (one.opens !== null && one.opens <= seconds && (one.closes === null || seconds < one.closes)) continue;
      shapes.set(one.shapes, FLOATS * at);
      const next = at + one.shapes.length / FLOATS;
      owners.fill(-1, at, next);
      at = next;
    }
    // What skinned avatars carry is drawn; their capsules, and rods of meshes, cast shadows and are pointed at.
    const sizes = new Map(this.skinned.length ? seen : []);
    for (const avatar of this.skinned) at = this.placeAvatar(avatar, sizes.get(avatar), moment, at, true);
    this.visible = at;
    for (const avatar of this.skinned) at = this.placeAvatar(avatar, sizes.get(avatar), moment, at, false);
    this.drawn = at;
  }

  // Places an avatar: its body, skeleton or cloud, and what it carries; of a skinned one what it carries (`held`), or its
  // body and its bones.
  placeAvatar(avatar, size, moment, at, held = null) {
    if (!this.pose(avatar, moment)) return at;
    const { heads, roots, facing, positions: P, rotations: R, look } = this, { scale } = this.scene.tables;
    const figure = this.scene.figures[this.scene.tables.figure[avatar]];
    if (held) return this.placeProps(avatar, at, held);
    roots[3 * avatar] = P[0]; roots[3 * avatar + 1] = P[1]; roots[3 * avatar + 2] = P[2];
    const ahead = figure.face ? figure.face.ahead : [0, 0, 1];
    if (figure.face) {
      const { joint, offset } = figure.face, s = scale[avatar];
      rotate(heads, 3 * avatar, R, 4 * joint, offset[0] * s, offset[1] * s, offset[2] * s);
      for (let i = 0; i < 3; i++) heads[3 * avatar + i] += P[3 * joint + i];
    } else {
      let top = 0;
      for (let j = 1; j < figure.joints.length; j++) if (P[3 * j + 1] > P[3 * top + 1]) top = j;
      for (let i = 0; i < 3; i++) heads[3 * avatar + i] = P[3 * top + i];
    }
    if (this.feet && figure.feet)
      this.feet[avatar] = figure.feet.map(j => [P[3 * j], P[3 * j + 1], P[3 * j + 2]]);
    rotate(facing, 3 * avatar, R, figure.face ? 4 * figure.face.joint : 0, ahead[0], ahead[1], ahead[2]);
    if (held === false) this.writeBones(avatar, figure);
    if (look === 'skeletons') at = this.placeSkeleton(avatar, figure, at);
    else if (look === 'cloud') at = this.placeCloud(avatar, figure, at, size);
    else at = this.placeCapsules(avatar, figure, at, size);
    return this.placeProps(avatar, at, held);
  }

  placeCapsules(avatar, figure, at, size) {
    const { shapes, owners } = this, { joints } = figure.capsules, all = joints.length;
    const count = size > 60 ? all : size > 24 ? Math.min(all, 17) : size > 9 ? Math.min(all, 9) : Math.min(all, 4);
    for (let k = 0; k < count; k++, at++) {
      this.capsule(avatar, figure, k, shapes, FLOATS * at);
      const paint = 4 * (this.colours * avatar + figure.capsules.parts[k]);
      for (let i = 0; i < 4; i++) shapes[FLOATS * at + 8 + i] = this.paints[paint + i];
      owners[at] = avatar;
    }
    return at;
  }

  // Writes both ends and radii of a capsule of an avatar that is posed.
  capsule(avatar, figure, k, out, o) {
    const { positions: P, rotations: R } = this, { scale, girth, stretch } = this.scene.tables;
    const { joints, starts, ends, radii, segments, swells } = figure.capsules, j = joints[k];
    const long = scale[avatar] * stretch[3 * avatar + segments[k]], wide = scale[avatar] * (swells[k] ? girth[avatar] : 1);
    rotate(out, o, R, 4 * j, starts[3 * k] * long, starts[3 * k + 1] * long, starts[3 * k + 2] * long);
    rotate(out, o + 4, R, 4 * j, ends[3 * k] * long, ends[3 * k + 1] * long, ends[3 * k + 2] * long);
    for (let i = 0; i < 3; i++) {
      out[o + i] += P[3 * j + i];
      out[o + 4 + i] += P[3 * j + i];
    }
    out[o + 3] = radii[2 * k] * wide;
    out[o + 7] = radii[2 * k + 1] * wide;
  }

  // What avatars of its type carry, with its body's size; of a skinned one meshes instead of their rods (`held`), or the
  // rods alone.
  placeProps(avatar, at, held) {
    const { shapes, owners, positions: P, rotations: R } = this, { scale, type } = this.scene.tables, s = scale[avatar];
    for (const mesh of (held && this.faces[type?.[avatar]]) || [])
      this.meshes.push([mesh, P.slice(3 * mesh.joint, 3 * mesh.joint + 3), R.slice(4 * mesh.joint, 4 * mesh.joint + 4), s]);
    for (const { joint, start, end, radius, paint, mesh } of this.props[type?.[avatar]] ?? []) {
      if (mesh === held) continue;
      const o = FLOATS * at;
      rotate(shapes, o, R, 4 * joint, ...start.map(value => value * s));
      rotate(shapes, o + 4, R, 4 * joint, ...end.map(value => value * s));
      for (let i = 0; i < 3; i++) {
        shapes[o + i] += P[3 * joint + i];
        shapes[o + 4 + i] += P[3 * joint + i];
      }
      shapes[o + 3] = shapes[o + 7] = radius * s;
      shapes.set(paint, o + 8);
      owners[at++] = avatar;
    }
    return at;
  }

  // Bones from joint to joint, and a ball at each joint.
  placeSkeleton(avatar, figure, at) {
    const { shapes, owners, positions: P } = this, paint = this.plain(avatar, figure);
    figure.parents.forEach((parent, j) => {
      const from = parent < 0 ? j : parent, o = FLOATS * at, same = parent < 0 || [0, 1, 2].every(i => P[3 * j + i] === P[3 * from + i]);
      shapes.set([P[3 * from], P[3 * from + 1], P[3 * from + 2], 0.012, P[3 * j], P[3 * j + 1] + (same ? 5e-4 : 0), P[3 * j + 2], 0.012, ...paint], o);
      shapes.set([P[3 * j], P[3 * j + 1], P[3 * j + 2], 0.024, P[3 * j], P[3 * j + 1] + 5e-4, P[3 * j + 2], 0.024, ...paint], o + FLOATS);
      owners.fill(avatar, at, at + 2);
      at += 2;
    });
    return at;
  }

  // The colour of its team, as light; of figures without teams that of their largest capsule.
  plain(avatar, figure) {
    const { team_colours: colours, tables } = this.scene, colour = colours[tables.team?.[avatar]];
    const paint = 4 * (this.colours * avatar + figure.capsules.parts[0]);
    return colour ? [...colour.map(value => (value / 255) ** 2), 0.1] : [...this.paints.subarray(paint, paint + 4)];
  }

  // Points on an avatar's capsules, as many as the size of each says, with the avatar's label.
  placeCloud(avatar, figure, at, size) {
    const { shapes, cloud } = this, o = FLOATS * at, { joints } = figure.capsules;
    const label = labelColour(avatar), share = size > 200 ? 1 : size > 60 ? 0.5 : 0.15;
    for (let k = 0; k < joints.length; k++) {
      // Capsules are there to be pointed at; they are not drawn.
      this.capsule(avatar, figure, k, shapes, o + FLOATS * k);
      this.owners[at + k] = avatar;
      const c = o + FLOATS * k, axis = [0, 1, 2].map(i => shapes[c + 4 + i] - shapes[c + i]), length = Math.hypot(...axis), [ra, rb] = [shapes[c + 3], shapes[c + 7]];
      const way = axis.map(value => value / (length || 1)), side = Math.abs(way[1]) < 0.9 ? [way[2], 0, -way[0]] : [0, -way[2], way[1]];
      const over = 1 / Math.hypot(...side), u = side.map(value => value * over), v = cross3(way, u), count = Math.ceil(share * CLOUD_POINTS * (length + ra + rb) * (ra + rb));
      for (let n = 0; n < count && this.points < MOST_POINTS; n++) {
        const turn = 2.399963 * n, along = ((n + 0.5) / count) * (length + ra + rb) - ra, part = clamp(along / (length || 1), 0, 1);
        const r = ra + (rb - ra) * part, beyond = along < 0 ? along : along > length ? along - length : 0, wide = Math.sqrt(Math.max(r * r - beyond * beyond, 0));
        const p = 6 * this.points++;
        for (let i = 0; i < 3; i++) {
          cloud[p + i] = shapes[c + i] + way[i] * along + wide * (Math.cos(turn) * u[i] + Math.sin(turn) * v[i]);
          cloud[p + 3 + i] = label[i];
        }
      }
    }
    return at + joints.length;
  }

  // What takes the skin of an avatar of size 1 into the frames of its joints and helpers, three rows of four for each: that
  // of its build, longer along bones and thicker across them.
  growth(avatar, figure) {
    if (this.grown.has(avatar)) return this.grown.get(avatar);
    const { tables: t } = this.scene, skin = figure.skins[t.bone_skin[avatar]], J = figure.joints.length, grown = Float32Array.from(t[`skin_${skin.number}_bindings`]);
    const axes = t[`skin_${skin.number}_axes`], length = joint => t.stretch[3 * avatar + figure.segments[joint]];
    for (let k = 0; k < J + 4; k++) {
      if (!skin.thickens[k]) continue;
      const joint = k < J ? k : skin.helpers[k - J], long = k < J ? length(k) : 0.5 * (length(figure.parents[joint]) + length(joint));
      const wide = t.girth[avatar] / skin.girth, axis = axes.subarray(3 * k, 3 * k + 3);
      for (let o = 12 * k; o < 12 * k + 4; o++) {
        const along = (long - wide) * (axis[0] * grown[o] + axis[1] * grown[o + 4] + axis[2] * grown[o + 8]);
        for (let i = 0; i < 3; i++) grown[o + 4 * i] = wide * grown[o + 4 * i] + axis[i] * along;
      }
    }
    this.grown.set(avatar, grown);
    return grown;
  }

  // Writes the paints of the parts of an avatar that is posed, and what takes its skin into the world.
  writeBones(avatar, figure) {
    const { positions: P, rotations: R, bones } = this, { tables: t } = this.scene, skin = figure.skins[t.bone_skin[avatar]], J = figure.joints.length;
    const first = this.skinned.indexOf(avatar) * this.boneRow, parts = 4 * SKIN_PARTS, bindings = this.growth(avatar, figure), s = t.scale[avatar];
    for (let i = 0; i < parts; i++) {
      const value = t.skin_paint[parts * avatar + i] / 255;
      bones[first + i] = i % 4 === 3 ? value : value * value;
    }
    skin.helpers.forEach((joint, h) => {
      // Half of how far the joint turns from where it is straight.
      const above = figure.parents[joint], up = R.subarray(4 * above, 4 * above + 4);
      const bent = multiply4(multiply4([up[0], -up[1], -up[2], -up[3]], R.subarray(4 * joint, 4 * joint + 4)), skin.straights.slice(4 * h, 4 * h + 4));
      const half = bent[0] < 0 ? bent.map(value => -value) : bent;
      half[0] += 1;
      const size = Math.hypot(...half);
      R.set(multiply4(up, half.map(value => value / size)), 4 * (J + h));
    });
    for (let k = 0; k < J + 4; k++) {
      const joint = k < J ? k : skin.helpers[k - J], w = R[4 * k], x = R[4 * k + 1], y = R[4 * k + 2], z = R[4 * k + 3];
      const from = 12 * k, out = first + parts + from;
      for (let i = 0; i < 3; i++) {
        const a = s * (i === 0 ? 1 - 2 * (y * y + z * z) : i === 1 ? 2 * (x * y + w * z) : 2 * (x * z - w * y));
        const b = s * (i === 0 ? 2 * (x * y - w * z) : i === 1 ? 1 - 2 * (x * x + z * z) : 2 * (y * z + w * x));
        const c = s * (i === 0 ? 2 * (x * z + w * y) : i === 1 ? 2 * (y * z - w * x) : 1 - 2 * (x * x + y * y));
        for (let column = 0; column < 4; column++)
          bones[out + 4 * i + column] = a * bindings[from + column] + b * bindings[from + 4 + column] + c * bindings[from + 8 + column];
        bones[out + 4 * i + 3] += P[3 * joint + i];
      }
    }
  }

  // Where scripted targets are.
  targets(moment) {
    const { targets, tables, rate, fps, first } = this.scene, found = [];
    if (!targets.length) return found;
    const rows = tables.target.length / (3 * targets.length);
    const at = Math.min((first + moment.before + moment.part) / fps * rate, rows - 1), low = Math.floor(at);
    const high = Math.min(low + 1, rows - 1), part = at - low;
    for (let k = 0; k < targets.length; k++)
      found.push([0, 1, 2].map(i => tables.target[3 * (low * targets.length + k) + i] * (1 - part)
        + tables.target[3 * (high * targets.length + k) + i] * part));
    return found;
  }

  // The avatar on a ray, or within some pixels of it: of those, the one that is nearest.
  pick(eye, way, perPixel, slack) {
    let best = -1, nearest = Infinity;
    for (let i = 0; i < this.drawn; i++) {
      if (this.owners[i] < 0) continue;
      const o = FLOATS * i, s = this.shapes;
      const [miss, along] = missOf(eye, way, s, o);
      if (along > 0 && along < nearest && miss < slack * perPixel * along) {
        nearest = along;
        best = this.owners[i];
      }
    }
    return best;
  }
}

// How far a ray misses a capsule, and how far along the ray that is.
function missOf(eye, way, s, o) {
  const bx = s[o + 4] - s[o], by = s[o + 5] - s[o + 1], bz = s[o + 6] - s[o + 2];
  const ox = eye[0] - s[o], oy = eye[1] - s[o + 1], oz = eye[2] - s[o + 2];
  const bb = bx * bx + by * by + bz * bz, bw = bx * way[0] + by * way[1] + bz * way[2];
  const bo = bx * ox + by * oy + bz * oz, ow = ox * way[0] + oy * way[1] + oz * way[2];
  const part = Math.min(Math.max((bo - bw * ow) / Math.max(bb - bw * bw, 1e-9), 0), 1);
  const along = part * bw - ow;
  const x = ox + way[0] * along - bx * part, y = oy + way[1] * along - by * part, z = oz + way[2] * along - bz * part;
  return [Math.hypot(x, y, z) - (s[o + 3] + (s[o + 7] - s[o + 3]) * part), along];
}
