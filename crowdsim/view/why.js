// Why avatars do what they do: their decisions, and the elements that show them.

// Decisions in the page itself, of some avatars.
class PageReasons {
  constructor(scene, decisions) { Object.assign(this, { scene, decisions }); }

  knows(avatar) { return Object.hasOwn(this.decisions, this.scene.numbers[avatar]); }

  find(avatar, control) {
    const own = this.decisions[this.scene.numbers[avatar]], place = placeAfter(own.map(one => one.frame), control) - 1;
    return place < 0 ? { error: 'It has decided nothing up to now.' } : own[place];
  }
}

// Decisions that a server finds by simulating the run again.
class ServedReasons {
  constructor(scene, came) { Object.assign(this, { scene, came, found: new Map() }); }

  knows() { return true; }

  find(avatar, control) {
    const { tables: t, numbers } = this.scene, row = rowAt(t.action_offset, t.action_frame, avatar, control);
    if (row < 0) return { error: 'It is not there.' };
    return this.get(`why/${numbers[avatar]}/${t.action_frame[row]}`);
  }

  get(path) {
    if (!this.found.has(path)) {
      this.found.set(path, null);
      fetch(path, { cache: 'no-store' }).then(async answer => (answer.ok ? answer.json() : { error: await answer.text() }))
        .catch(() => ({ error: 'The connection is lost.' })).then(found => { this.found.set(path, found); this.came(); });
    }
    return this.found.get(path);
  }
}

// Decisions as they are made live.
class LiveReasons {
  constructor() { this.decisions = []; }

  knows() { return true; }

  add(decision) {
    this.decisions.push(decision);
    if (this.decisions.length > 100) this.decisions.shift();
  }

  find(avatar, control) { return this.decisions.findLast(one => one.avatar === avatar && one.frame <= control) ?? null; }
}

// Value maps of an avatar: what its next action is worth by where its opponent stands.
class ServedValues extends ServedReasons {
  find(avatar, control) {
    const { tables: t, numbers } = this.scene, row = rowAt(t.action_offset, t.action_frame, avatar, control);
    return row < 0 ? null : this.get(`values/${numbers[avatar]}/${t.action_frame[row]}`);
  }
}

class ValuePanel {
  // Shows how values are to be read; `found` is a map, null while it is being looked for.
  show(found) {
    const place = element('values-text');
    if (found === this.shown) return;
    this.shown = found;
    if (!found?.values) {
      const text = found?.error ?? (found ? 'It decides nothing now.' : 'Being looked for ...');
      return place.replaceChildren(make('p', text));
    }
    const least = Math.min(...found.values), most = Math.max(...found.values), bar = make('canvas');
    Object.assign(bar, { width: 200, height: 12, className: 'ramp' });
    const ctx = bar.getContext('2d');
    for (let x = 0; x < 200; x++) {
      ctx.fillStyle = `rgb(${valueColour(x / 199).map(one => Math.round(255 * Math.sqrt(one)))})`;
      ctx.fillRect(x, 0, 1, 12);
    }
    const ends = make('p', '', make('span', least.toFixed(2)), bar, make('span', most.toFixed(2)));
    ends.className = 'legend';
    place.replaceChildren(ends, make('p', 'What its next action is worth, by where its opponent would stand then: lighter is more.'));
  }
}

// From dark blue to light yellow, ever lighter; linear light, as the floor's shader has it.
function valueColour(share) {
  const stops = [[0.006, 0.01, 0.07], [0.02, 0.09, 0.2], [0.1, 0.3, 0.25], [0.45, 0.6, 0.2], [1, 0.92, 0.5]];
  const at = clamp(share, 0, 1) * 4, low = Math.min(Math.floor(at), 3), part = at - low;
  return stops[low].map((one, i) => one * (1 - part) + stops[low + 1][i] * part);
}

// A value map as squares of the floor around it.
function rasterValues({ at: [x, z, heading], distances, bearings, values }) {
  const far = distances[distances.length - 1], side = 2 * far / HEAT, bytes = new Uint8Array(HEAT * HEAT), n = bearings.length;
  const least = Math.min(...values), over = 255 / Math.max(Math.max(...values) - least, 1e-9), circle = 2 * Math.PI;
  for (let row = 0, i = 0; row < HEAT; row++) for (let column = 0; column < HEAT; column++, i++) {
    const dx = (column + 0.5) * side - far, dz = (row + 0.5) * side - far, away = Math.hypot(dx, dz);
    const high = clamp(placeAfter(distances, away), 1, distances.length - 1), part = clamp((away - distances[high - 1]) / (distances[high] - distances[high - 1]), 0, 1);
    // Bearings go once around, the last step to the first one may be another than the rest.
    const aside = bearings[0] + ((Math.atan2(dx, dz) - heading - bearings[0]) % circle + circle) % circle;
    const left = placeAfter(bearings, aside) - 1, right = (left + 1) % n, next = right ? bearings[right] : bearings[0] + circle;
    const share = (aside - bearings[left]) / (next - bearings[left]);
    const of = d => values[d * n + left] * (1 - share) + values[d * n + right] * share;
    bytes[i] = Math.round(over * (of(high - 1) * (1 - part) + of(high) * part - least));
  }
  return { bytes, box: [x - far, z - far, 2 * far, 2 * far], isValues: true };
}

// Value maps as they come live; the first one that is asked for is ahead of the picture.
class LiveValues extends LiveReasons {
  find(avatar, control) { return super.find(avatar, control) ?? this.decisions.find(one => one.avatar === avatar) ?? null; }
}

class ReasonPanel {
  constructor(facts) { Object.assign(this, { facts, scene: facts.scene }); }

  // Shows a decision, or that it is being looked for.
  show(decision) {
    if (decision === this.shown) return;
    this.shown = decision;
    const place = element('why-text');
    if (!decision) return place.replaceChildren(make('p', 'Its next decision will show.'));
    if (decision.error) return place.replaceChildren(make('p', decision.error));
    const { frame, opponent, count, forced, terms, options } = decision, { rate, numbers } = this.scene;
    if (forced && !count) return place.replaceChildren(make('p', `At ${(frame / rate).toFixed(2)} s (control frame ${frame}) it is knocked down.`));
    const number = opponent < 0 || !numbers ? opponent : numbers.indexOf(opponent);
    const about = this.facts.nameOf(opponent >= 0 && number < 0 ? OUTSIDE : number);
    const head = make('p', `At ${(frame / rate).toFixed(2)} s (control frame ${frame}), about ${about}: ${count} action${count === 1 ? '' : 's'}.`);
    if (forced) head.append(' It falls, rests or gets up, whatever these are worth.');
    const best = options[0]?.value ?? 0, rows = options.map(one => {
      const told = terms.map((term, t) => [term, one.parts[t]]).filter(([, part]) => Math.abs(part) >= 0.005);
      const parts = told.map(([term, part]) => `${term} ${part < 0 ? '−' : '+'}${Math.abs(part).toFixed(2)}`).join(', ');
      const mark = one.taken ? '▶' : one.drawn ? '○' : '';
      const row = make('tr', '', make('td', mark), make('td', `${one.clip} ${one.place}`), make('td', (one.value - best).toFixed(2).replace('-', '−')));
      row.title = `action ${one.action}, ${one.frames} frames of the clip from ${one.place} on, value ${one.value.toFixed(3)}`;
      row.className = one.taken ? 'taken' : '';
      const more = make('tr', '', make('td'), make('td', parts));
      more.lastChild.colSpan = 2;
      more.className = 'parts';
      return [row, more];
    });
    const titles = make('tr', '', ...['', 'clip, frame', 'value'].map(text => make('th', text)));
    place.replaceChildren(head, make('table', '', make('thead', '', titles), make('tbody', '', ...rows.flat())),
      make('p', '▶ taken, ○ drawn among; values are below the best one.'));
  }
}
