// The player: time, input, and a picture whenever something has changed.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
const KEYS = [
  ['Space', 'play or pause'], ['← →', 'one control frame back or ahead; with Shift one second'],
  [', .', 'previous or next strike that landed, of the chosen avatar where one is chosen'],
  ['; :', 'previous or next avatar that goes down'], ['Home End', 'begin or end'], ['[ ]', 'slower or faster'], ['L', 'loop'],
  ['1 to 9', 'cameras in their order'], ['W A S D', 'move the camera over the floor'], ['Q E', 'turn around the target'],
  ['R F', 'look from higher up or lower down'], ['+ −', 'nearer or further'],
  ['N P', 'next or previous avatar'], ['V', 'follow the chosen avatar'], ['B', 'see with its eyes'], ['Esc', 'choose none'],
  ['T', 'names'], ['M', 'marks of strikes'],
  ['G', 'trails on the floor of the last 3 s, of the chosen avatar where one is chosen'],
  ['H', 'heat map of the strikes that have landed'], ['U', 'values around the chosen avatar, live and from the server of crowdsim view'], ['J', 'joints of the chosen avatar with their names'], ['K', 'bodies, skeletons, or the labelled cloud'], ['C', 'copy the camera as YAML'],
  ['?', 'these keys'],
];
const POINTING = [
  ['drag', 'turn around the target; one finger'], ['right drag, Shift and drag', 'move over the floor; two fingers'],
  ['wheel', 'nearer or further; two fingers'], ['click', 'choose an avatar, or none'], ['double click', 'follow an avatar'],
];

class Player {
  constructor(recording) {
    const { scene } = recording;
    Object.assign(this, { recording, scene, playing: false, speed: 1, selected: -1, dirty: true, fine: 0, last: 0, failed: '', coming: null });
    this.start = scene.first / scene.fps;
    this.end = (scene.first + scene.frames - 1) / scene.fps;
    this.time = this.start;
    this.crowd = this.makeCrowd();
    this.facts = this.makeFacts();
    this.camera = new Camera(scene);
    this.painter = new Painter(element('picture'), this.crowd);
    this.overlay = new Overlay(element('overlay'), this.crowd, this.facts);
    this.panel = new Panel(this.crowd, this.facts);
    this.reasonPanel = new ReasonPanel(this.facts);
    this.reasons = this.makeReasons();
    this.values = this.makeValues();
    this.valuePanel = new ValuePanel();
    element('values-box').hidden = !this.values;
    this.timeline = new Timeline(element('strip'), this.facts);
    this.options = { labels: scene.names.length <= 4, marks: true, joints: false, trails: false, hits: false, valued: false };
    element('labels').checked = this.options.labels;
    this.dark = matchMedia('(prefers-color-scheme: dark)');
    this.dark.addEventListener('change', () => this.change());
    this.controls();
    this.pointers();
    this.keys();
    new ResizeObserver(() => this.change()).observe(element('picture'));
    requestAnimationFrame(now => this.tick(now));
  }

  makeCrowd() { return new Crowd(this.recording); }
  makeFacts() { return new Facts(this.scene); }
  makeReasons() {
    const { why } = this.recording;
    return why === true ? new ServedReasons(this.scene, () => this.change()) : why ? new PageReasons(this.scene, why) : null;
  }

  makeValues() { return this.recording.why === true ? new ServedValues(this.scene, () => this.change()) : null; }

  change() { this.dirty = true; }

  seek(seconds) {
    this.time = clamp(seconds, this.start, this.end);
    this.camera.followed = null;
    this.change();
  }

  play(playing) {
    if (playing && this.time >= this.end) this.seek(this.start);
    this.playing = playing;
    this.painter.times = [];
    element('play').textContent = playing ? 'Pause' : 'Play';
    this.change();
  }

  // Steps from one control frame to another, whatever lies between.
  step(frames) {
    const rate = this.scene.rate, at = this.time * rate;
    this.play(false);
    this.seek((frames > 0 ? Math.floor(at + 1e-4) + frames : Math.ceil(at - 1e-4) + frames) / rate);
  }

  select(avatar) {
    this.selected = avatar;
    if (avatar >= 0 && avatar !== this.camera.avatar) {
      this.camera.avatar = avatar;
      this.camera.followed = null;
    }
    element('avatar').value = avatar;
    this.change();
  }

  chooseCamera(choice) {
    if (choice < 0 || choice >= this.camera.choices.length) return;
    const one = this.camera.choices[choice];
    this.coming = null;
    if (one.kind === 'track' && !one.track) {
      this.coming = choice;
      this.recording.source.camera(choice).then(track => {
        one.track = track;
        if (this.coming === choice) this.chooseCamera(choice);
      }).catch(error => {
        this.coming = null;
        this.fail(error);
      });
      return;
    }
    if (['follow', 'eye'].includes(one.kind) && this.selected < 0) this.select(this.firstSeen());
    this.camera.choose(choice, this.view);
    this.change();
  }

  firstSeen() {
    const frame = Math.round(this.time * this.scene.fps) - this.scene.first;
    return Math.max(0, this.scene.names.findIndex((_, avatar) => this.crowd.isPresent(avatar, frame)));
  }

  chooseSpeed(speed) {
    this.speed = speed;
    element('speed').value = speed;
  }

  async copyCamera() {
    const text = this.camera.yaml(this.view), button = element('copy');
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = 'Copied';
    } catch {
      // Pages from files may not reach the clipboard: the text is there to be copied by hand.
      const dialog = element('keys'), box = make('textarea', text);
      Object.assign(box, { rows: 4, cols: 60, readOnly: true });
      dialog.replaceChildren(make('h2', 'Camera'), box, this.closing());
      dialog.showModal();
      box.select();
    }
    setTimeout(() => { button.textContent = 'Copy camera'; }, 1500);
    return text;
  }

  closing() {
    const form = make('form', '', make('button', 'Close'));
    form.method = 'dialog';
    return make('p', '', form);
  }

  // Further keys and uses of the pointer.
  ownKeys() { return []; }

  showKeys() {
    const table = make('table'), dialog = element('keys');
    for (const [keys, text] of [...KEYS, ...POINTING, ...this.ownKeys()]) table.append(make('tr', '', make('td', '', make('kbd', keys)), make('td', text)));
    dialog.replaceChildren(make('h2', 'Keys and pointer'), table, this.closing());
    dialog.showModal();
  }

  controls() {
    const on = (id, event, act) => element(id).addEventListener(event, act);
    const scrub = element('scrub'), strip = element('strip');
    Object.assign(scrub, { min: this.start, max: this.end });
    on('scrub', 'input', () => this.seek(Number(scrub.value)));
    on('play', 'click', () => this.play(!this.playing));
    on('back', 'click', () => this.step(-1));
    on('ahead', 'click', () => this.step(1));
    for (const speed of SPEEDS) element('speed').append(new Option(`${speed} ×`, speed, speed === 1, speed === 1));
    on('speed', 'change', () => this.chooseSpeed(Number(element('speed').value)));
    this.camera.choices.forEach((choice, i) => { element('camera').append(new Option(`${i + 1} ${choice.name}`, i)); });
    on('camera', 'change', () => this.chooseCamera(Number(element('camera').value)));
    on('avatar', 'change', () => this.select(Number(element('avatar').value)));
    for (const option of ['labels', 'marks', 'trails', 'hits', 'valued']) on(option, 'change', () => this.set(option, element(option).checked));
    on('look', 'change', () => this.change());
    on('copy', 'click', () => this.copyCamera());
    on('help', 'click', () => this.showKeys());
    on('why', 'toggle', () => this.change());
    let held = false;
    const go = event => this.seek(this.timeline.jump(event.offsetX, strip.clientWidth, this.selected));
    on('strip', 'pointerdown', event => {
      held = true;
      strip.setPointerCapture(event.pointerId);
      go(event);
    });
    on('strip', 'pointermove', event => { if (held) this.seek(this.timeline.at(event.offsetX, strip.clientWidth)); });
    for (const event of ['pointerup', 'pointercancel']) on('strip', event, () => { held = false; });
  }

  // Shows why the chosen avatar does what it does, where that is known and asked for.
  tellWhy() {
    const { selected, reasons } = this, knows = selected >= 0 && reasons !== null && reasons.knows(selected);
    element('reasons').hidden = !knows;
    if (knows && element('why').open) this.reasonPanel.show(reasons.find(selected, Math.floor(this.time * this.scene.rate + 1e-6)));
  }

  // What lies over the floor: values around the chosen avatar, or where strikes have landed.
  floorMap() {
    const asked = this.values && this.options.valued && this.selected >= 0;
    element('values').hidden = !asked;
    if (!asked) return this.options.hits ? this.facts.heat(this.time) : null;
    const found = this.values.find(this.selected, Math.floor(this.time * this.scene.rate + 1e-6));
    this.valuePanel.show(found);
    if (!found?.values) return null;
    found.raster ??= rasterValues(found);
    return found.raster;
  }

  set(option, value) {
    this.options[option] = value;
    const box = element(option);
    if (box) box.checked = value;
    this.change();
  }

  pick(event) {
    if (!this.view) return -1;
    const view = this.view, way = view.ray(event.offsetX, event.offsetY);
    return this.crowd.pick(view.eye, way, 2 * view.tall / view.height, event.pointerType === 'touch' ? 16 : 4);
  }

  pointers() {
    const canvas = element('picture'), down = new Map();
    let moved = 0, spread = 0, held = null;
    canvas.addEventListener('contextmenu', event => event.preventDefault());
    canvas.addEventListener('pointerdown', event => {
      canvas.setPointerCapture(event.pointerId);
      down.set(event.pointerId, [event.clientX, event.clientY]);
      if (down.size === 1) {
        moved = 0;
        held = this.hold(event);
      } else if (held) {
        held.drop(false);
        held = null;
      }
      spread = 0;
    });
    canvas.addEventListener('pointermove', event => {
      const before = down.get(event.pointerId);
      if (!before || !this.view) return;
      const dx = event.clientX - before[0], dy = event.clientY - before[1];
      down.set(event.pointerId, [event.clientX, event.clientY]);
      moved += Math.abs(dx) + Math.abs(dy);
      if (moved < 4) return;
      this.painter.hurry(true);
      if (held) {
        held.move(event);
        return;
      }
      this.camera.grab(this.view);
      if (down.size > 1) {
        // Of two fingers each moves half of it; what is between them is how near the camera is.
        this.drag(0.5 * dx, 0.5 * dy);
        const [[a, b], [c, d]] = [...down.values()], now = Math.hypot(a - c, b - d);
        if (spread && now) this.camera.zoom(spread / now);
        spread = now;
      } else if (event.buttons & 2 || event.buttons & 4 || event.shiftKey) this.drag(dx, dy);
      else this.camera.turn(-0.006 * dx, 0.006 * dy);
      this.change();
    });
    for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, event => {
      if (held) held.drop(name === 'pointerup' && moved >= 4);
      else if (name === 'pointerup' && down.size === 1 && moved < 4 && event.button === 0) this.select(this.pick(event));
      held = null;
      down.delete(event.pointerId);
      spread = 0;
      if (down.size === 0) this.painter.hurry(false);
    });
    canvas.addEventListener('dblclick', event => {
      const avatar = this.pick(event);
      if (avatar < 0) return;
      this.select(avatar);
      this.chooseCamera(this.camera.find('follow'));
    });
    canvas.addEventListener('wheel', event => {
      event.preventDefault();
      if (!this.view) return;
      this.camera.grab(this.view);
      this.camera.zoom(Math.exp(clamp(event.deltaY * (event.deltaMode ? 30 : 1), -300, 300) * 0.0015));
      this.change();
    }, { passive: false });
  }

  // What the pointer takes hold of, with what becomes of it; nothing in a recording.
  hold() { return null; }

  // Moves the floor with the pointer.
  drag(dx, dy) {
    const metres = this.camera.orbit.distance / this.view.focal, slope = Math.max(Math.sin(Math.abs(this.camera.orbit.pitch)), 0.3);
    this.camera.pan(-dx * metres, dy * metres / slope);
  }

  // The next or previous of times.
  jumpTo(times, ahead) {
    const found = ahead ? times.filter(time => time > this.time + 1e-3) : times.filter(time => time < this.time - 1e-3);
    if (found.length) this.seek(ahead ? Math.min(...found) : Math.max(...found));
  }

  keys() {
    const turn = (yaw, pitch) => { this.camera.grab(this.view); this.camera.turn(yaw, pitch); };
    const pan = (right, ahead) => {
      this.camera.grab(this.view);
      this.camera.pan(0.06 * right * this.camera.orbit.distance, 0.06 * ahead * this.camera.orbit.distance);
    };
    const zoom = factor => { this.camera.grab(this.view); this.camera.zoom(factor); };
    const next = step => {
      const count = this.scene.names.length, none = step > 0 ? -1 : 0;
      this.select(((this.selected < 0 ? none : this.selected) + step + count) % count);
    };
    const speed = step => this.chooseSpeed(SPEEDS[clamp(SPEEDS.indexOf(this.speed) + step, 0, SPEEDS.length - 1)]);
    const events = kind => this.timeline.events(this.selected)[kind];
    const acts = {
      ' ': () => this.play(!this.playing),
      arrowleft: event => (event.shiftKey ? this.seek(this.time - 1) : this.step(-1)),
      arrowright: event => (event.shiftKey ? this.seek(this.time + 1) : this.step(1)),
      ',': () => this.jumpTo(events('strikes'), false), '.': () => this.jumpTo(events('strikes'), true),
      ';': () => this.jumpTo(events('downs'), false), ':': () => this.jumpTo(events('downs'), true),
      home: () => this.seek(this.start), end: () => this.seek(this.end),
      '[': () => speed(-1), ']': () => speed(1), l: () => element('loop').click(),
      w: () => pan(0, 1), s: () => pan(0, -1), a: () => pan(-1, 0), d: () => pan(1, 0),
      q: () => turn(-0.12, 0), e: () => turn(0.12, 0), r: () => turn(0, 0.08), f: () => turn(0, -0.08),
      '+': () => zoom(1 / 1.15), '=': () => zoom(1 / 1.15), '-': () => zoom(1.15),
      n: () => next(1), p: () => next(-1), escape: () => this.select(-1),
      v: () => this.chooseCamera(this.camera.find('follow')), b: () => this.chooseCamera(this.camera.find('eye')),
      t: () => this.set('labels', !this.options.labels), m: () => this.set('marks', !this.options.marks),
      g: () => this.set('trails', !this.options.trails), h: () => this.set('hits', !this.options.hits),
      u: () => this.set('valued', !this.options.valued), j: () => this.set('joints', !this.options.joints),
      k: () => { const look = element('look'); look.selectedIndex = (look.selectedIndex + 1) % look.length; }, c: () => this.copyCamera(), '?': () => this.showKeys(),
    };
    addEventListener('keydown', event => {
      if (event.ctrlKey || event.metaKey || event.altKey || !this.view || element('keys').open) return;
      const { target } = event, key = event.key.toLowerCase();
      // Elements keep the keys that they need.
      if (target.tagName === 'SELECT' || target.tagName === 'TEXTAREA') return;
      if (key === ' ' && ['BUTTON', 'INPUT'].includes(target.tagName) && target.id !== 'scrub') return;
      if (/^[1-9]$/.test(key)) this.chooseCamera(Number(key) - 1);
      else if (Object.hasOwn(acts, key)) acts[key](event);
      else return;
      event.preventDefault();
      this.change();
    });
  }

  fail(error) {
    this.failed = error.message;
    if (this.playing) this.play(false);
    const message = element('message');
    message.textContent = error.message;
    message.hidden = false;
    this.dirty = false;
  }

  tick(now) {
    requestAnimationFrame(later => this.tick(later));
    const passed = Math.min(now - this.last, 250);
    // Time stands still while what comes next is being read or posed.
    if (this.last && (this.playing && !this.waiting || this.painter.hasty)) this.painter.pace(now - this.last);
    if (this.playing && this.last && !this.waiting) {
      this.time += passed / 1000 * this.speed;
      if (this.time > this.end) {
        if (element('loop').checked) this.seek(this.start);
        else {
          this.time = this.end;
          this.play(false);
        }
      }
    }
    this.last = now;
    const waits = this.fine && now > this.fine;
    if (!this.playing && !this.dirty && !waits) return;
    this.draw(passed / 1000, waits);
  }

  draw(passed, fine) {
    const canvas = element('picture'), width = canvas.clientWidth, height = canvas.clientHeight, { scene } = this;
    if (!width || !height) return;
    const moment = this.crowd.around(this.time * scene.fps - scene.first);
    this.waiting = !moment;
    if (!moment) {
      // The block that is missing has been asked for; what it says when it fails is shown.
      element('clock').textContent = `${this.time.toFixed(2)} s, being prepared`;
      const number = Math.floor(clamp(this.time * scene.fps - scene.first, 0, scene.frames - 1) / scene.block);
      for (const one of [number, number + 1]) this.recording.load(one, true)?.promise.catch(error => this.fail(error));
      return;
    }
    for (const next of [1, 2]) this.recording.load(Math.floor(moment.before / scene.block) + next, false)?.promise.catch(() => {});
    this.dirty = false;
    // Trails show what was before, which may have to be unpacked first.
    for (let back = 1; this.options.trails && back <= Math.ceil(TRAIL * scene.fps / scene.block); back++) {
      const entry = this.recording.load(Math.floor(moment.before / scene.block) - back, false);
      if (entry && !entry.parts) entry.promise.then(() => this.change(), () => {});
    }
    if (this.failed) {
      this.failed = '';
      element('message').hidden = true;
    }
    this.painter.theme = this.dark.matches ? 'dark' : 'light';
    this.view = this.camera.view(this.crowd, this.time, passed, width, height);
    const onAvatar = ['follow', 'eye'].includes(this.camera.kind), detail = fine ? 1 : (this.painter.width || width) / width;
    this.crowd.look = element('look').value;
    this.crowd.place(moment, this.view, onAvatar ? this.camera.avatar : this.selected, 3, detail);
    // A camera on an avatar needs to know where that is now.
    if (onAvatar) {
      this.view = this.camera.view(this.crowd, this.time, this.playing ? passed : 0, width, height);
      this.crowd.place(moment, this.view, this.camera.avatar, 3, detail);
    }
    // While it stands still, the picture is as fine as can be, once nothing has changed for a moment.
    this.tellWhy();
    this.painter.heat = this.floorMap();
    this.painter.draw(this.view, Boolean(fine), this.options.marks ? this.time : null);
    this.fine = this.playing || fine ? 0 : this.last + 150;
    this.overlay.draw(this.view, moment, this.time, { ...this.options, selected: this.selected, dark: this.dark.matches, late: this.painter.late });
    this.panel.update(this.selected, this.time, moment.before);
    this.timeline.draw(this.time, this.selected);
    element('scrub').value = this.time;
    element('camera').value = this.coming ?? this.camera.choice;
    element('clock').textContent = `${this.time.toFixed(2)} s, ${scene.kind === 'bvh' ? 'frame' : 'control frame'} ${Math.floor(this.time * scene.rate + 1e-4)}`;
    this.drawn = (this.drawn || 0) + 1;
    document.documentElement.dataset.state = 'shown';
  }
}
