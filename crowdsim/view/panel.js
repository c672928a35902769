// What there is to know of the avatars, and the elements that show it.

const OUTSIDE = -1000000, HEAT = 256; // HEAT: squares of the heat map along a side

class Facts {
  constructor(scene) {
    this.scene = scene;
    const t = scene.tables;
    this.hasTeams = scene.teams.length > 1;
    this.canBeHurt = Boolean(t.health && t.health.some(value => value > 0));
    // Strikes of each avatar, thrown and received, in the order of time.
    this.thrown = Array.from({ length: scene.names.length }, () => []);
    this.received = Array.from({ length: scene.names.length }, () => []);
    t.strike_time.forEach((_, i) => {
      if (t.strike_attacker[i] >= 0) this.thrown[t.strike_attacker[i]].push(i);
      if (t.strike_victim[i] >= 0) this.received[t.strike_victim[i]].push(i);
    });
    this.healed = Array.from({ length: scene.names.length }, () => []);
    (t.heal_time || []).forEach((time, i) => this.healed[t.heal_avatar[i]].push(time));
    this.landed = [];
    t.strike_time.forEach((_, i) => { if (this.hasHit(i)) this.landed.push(i); });
    this.downs = Array.from({ length: scene.names.length }, () => []);
    (t.down_avatar || []).forEach((avatar, i) => this.downs[avatar].push([t.down_time[2 * i], t.down_time[2 * i + 1]]));
  }

  outcome(strike) { return this.scene.outcomes[this.scene.tables.strike_outcome[strike]]; }
  hasHit(strike) { return ['landed', 'thrown'].includes(this.outcome(strike)); }

  nameOf(avatar) {
    const { names, targets } = this.scene;
    if (avatar === OUTSIDE) return 'an avatar that is not in this recording';
    if (avatar <= -2) return targets[-2 - avatar] ?? 'a target';
    return avatar < 0 ? 'nobody' : names[avatar];
  }

  colourOf(avatar) { return `rgb(${this.scene.team_colours[this.scene.tables.team[avatar]]})`; }

  // Health at a time: what it began with, or what was restored, less what strikes have taken since.
  health(avatar, seconds) {
    const t = this.scene.tables;
    let left = t.health[2 * avatar + 1], since = -Infinity;
    for (const healed of this.healed[avatar]) if (healed <= seconds) [left, since] = [t.health[2 * avatar], healed];
    for (const strike of this.received[avatar]) {
      if (t.strike_time[strike] > seconds) break;
      if (t.strike_time[strike] <= since) continue;
      left = Math.max(left - t.strike_damage[strike], 0);
    }
    return left;
  }

  isDown(avatar, seconds) { return this.downs[avatar].some(([start, stop]) => start <= seconds && seconds < stop); }

  // Where strikes have landed up to a time: counts in squares over the floor, spread a little, and the greatest of them.
  heat(seconds) {
    const t = this.scene.tables, { landed } = this, count = placeAfter(landed.map(one => t.strike_time[one]), seconds);
    if (this.heated && this.heated.count === count) return this.heated;
    if (!this.heated) {
      const x = landed.map(one => t.strike_point[3 * one]), z = landed.map(one => t.strike_point[3 * one + 2]);
      const low = [Math.min(...x, 0) - 1, Math.min(...z, 0) - 1], high = [Math.max(...x, 0) + 1, Math.max(...z, 0) + 1];
      this.heatBox = [...low, ...high.map((value, i) => value - low[i])];
    }
    const [left, top, wide, deep] = this.heatBox, cell = Math.max(0.2, wide / HEAT, deep / HEAT), squares = new Float32Array(HEAT * HEAT);
    let most = 0;
    for (const one of landed.slice(0, count)) {
      const column = Math.floor((t.strike_point[3 * one] - left) / cell), row = Math.floor((t.strike_point[3 * one + 2] - top) / cell);
      for (let dz = -2; dz <= 2; dz++) for (let dx = -2; dx <= 2; dx++) {
        const at = (row + dz) * HEAT + column + dx;
        if (row + dz < 0 || row + dz >= HEAT || column + dx < 0 || column + dx >= HEAT) continue;
        squares[at] += Math.exp(-0.5 * (dx * dx + dz * dz));
        most = Math.max(most, squares[at]);
      }
    }
    const bytes = Uint8Array.from(squares, value => 255 * Math.sqrt(value / Math.max(most, 1)));
    this.heated = { count, bytes, box: [left, top, cell * HEAT, cell * HEAT] };
    return this.heated;
  }

  // What an avatar does: action, its clip, the frame of the clip and the time in it.
  action(avatar, seconds) {
    const { tables: t, rate, figures, clips } = this.scene;
    if (!t.action_offset) return null;
    const control = seconds * rate, row = rowAt(t.action_offset, t.action_frame, avatar, Math.floor(control + 1e-6));
    if (row < 0 || t.action_table[4 * t.action_row[row]] < 0) return null;
    const [number, clip, start, stride] = t.action_table.subarray(4 * t.action_row[row], 4 * t.action_row[row] + 4);
    const done = t.action_phase[row] + (control - t.action_frame[row]) * t.speed[avatar];
    const frame = Math.floor(start + Math.max(done, 0) * stride + 1e-3);
    return { number, clip: clips[clip], frame, seconds: frame / (rate * stride), figure: figures[t.figure[avatar]] };
  }

  opponent(avatar, seconds) {
    const { tables: t, rate } = this.scene;
    if (!t.opponent_offset) return null;
    const row = rowAt(t.opponent_offset, t.opponent_frame, avatar, Math.floor(seconds * rate + 1e-6));
    return row < 0 ? -1 : t.opponent[row];
  }

  strikeText(strike, avatar) {
    const { tables: t, limbs } = this.scene, limb = limbs[t.strike_limb[strike]].replace('_', ' ');
    const by = t.strike_attacker[strike], at = t.strike_victim[strike], damage = t.strike_damage[strike];
    const what = by === avatar ? `${limb}${at === -1 ? '' : ` at ${this.nameOf(at)}`}` : `${limb} of ${this.nameOf(by)}`;
    const more = `${t.strike_speed[strike].toFixed(1)} m/s${damage ? `, ${damage.toFixed(0)} points` : ''}`;
    const down = t.strike_down[strike] ? ', down' : '';
    return `${t.strike_time[strike].toFixed(2)} s  ${by === avatar ? '→' : '←'} ${what}: ${this.outcome(strike)}${down} (${more})`;
  }
}

// Makes an element with text, never with markup.
function make(tag, text, ...inside) {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  made.append(...inside);
  return made;
}

function list(pairs) {
  const made = make('dl');
  for (const [term, text] of pairs) made.append(make('dt', term), make('dd', text));
  return made;
}

class Panel {
  constructor(crowd, facts) {
    Object.assign(this, { crowd, facts, scene: crowd.scene, shown: '', stood: '' });
    const { names, frames, fps, kind, seed } = this.scene, t = this.scene.tables;
    document.title = element('title').textContent = this.scene.name;
    const strikes = t.strike_time.length, landed = facts.landed.length, many = (n, word) => `${n.toLocaleString('en')} ${word}${n === 1 ? '' : 's'}`;
    const words = [many(names.length, kind === 'bvh' ? 'figure' : 'avatar'), `${(frames / fps).toFixed(1)} s`];
    if (strikes) words.push(kind === 'bvh' ? many(strikes, 'strike') : `${many(strikes, 'strike')}, ${landed.toLocaleString('en')} landed`);
    if (seed !== undefined) words.push(`seed ${seed}`);
    element('summary').textContent = words.join(' · ');
    const avatars = element('avatar');
    names.forEach((name, i) => { avatars.append(new Option(name, i)); });
    if (facts.hasTeams && this.scene.teams.length <= 40) this.teams();
  }

  // A table of teams: symbol and colour, avatars that are there, of them down, strikes landed so far.
  teams() {
    const { teams } = this.scene, body = make('tbody'), section = element('teams');
    this.rows = teams.map((name, team) => {
      const swatch = make('canvas'), cells = [make('td'), make('td'), make('td')];
      swatch.className = 'swatch';
      swatch.setAttribute('aria-hidden', 'true');
      Object.assign(swatch, { width: 30, height: 30 });
      const ctx = swatch.getContext('2d'), ink = getComputedStyle(document.body).color;
      ctx.scale(2, 2);
      drawSymbol(ctx, team, `rgb(${this.scene.team_colours[team]})`, 7.5, 7.5, 6, ink);
      body.append(make('tr', '', make('td', '', swatch), make('th', name), ...cells));
      return cells;
    });
    const head = make('tr', '', ...['', 'team', 'there', 'down', 'landed'].map(text => make('th', text)));
    section.append(make('table', '', make('thead', '', head), body));
  }

  update(avatar, seconds, frame) {
    const { facts, scene } = this;
    if (this.rows) {
      const counts = scene.teams.map(() => [0, 0, 0]), t = scene.tables;
      t.team.forEach((team, one) => {
        if (this.crowd.isPresent(one, frame)) counts[team][0]++;
        if (facts.isDown(one, seconds)) counts[team][1]++;
      });
      for (const strike of facts.landed) {
        if (t.strike_time[strike] > seconds) break;
        if (t.strike_attacker[strike] >= 0) counts[t.team[t.strike_attacker[strike]]][2]++;
      }
      const stood = counts.flat().join();
      if (stood !== this.stood) counts.forEach((row, team) => row.forEach((value, i) => { this.rows[team][i].textContent = value; }));
      this.stood = stood;
    }
    const section = element('details');
    if (avatar < 0) {
      if (this.shown) section.replaceChildren();
      this.shown = '';
      return;
    }
    const t = scene.tables, pairs = [], there = this.crowd.isPresent(avatar, frame);
    if (scene.kind === 'run') {
      const action = facts.action(avatar, seconds), opponent = facts.opponent(avatar, seconds);
      pairs.push(['team', scene.teams[t.team[avatar]]], ['type', scene.types[t.type[avatar]]]);
      if (!there) pairs.push(['state', 'not there at this time']);
      else {
        pairs.push(['state', facts.isDown(avatar, seconds) ? 'down' : 'up'], ['opponent', facts.nameOf(opponent)]);
        if (action) {
          pairs.push(['action', `${action.number}`], ['clip', action.clip]);
          pairs.push(['clip frame', `${action.frame} (${action.seconds.toFixed(2)} s)`]);
        }
      }
      const full = t.health[2 * avatar];
      if (full > 0) pairs.push(['health', `${facts.health(avatar, seconds).toFixed(0)} of ${full.toFixed(0)}`]);
    } else {
      const figure = scene.figures[t.figure[avatar]], feet = this.crowd.feet?.[avatar];
      pairs.push(['joints', `${figure.joints.length} (J shows their names)`]);
      if (!there) pairs.push(['state', 'not there at this time']);
      else if (feet) pairs.push(['planted', this.planted(avatar, seconds)]);
    }
    const strikes = [...facts.thrown[avatar], ...facts.received[avatar]].filter(one => t.strike_time[one] <= seconds)
      .sort((a, b) => t.strike_time[b] - t.strike_time[a]).slice(0, 6).map(one => facts.strikeText(one, avatar));
    const shown = JSON.stringify([avatar, pairs, strikes]);
    if (shown === this.shown) return;
    this.shown = shown;
    section.replaceChildren(make('h2', scene.names[avatar]), list(pairs));
    if (strikes.length) section.append(make('h3', 'Last strikes (→ thrown, ← received)'), make('ol', '', ...strikes.map(text => make('li', text))));
  }

  planted(avatar, seconds) {
    const { contact, contact_time: times } = this.scene.tables, feet = [];
    for (let i = 0; i < contact.length / 2; i++)
      if (contact[2 * i] === avatar && times[2 * i] <= seconds && seconds < times[2 * i + 1]) feet.push(['left', 'right'][contact[2 * i + 1]]);
    return feet.length ? `${feet.join(' and ')} foot` : 'no foot';
  }
}

// The timeline: strikes landed as bars, avatars going down as marks above them.
class Timeline {
  constructor(canvas, facts) {
    Object.assign(this, { canvas, facts, scene: facts.scene, drawn: '' });
    const { fps, first, frames } = this.scene;
    this.start = first / fps;
    this.end = (first + Math.max(frames - 1, 1)) / fps;
  }

  // Where both ends of a range input's thumb lie [px].
  get margin() { return 8; }

  x(seconds, width) { return this.margin + (width - 2 * this.margin) * (seconds - this.start) / (this.end - this.start); }

  at(x, width) {
    return clamp(this.start + (x - this.margin) / (width - 2 * this.margin) * (this.end - this.start), this.start, this.end);
  }

  events(avatar) {
    const t = this.scene.tables, { facts } = this;
    const strikes = avatar < 0 ? facts.landed : facts.landed.filter(one => t.strike_attacker[one] === avatar || t.strike_victim[one] === avatar);
    const downs = [];
    (t.down_avatar || []).forEach((one, i) => { if (avatar < 0 || one === avatar) downs.push(t.down_time[2 * i]); });
    return { strikes: strikes.map(one => t.strike_time[one]), downs };
  }

  draw(seconds, avatar) {
    const { canvas } = this, ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
    const colours = getComputedStyle(document.documentElement), colour = name => colours.getPropertyValue(name);
    element('now').style.transform = `translateX(${this.x(seconds, width) - 0.75}px)`;
    const drawn = [width, ratio, avatar, colour('--text')].join();
    if (drawn === this.drawn || !width) return;
    this.drawn = drawn;
    Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    const ctx = canvas.getContext('2d'), { strikes, downs } = this.events(avatar), bins = Math.floor(width / 4), counts = new Float32Array(bins);
    ctx.scale(ratio, ratio);
    for (const time of strikes) counts[clamp(Math.floor(this.x(time, width) / width * bins), 0, bins - 1)]++;
    const most = Math.max(1, ...counts), top = 14;
    ctx.fillStyle = colour('--line');
    ctx.fillRect(this.margin, height - 1, width - 2 * this.margin, 1);
    ctx.fillStyle = colour('--landed');
    counts.forEach((count, i) => {
      const tall = count ? 3 + (height - top - 4) * count / most : 0;
      ctx.fillRect(i * width / bins, height - tall, width / bins - 1, tall);
    });
    ctx.fillStyle = colour('--down');
    for (const time of downs) {
      tracePath(ctx, 'down', this.x(time, width), 6, 5);
      ctx.fill();
    }
  }

  // The event near a place, to jump to a little before it; else the time there.
  jump(x, width, avatar) {
    const { strikes, downs } = this.events(avatar), time = this.at(x, width), slack = 5 * (this.end - this.start) / width;
    let best = time, gap = slack;
    for (const one of [...downs, ...strikes]) if (Math.abs(one - time) < gap) [best, gap] = [one, Math.abs(one - time)];
    return best;
  }
}
