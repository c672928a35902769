// What is played live: frames as they come, what is known of the avatars in them, and what the viewer does to the scene.

const KEPT = 60; // control frames that are kept, for trails
const BEHIND = 1; // control frames that the picture stays behind what has come, so that frames that are late do not show
const LOW = 0.3, HIGH = 2.2, FAR = 60; // heights that targets are dragged to, and how far away [m]

// Frames as a server sends them; it has what a recording has.
class LiveRecording {
  constructor(scene) {
    const t = scene.tables;
    for (const name of Object.keys(t)) if (name.startsWith('strike_')) t[name] = [];
    Object.assign(this, { scene, parts: new Map(), states: new Map(), latest: -1, dragged: new Map(), status: null });
    this.rows = scene.live.rows;
  }

  // Connects; `heard` gets each message that is text. Resolves with the first frame.
  connect(heard) {
    return new Promise((resolve, reject) => {
      const address = new URL('live', location.href);
      address.protocol = 'ws:';
      this.socket = new WebSocket(address);
      this.socket.binaryType = 'arraybuffer';
      this.socket.onmessage = ({ data }) => {
        if (typeof data === 'string') return heard(JSON.parse(data));
        this.read(data);
        resolve();
      };
      this.socket.onclose = () => {
        const error = Error('The connection is lost. If crowdsim play has ended, its terminal says what it kept.');
        reject(error);
        heard({ lost: error });
      };
    });
  }

  send(command) { if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(command)); }

  read(buffer) {
    const length = new DataView(buffer).getUint32(0, true), parts = [], { scene, rows } = this;
    const state = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    let at = 4 + length;
    for (const figure of scene.figures) {
      const n = figure.avatars.length, rotationStride = 4 * n * figure.joints.length, placeStride = 3 * n * figure.moving.length;
      const rotations = new Int16Array(buffer, at, rows * rotationStride);
      at += rotations.byteLength + (-rotations.byteLength & 3);
      const places = new Float32Array(buffer, at, rows * placeStride);
      at += places.byteLength;
      parts.push({ rotations, places, rotationStride, placeStride });
    }
    this.parts.set(state.frame, parts);
    this.states.set(state.frame, state);
    this.latest = state.frame;
    this.parts.delete(state.frame - KEPT);
    this.states.delete(state.frame - KEPT);
    scene.frames = (state.frame + 1) * rows;
    for (const [target, point] of this.dragged)
      if (!point.held && Math.hypot(...state.targets[target].map((value, i) => value - point.at[i])) < 0.005) this.dragged.delete(target);
    this.onframe?.(state);
  }

  clear() {
    for (const kept of [this.parts, this.states, this.dragged]) kept.clear();
    this.latest = -1;
  }

  // The time up to which there are poses [s].
  get end() { return Math.max(0, ((this.latest + 1) * this.rows - 1) / this.scene.fps); }

  // A frame that is missing looks like the last one before it.
  nearest(control) {
    for (let number = Math.min(control, this.latest); number > control - KEPT; number--) if (this.parts.has(number)) return number;
    return this.latest;
  }

  row(frame) {
    const control = Math.floor(frame / this.rows), number = this.nearest(control), parts = this.parts.get(number);
    return parts ? { parts, row: number === control ? frame - control * this.rows : this.rows - 1 } : null;
  }

  known(frame) { return this.row(frame); }

  state(control) { return this.states.get(this.nearest(control)); }

  load() { return null; }
}

class LiveCrowd extends Crowd {
  isPresent(avatar, frame) { return Boolean(this.recording.state(Math.floor(frame / this.recording.rows))?.there[avatar]); }

  targets(moment) {
    const { recording } = this, now = recording.state(Math.floor(moment.before / recording.rows));
    const next = recording.state(Math.floor(moment.before / recording.rows) + 1) ?? now;
    const part = ((moment.before + moment.part) / recording.rows) % 1;
    return now.targets.map((point, k) => recording.dragged.get(k)?.at ?? point.map((value, i) => value * (1 - part) + next.targets[k][i] * part));
  }
}

class LiveFacts extends Facts {
  constructor(scene, recording) {
    super(scene);
    this.recording = recording;
  }

  at(seconds) { return this.recording.state(Math.floor(seconds * this.scene.rate + 1e-6)); }

  add({ time, attacker, victim, limb, outcome, down, point, speed, damage }) {
    const t = this.scene.tables, first = t.strike_time.length;
    for (const [name, values] of Object.entries({ time, attacker, victim, limb, outcome, down, point, speed, damage })) t[`strike_${name}`].push(...values);
    for (let i = first; i < t.strike_time.length; i++) {
      if (t.strike_attacker[i] >= 0) this.thrown[t.strike_attacker[i]].push(i);
      if (t.strike_victim[i] >= 0) this.received[t.strike_victim[i]].push(i);
      if (this.hasHit(i)) {
        this.landed.push(i);
        this.heated = null;
      }
    }
  }

  clear() {
    const t = this.scene.tables;
    for (const name of Object.keys(t)) if (name.startsWith('strike_')) t[name].length = 0;
    for (const list of [...this.thrown, ...this.received, this.landed]) list.length = 0;
    this.heated = null;
  }

  health(avatar, seconds) { return this.at(seconds).health[avatar]; }

  isDown(avatar, seconds) { return Boolean(this.at(seconds).down[avatar]); }

  opponent(avatar, seconds) { return this.at(seconds).opponent[avatar]; }

  action(avatar, seconds) {
    const state = this.at(seconds), { scene } = this, number = state.action[avatar], figure = scene.figures[scene.tables.figure[avatar]];
    if (number < 0) return null;
    const clip = scene.live.clips[scene.live.policies[avatar]][state.clip[avatar]];
    return { number, clip, frame: state.place[avatar], seconds: state.place[avatar] / 60, figure };
  }
}

class LivePlayer extends Player {
  constructor(recording) {
    super(recording);
    document.body.classList.add('staged');
    this.setting = false;
    const { scene } = this;
    if (scene.targets.length && scene.names.length <= 4) {
      const [x, , z] = scene.tables.target, [ownX, ownZ] = scene.live.start;
      Object.assign(this.camera.orbit, { target: [(x + ownX) / 2, 0.95, (z + ownZ) / 2], yaw: 1.1, pitch: 0.32, distance: 6 });
      this.camera.choice = this.camera.find('free');
    }
    this.time = recording.end;
    recording.onframe = state => this.frame(state);
    this.buttons();
  }

  makeCrowd() { return new LiveCrowd(this.recording); }
  makeFacts() { return new LiveFacts(this.scene, this.recording); }
  makeReasons() { return new LiveReasons(); }
  makeValues() { return new LiveValues(); }

  ownKeys() {
    return [['drag a target', 'moves it over the floor; with Shift up and down'],
      ['drag the chosen avatar', 'puts it where it is let go, or beside it; a second finger lets it be']];
  }

  frame(state) {
    this.facts.add(state.strikes);
    this.counts = state.counts;
    this.change();
  }

  heard(message) {
    if (message.lost) return this.fail(message.lost);
    if (message.restart) {
      this.recording.clear();
      this.facts.clear();
      this.reasons.decisions.length = this.values.decisions.length = 0;
      this.time = 0;
    }
    if (message.why) this.reasons.add(message.why);
    if (message.values) this.values.add(message.values);
    if (message.error) {
      // What was refused may be where a target was dragged to.
      this.recording.dragged.clear();
      this.say(message.error, true);
    }
    if (message.said) this.say(message.said);
    if (message.done === 'record') element('record').disabled = false;
    if (message.tunings) this.show(message);
    this.change();
  }

  say(text, wrong = false) {
    element('said').textContent = text;
    element('said').classList.toggle('wrong', wrong);
    if (wrong) element('record').disabled = false;
  }

  // Shows whether it stands still, and what is tuned.
  show({ paused, over, speed, tunings }) {
    this.playing = !paused;
    this.speed = speed;
    this.painter.times = [];
    element('play').textContent = paused ? 'Go on' : 'Pause';
    element('play').disabled = over;
    if (over) this.say('The scenario has come to its end.');
    element('speed').value = speed;
    for (const [type, { behaviours, ...others }] of Object.entries(tunings)) {
      for (const [key, value] of Object.entries({ ...behaviours, ...others })) {
        const slider = this.slider(type, key, value, key in behaviours);
        if (document.activeElement !== slider || !slider.matches(':active')) slider.value = value;
        slider.nextElementSibling.textContent = Number(slider.value).toFixed(key === 'tempo' ? 0 : 2);
      }
    }
  }

  slider(type, key, value, isWeight) {
    const id = `tune-${type}-${key}`;
    if (element(id)) return element(id);
    const section = element('tunings');
    let box = [...section.children].find(one => one.dataset.type === type);
    if (!box) {
      box = make('fieldset', '', make('legend', type));
      box.dataset.type = type;
      section.append(box);
    }
    const [low, high, step] = isWeight ? [0, Math.max(2, 2 * value), 0.05] : { temperature: [0, 0.5, 0.01], tempo: [5, 300, 5], reaction: [0, 1, 0.05] }[key];
    const slider = make('input'), output = make('output'), names = { tempo: 'tempo [/min]', reaction: 'reaction [s]' };
    Object.assign(slider, { type: 'range', id, min: low, max: Math.max(high, value), step, title: isWeight ? `weight of the behaviour ${key}` : key });
    slider.addEventListener('input', () => { output.textContent = Number(slider.value).toFixed(key === 'tempo' ? 0 : 2); });
    slider.addEventListener('change', () => this.recording.send({ do: 'tune', type, key, value: Number(slider.value) }));
    box.append(make('label', '', make('span', names[key] ?? key), slider, output));
    return slider;
  }

  buttons() {
    const on = (id, act) => element(id).addEventListener('click', act), send = (command, more = {}) => this.recording.send({ do: command, ...more });
    on('restart', () => send('restart'));
    on('record', () => {
      element('record').disabled = true;
      this.say('Being recorded ...');
      send('record');
    });
    on('set-on', () => {
      this.setting = !this.setting;
      this.change();
    });
    on('set-free', () => send('set_on', { avatar: this.selected }));
    on('heal', () => send('heal', { avatar: this.selected }));
    on('heal-all', () => send('heal'));
    element('heal-all').hidden = !this.facts.canBeHurt;
    on('remove', () => send(this.isThere() ? 'remove' : 'add', { avatar: this.selected }));
  }

  // Decisions of one avatar are told at a time.
  tellWhy() {
    const asked = element('why').open && this.selected >= 0 ? this.selected : null;
    if (asked !== this.asked) this.recording.send({ do: 'why', avatar: asked });
    this.asked = asked;
    super.tellWhy();
  }

  floorMap() {
    const asked = this.options.valued && this.selected >= 0 ? this.selected : null;
    if (asked !== this.valued) this.recording.send({ do: 'values', ...(asked === null ? {} : { avatar: asked }) });
    this.valued = asked;
    return super.floorMap();
  }

  isThere() { return Boolean(this.recording.state(this.recording.latest)?.there[this.selected]); }

  // With an avatar that is to be set on another one, a click chooses that one.
  select(avatar) {
    if (this.setting && avatar >= 0 && this.selected >= 0 && avatar !== this.selected) {
      this.recording.send({ do: 'set_on', avatar: this.selected, opponent: avatar });
      this.say(`${this.scene.names[this.selected]} is set on ${this.scene.names[avatar]}.`);
      this.setting = false;
      return this.change();
    }
    this.setting = false;
    return super.select(avatar);
  }

  play(playing) { this.recording.send({ do: 'pause', paused: !playing }); }

  step(frames) { if (frames > 0) this.recording.send({ do: 'step' }); }

  seek() { this.change(); }

  chooseSpeed(speed) { this.recording.send({ do: 'speed', speed }); }

  // Takes hold of a target under the pointer.
  hold(event) {
    if (!this.view) return null;
    const { view, recording } = this, at = this.time * this.scene.fps, moment = this.crowd.around(at);
    let best = null, nearest = Infinity;
    for (const [k, point] of (moment ? this.crowd.targets(moment) : []).entries()) {
      const seen = view.project(...point);
      if (!seen) continue;
      const miss = Math.hypot(seen[0] - event.offsetX, seen[1] - event.offsetY), size = 1.3 * MARKER_RADIUS * view.focal / seen[2];
      if (miss < Math.max(size, event.pointerType === 'touch' ? 24 : 12) && miss < nearest) [best, nearest] = [{ k, point }, miss];
    }
    if (!best) return this.holdAvatar(event);
    const place = { at: [...best.point], held: true };
    recording.dragged.set(best.k, place);
    return {
      move: moved => {
        this.dragTo(place, moved);
        recording.dragged.set(best.k, place);
        const [x, y, z] = place.at;
        recording.send({ do: 'drag', target: best.k, x, y, z });
        this.change();
      },
      drop: () => { place.held = false; },
    };
  }

  // Takes hold of the chosen avatar under the pointer: a ring shows where it would be put.
  holdAvatar(event) {
    const avatar = this.selected;
    if (avatar < 0 || !this.isThere() || this.setting || event.button || event.shiftKey || this.pick(event) !== avatar) return null;
    const { roots } = this.crowd, place = { at: [roots[3 * avatar], 0, roots[3 * avatar + 2]] };
    return {
      move: moved => {
        this.dragTo(place, moved);
        this.overlay.placing = { avatar, at: place.at };
        this.change();
      },
      drop: done => {
        if (done && this.overlay.placing) this.recording.send({ do: 'place', avatar, x: place.at[0], z: place.at[2] });
        this.overlay.placing = null;
        this.change();
      },
    };
  }

  // Moves a point to where the pointer is: over the floor at its height, with Shift up and down.
  dragTo(place, event) {
    const { eye } = this.view, way = this.view.ray(event.offsetX, event.offsetY), [x, y, z] = place.at;
    const level = Math.hypot(this.view.ahead[0], this.view.ahead[2]) || 1, facing = [this.view.ahead[0] / level, 0, this.view.ahead[2] / level];
    const upright = dot3(facing, way) > 1e-3 ? dot3(facing, [x - eye[0], 0, z - eye[2]]) / dot3(facing, way) : 0;
    if (event.shiftKey) {
      if (upright > 0) place.at[1] = clamp(eye[1] + upright * way[1], LOW, HIGH);
      return;
    }
    // A floor that is seen from its edge is no place to point at.
    const flat = Math.abs(way[1]) > 0.06 ? (y - eye[1]) / way[1] : upright;
    const along = flat > 0 && flat < FAR ? flat : upright;
    if (along > 0 && along < FAR) [place.at[0], place.at[2]] = [eye[0] + along * way[0], eye[2] + along * way[2]];
  }

  tick(now) {
    requestAnimationFrame(later => this.tick(later));
    const { recording } = this, passed = Math.min(now - this.last, 250) / 1000, end = recording.end;
    if (this.last && (this.playing || this.painter.hasty) && !this.failed) this.painter.pace(now - this.last);
    if (this.playing && !this.failed) {
      const lead = end - BEHIND / this.scene.rate - this.time;
      // It goes a little faster or slower, to stay as far behind what comes.
      if (Math.abs(lead) > 0.4) this.time += lead;
      else this.time = Math.min(this.time + passed * this.speed * clamp(1 + 2 * lead, 0.5, 1.6), end);
      this.change();
    } else this.time = end;
    this.end = end;
    this.last = now;
    const waits = this.fine && now > this.fine;
    if (!this.dirty && !waits || this.failed) return;
    this.draw(passed, waits);
    this.tell();
  }

  // What changes while it is played.
  tell() {
    const { thrown, landed } = this.counts ?? { thrown: 0, landed: 0 }, chosen = this.selected >= 0, there = chosen && this.isThere();
    element('summary').textContent = `live · ${thrown} strike${thrown === 1 ? '' : 's'}, ${landed} landed`;
    element('actions').hidden = !chosen || this.scene.names.length < 2 && !this.facts.canBeHurt;
    element('set-on').textContent = this.setting ? 'Click its opponent ...' : 'Set on ...';
    element('heal').hidden = !(chosen && this.scene.tables.health[2 * this.selected] > 0);
    element('set-on').disabled = element('set-free').disabled = element('heal').disabled = !there;
    element('remove').textContent = there ? 'Take out' : 'Bring back';
  }
}
