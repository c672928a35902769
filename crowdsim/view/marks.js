// What lies over the picture: names and health, contacts, joints, and which avatar is chosen.

// Teams are told apart by these too, not by colour alone.
const SYMBOLS = ['circle', 'triangle', 'square', 'diamond', 'star', 'cross', 'ring', 'down', 'hexagon', 'bar'];
const LEAST_BARRED = 34, BAR = [0.4, 34]; // how tall avatars with bars of health are [px]; how wide bars are for that, and at most [px]
const MOST_NAMES = 80, TRAIL = 3, TRAIL_STEP = 0.1; // seconds of trails, and of their lines

function tracePath(ctx, symbol, x, y, r) {
  const polygon = (n, turn, inner) => {
    for (let i = 0; i < n; i++) {
      const a = turn + 2 * Math.PI * i / n, far = inner && i % 2 ? r * inner : r;
      ctx[i ? 'lineTo' : 'moveTo'](x + far * Math.sin(a), y - far * Math.cos(a));
    }
    ctx.closePath();
  };
  ctx.beginPath();
  if (symbol === 'circle' || symbol === 'ring') ctx.arc(x, y, r, 0, 2 * Math.PI);
  else if (symbol === 'triangle') polygon(3, 0);
  else if (symbol === 'down') polygon(3, Math.PI);
  else if (symbol === 'square') polygon(4, Math.PI / 4);
  else if (symbol === 'diamond') polygon(4, 0);
  else if (symbol === 'hexagon') polygon(6, 0);
  else if (symbol === 'star') polygon(10, 0, 0.45);
  else if (symbol === 'cross') polygon(8, 0, 0.35);
  else ctx.rect(x - r, y - r / 2.5, 2 * r, r / 1.25);
}

// Draws the symbol of a team; later teams than there are symbols have their numbers instead.
function drawSymbol(ctx, team, colour, x, y, r, edge) {
  tracePath(ctx, SYMBOLS[team % SYMBOLS.length], x, y, r);
  ctx.lineWidth = 1.5;
  ctx.strokeStyle = edge;
  if (SYMBOLS[team % SYMBOLS.length] === 'ring') {
    ctx.lineWidth = 4.5;
    ctx.stroke();
    ctx.lineWidth = 2.5;
    ctx.strokeStyle = colour;
    ctx.stroke();
    return;
  }
  ctx.fillStyle = colour;
  ctx.fill();
  ctx.stroke();
}

class Overlay {
  constructor(canvas, crowd, facts) {
    Object.assign(this, { canvas, crowd, facts, scene: crowd.scene, ctx: canvas.getContext('2d') });
  }

  draw(view, moment, seconds, options) {
    const { canvas, ctx } = this, { facts, scene } = this, shows = options.labels || options.trails || options.selected >= 0 || facts.canBeHurt;
    // A canvas that shows nothing is not there: putting it over the picture takes time, for which what is dragged does not wait.
    canvas.hidden = options.late ? !this.placing : !shows && !scene.tables.contact;
    if (canvas.hidden) return;
    const ratio = Math.min(devicePixelRatio, 2);
    const width = Math.round(view.width * ratio), height = Math.round(view.height * ratio);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.clearRect(0, 0, view.width, view.height);
    ctx.lineJoin = ctx.lineCap = 'round';
    this.ink = options.dark ? '#ffffff' : '#10131a';
    this.paper = options.dark ? '#101216d0' : '#ffffffd8';
    this.contacts(view, seconds);
    if (options.trails) this.trails(view, moment, options.selected);
    if (options.selected >= 0) this.selection(view, options.selected);
    if (this.placing) this.place(view, this.placing);
    if (options.joints && options.selected >= 0) this.joints(view, moment, options.selected);
    this.names(view, seconds, options);
  }

  // A circle on the floor as it is seen.
  floorRing(view, x, z, radius) {
    this.ctx.beginPath();
    for (let i = 0; i <= 32; i++) {
      const a = i * Math.PI / 16, p = view.project(x + radius * Math.sin(a), 0, z + radius * Math.cos(a));
      if (!p) return false;
      this.ctx[i ? 'lineTo' : 'moveTo'](p[0], p[1]);
    }
    return true;
  }

  // Paths over the floor of the last moments, as far as they are unpacked; of the chosen avatar, or of all that are seen.
  trails(view, moment, selected) {
    const { crowd, scene, ctx } = this, step = Math.max(1, Math.round(scene.fps * TRAIL_STEP)), rows = [];
    for (let frame = moment.before; frame >= Math.max(0, moment.before - TRAIL * scene.fps); frame -= step) {
      const known = crowd.recording.known(frame);
      if (!known) break;
      rows.push([frame, known.parts, known.row]);
    }
    ctx.lineWidth = 2.5;
    const avatars = selected >= 0 ? [selected] : scene.names.keys();
    for (const avatar of avatars) {
      if (!Number.isFinite(crowd.roots[3 * avatar])) continue;
      const index = scene.tables.figure[avatar], column = 3 * crowd.columns[avatar] * scene.figures[index].moving.length;
      let before = view.project(crowd.roots[3 * avatar], 0.01, crowd.roots[3 * avatar + 2]), line = 0;
      for (const [frame, parts, row] of rows) {
        if (!crowd.isPresent(avatar, frame)) break;
        const { places, placeStride } = parts[index], at = row * placeStride + column;
        const point = view.project(places[at], 0.01, places[at + 2]);
        if (before && point) {
          ctx.strokeStyle = this.ink;
          ctx.globalAlpha = 0.75 * (1 - line / rows.length);
          ctx.beginPath();
          ctx.moveTo(before[0], before[1]);
          ctx.lineTo(point[0], point[1]);
          ctx.stroke();
        }
        before = point;
        line++;
      }
    }
    ctx.globalAlpha = 1;
  }

  selection(view, avatar) {
    const { roots } = this.crowd, ctx = this.ctx;
    if (!Number.isFinite(roots[3 * avatar]) || !this.floorRing(view, roots[3 * avatar], roots[3 * avatar + 2], 0.55)) return;
    for (const [width, colour] of [[5, '#000000b0'], [2.5, '#ffffff']]) {
      ctx.lineWidth = width;
      ctx.strokeStyle = colour;
      ctx.stroke();
    }
  }

  // Where an avatar would be put that is dragged: a dashed line from it to a ring with a cross.
  place(view, { avatar, at: [x, , z] }) {
    const { ctx, crowd: { roots } } = this, from = view.project(roots[3 * avatar], 0.02, roots[3 * avatar + 2]);
    const arm = (dx, dz) => [view.project(x - dx, 0.02, z - dz), view.project(x + dx, 0.02, z + dz)];
    for (const [width, colour] of [[5, '#000000b0'], [2.5, '#ffffff']]) {
      Object.assign(ctx, { lineWidth: width, strokeStyle: colour });
      if (this.floorRing(view, x, z, 0.3)) ctx.stroke();
      for (const [a, b] of [arm(0.12, 0), arm(0, 0.12), [from, view.project(x, 0.02, z)]]) {
        if (!a || !b) continue;
        ctx.setLineDash(a === from ? [8, 6] : []);
        ctx.beginPath();
        ctx.moveTo(a[0], a[1]);
        ctx.lineTo(b[0], b[1]);
        ctx.stroke();
      }
      ctx.setLineDash([]);
    }
  }

  contacts(view, seconds) {
    const { contact, contact_time: times } = this.scene.tables;
    if (!contact) return;
    for (let i = 0; i < contact.length / 2; i++) {
      if (times[2 * i] > seconds || times[2 * i + 1] <= seconds) continue;
      const avatar = contact[2 * i], feet = this.crowd.feet && this.crowd.feet[avatar];
      if (!feet) continue;
      const [x, , z] = feet[contact[2 * i + 1]];
      if (!this.floorRing(view, x, z, 0.13)) continue;
      this.ctx.lineWidth = 2;
      this.ctx.strokeStyle = '#ffffff';
      this.ctx.stroke();
      this.ctx.fillStyle = '#1f9fffa0';
      this.ctx.fill();
    }
  }

  joints(view, moment, avatar) {
    const { crowd, ctx } = this, figure = this.scene.figures[this.scene.tables.figure[avatar]];
    if (!crowd.pose(avatar, moment)) return;
    const points = figure.joints.map((_, j) => view.project(...crowd.positions.subarray(3 * j, 3 * j + 3)));
    ctx.lineWidth = 2;
    ctx.strokeStyle = '#ffffff';
    ctx.beginPath();
    figure.parents.forEach((parent, j) => {
      if (parent < 0 || !points[j] || !points[parent]) return;
      ctx.moveTo(points[parent][0], points[parent][1]);
      ctx.lineTo(points[j][0], points[j][1]);
    });
    ctx.stroke();
    ctx.font = '11px system-ui, sans-serif';
    ctx.textAlign = 'left';
    ctx.textBaseline = 'middle';
    figure.joints.forEach((name, j) => {
      if (!points[j]) return;
      const [x, y] = points[j];
      ctx.fillStyle = this.ink;
      ctx.fillRect(x - 2.5, y - 2.5, 5, 5);
      this.text(name, x + 6, y);
    });
  }

  text(text, x, y) {
    this.ctx.lineWidth = 3;
    this.ctx.strokeStyle = this.paper;
    this.ctx.strokeText(text, x, y);
    this.ctx.fillStyle = this.ink;
    this.ctx.fillText(text, x, y);
  }

  names(view, seconds, options) {
    const { crowd, ctx, scene, facts } = this, found = [];
    const bars = facts.canBeHurt;
    if (!options.labels && !bars && options.selected < 0) return;
    for (let avatar = 0; avatar < crowd.count; avatar++) {
      const i = 3 * avatar;
      if (!Number.isFinite(crowd.heads[i])) continue;
      const p = view.project(crowd.heads[i], crowd.heads[i + 1] + 0.2, crowd.heads[i + 2]);
      if (p && p[0] > -50 && p[0] < view.width + 50 && p[1] > 0 && p[1] < view.height + 20) found.push([p, avatar]);
    }
    found.sort(([p, a], [q, b]) => (b === options.selected) - (a === options.selected) || p[2] - q[2]);
    const taken = [];
    ctx.font = '12px system-ui, sans-serif';
    ctx.textAlign = 'left';
    ctx.textBaseline = 'alphabetic';
    for (const [[x, y, depth], avatar] of found.slice(0, 4 * MOST_NAMES)) {
      const tall = scene.tables.height[avatar] * view.focal / Math.max(depth, 0.3), bar = clamp(BAR[0] * tall, 0, BAR[1]);
      const chosen = avatar === options.selected, named = chosen || options.labels, full = chosen || tall > LEAST_BARRED ? scene.tables.health?.[2 * avatar] : 0;
      const name = scene.names[avatar].slice(0, 40), wide = named ? ctx.measureText(name).width + (facts.hasTeams ? 14 : 0) : bar;
      const box = [x - wide / 2 - 2, y - 20, x + wide / 2 + 2, y + 4];
      if (!chosen && (taken.length >= MOST_NAMES
        || taken.some(one => one[0] < box[2] && box[0] < one[2] && one[1] < box[3] && box[1] < one[3]))) continue;
      if (!named && !(full > 0)) continue;
      taken.push(box);
      if (named) {
        let left = x - wide / 2;
        if (facts.hasTeams) {
          drawSymbol(ctx, scene.tables.team[avatar], facts.colourOf(avatar), left + 5, y - 10, 5, this.ink);
          left += 14;
        }
        this.text(name, left, y - 6);
      }
      if (full > 0) {
        const share = facts.health(avatar, seconds) / full;
        ctx.fillStyle = '#000000c0';
        const wide = Math.max(bar, 12), thick = wide > 24 ? 4 : 2;
        ctx.fillRect(x - wide / 2, y - 3, wide, thick + 2);
        ctx.fillStyle = share > 0.5 ? '#7be07b' : share > 0.2 ? '#ffd24d' : '#ff7a66';
        ctx.fillRect(x - wide / 2 + 1, y - 2, (wide - 2) * share, thick);
      }
    }
  }
}
