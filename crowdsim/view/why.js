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
    const path = `why/${numbers[avatar]}/${t.action_frame[row]}`;
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

class ReasonPanel {
  constructor(facts) { Object.assign(this, { facts, scene: facts.scene, shown: null }); }

  // Shows a decision, or that it is being looked for.
  show(decision) {
    if (decision === this.shown) return;
    this.shown = decision;
    const place = element('why-text');
    if (!decision) return place.replaceChildren(make('p', 'Its next decision will show.'));
    if (decision.error) return place.replaceChildren(make('p', decision.error));
    const { frame, opponent, count, forced, terms, options } = decision, { rate, numbers } = this.scene;
    if (forced && !count) return place.replaceChildren(make('p', `At ${(frame / rate).toFixed(2)} s (control frame ${frame}) it is knocked down.`));
    const about = opponent < 0 ? this.facts.nameOf(opponent) : this.facts.nameOf(numbers ? numbers.indexOf(opponent) : opponent);
    const head = make('p', `At ${(frame / rate).toFixed(2)} s (control frame ${frame}), about ${about}: ${count} action${count === 1 ? '' : 's'}.`);
    if (forced) head.append(' It falls, rests or gets up, whatever these are worth.');
    const best = options[0]?.value ?? 0, rows = options.map(one => {
      const told = terms.map((term, t) => [term, one.parts[t]]).filter(([, part]) => Math.abs(part) >= 0.005);
      const parts = told.map(([term, part]) => `${term} ${part < 0 ? '−' : '+'}${Math.abs(part).toFixed(2)}`).join(', ');
      const mark = one.taken ? '▶' : one.drawn ? '○' : '';
      const row = make('tr', '', make('td', mark), make('td', `${one.clip} ${one.place}`), make('td', (one.value - best).toFixed(2)));
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
