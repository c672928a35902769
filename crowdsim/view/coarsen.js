// Coarser meshes of skins, for avatars that are small in the picture: edges collapse where the surface changes least.

const LEAST_CHANGE = 1e-10, NEXT_CHANGE = 4, MOST_CHANGE = 1e-2; // how much a surface may change at first, how many times as much next, and at most [m^4]

// Coarser meshes of triangles, each made of the one before: what has at most so many triangles, by ascending `counts` from
// the last one on. Vertices stay where they are; lines between parts of triangles stay, too.
function coarsen(vertices, triangles, parts, counts) {
  const count = vertices.length / 3, corners = Int32Array.from(triangles), labels = Uint8Array.from(parts), found = [];
  const masks = new Int32Array(count), starts = new Int32Array(count + 1), touched = new Uint8Array(count), seen = new Int32Array(count);
  const around = new Int32Array(corners.length), planes = new Float64Array(4 * labels.length);
  let faces = labels.length, stamp = 0;

  // The normal of a triangle, twice as long as its area, and that length.
  function plane(out, o, a, b, c) {
    const i = 3 * a, j = 3 * b, k = 3 * c, px = vertices[i], py = vertices[i + 1], pz = vertices[i + 2];
    const ux = vertices[j] - px, uy = vertices[j + 1] - py, uz = vertices[j + 2] - pz;
    const vx = vertices[k] - px, vy = vertices[k + 1] - py, vz = vertices[k + 2] - pz;
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    out[o] = x; out[o + 1] = y; out[o + 2] = z; out[o + 3] = Math.sqrt(x * x + y * y + z * z);
  }

  // Which triangles are around each vertex, and of which parts they are.
  function gather() {
    for (const array of [masks, starts, touched]) array.fill(0);
    for (let i = 0; i < 3 * faces; i++) starts[corners[i]]++;
    for (let i = 0, sum = 0; i <= count; i++) starts[i] = sum += starts[i];
    for (let f = 0; f < faces; f++) {
      plane(planes, 4 * f, corners[3 * f], corners[3 * f + 1], corners[3 * f + 2]);
      for (let i = 3 * f; i < 3 * f + 3; i++) {
        masks[corners[i]] |= 1 << labels[f];
        around[--starts[corners[i]]] = f;
      }
    }
  }

  // How far a vertex is from the planes around another one, which would move to it, and a little of how far from that.
  function change(a, b) {
    const x = vertices[3 * b] - vertices[3 * a], y = vertices[3 * b + 1] - vertices[3 * a + 1], z = vertices[3 * b + 2] - vertices[3 * a + 2];
    let sum = 1e-3 * (x * x + y * y + z * z) ** 2;
    for (let k = starts[a]; k < starts[a + 1]; k++) {
      const o = 4 * around[k], away = planes[o] * x + planes[o + 1] * y + planes[o + 2] * z;
      sum += away * away / Math.max(planes[o + 3], 1e-12);
    }
    return sum;
  }

  // Whether a surface without folds is left when a vertex moves to another one: two triangles at their edge, which differ
  // on a line of parts, and no other neighbours in common.
  const moved = new Float64Array(4);
  function collapsible(a, b) {
    let shared = 0, kinds = 0, common = 0;
    stamp++;
    for (let k = starts[a]; k < starts[a + 1]; k++) {
      const t = 3 * around[k], i = corners[t], j = corners[t + 1], l = corners[t + 2];
      seen[i] = seen[j] = seen[l] = stamp;
      if (i === b || j === b || l === b) {
        shared++;
        kinds |= 1 << labels[around[k]];
        continue;
      }
      plane(moved, 0, i === a ? b : i, j === a ? b : j, l === a ? b : l);
      const o = 4 * around[k];
      if (moved[0] * planes[o] + moved[1] * planes[o + 1] + moved[2] * planes[o + 2] < 0.3 * moved[3] * planes[o + 3]) return false;
    }
    if (shared !== 2 || masks[a] & masks[a] - 1 && kinds !== masks[a]) return false;
    for (let k = starts[b]; k < starts[b + 1]; k++) {
      for (let c = 3 * around[k]; c < 3 * around[k] + 3; c++) {
        const other = corners[c];
        if (other === a || other === b || seen[other] !== stamp) continue;
        seen[other] = 0;
        common++;
      }
    }
    return common === 2;
  }

  for (let limit = LEAST_CHANGE; counts.length > found.length && limit < MOST_CHANGE;) {
    const goal = counts[found.length];
    const before = faces;
    let left = faces;
    gather();
    for (let i = 0; i < 3 * faces && left > goal; i++) {
      const a = corners[i], b = corners[i % 3 === 2 ? i - 2 : i + 1];
      if (touched[a] || touched[b] || masks[a] & ~masks[b] || change(a, b) > limit || !collapsible(a, b)) continue;
      for (const end of [a, b])
        for (let k = starts[end]; k < starts[end + 1]; k++)
          for (let c = 3 * around[k]; c < 3 * around[k] + 3; c++) touched[corners[c]] = 1;
      for (let k = starts[a]; k < starts[a + 1]; k++)
        for (let c = 3 * around[k]; c < 3 * around[k] + 3; c++) if (corners[c] === a) corners[c] = b;
      left -= 2;
    }
    let kept = 0;
    for (let f = 0; f < faces; f++) {
      const a = corners[3 * f], b = corners[3 * f + 1], c = corners[3 * f + 2];
      if (a === b || b === c || c === a) continue;
      labels[kept] = labels[f];
      corners[3 * kept] = a; corners[3 * kept + 1] = b; corners[3 * kept + 2] = c;
      kept++;
    }
    faces = kept;
    if (left > 0.9 * before) limit *= NEXT_CHANGE;
    if (left <= goal) found.push([corners.slice(0, 3 * faces), labels.slice(0, faces)]);
  }
  // A surface that changes too much stays finer than wanted.
  while (found.length < counts.length) found.push([corners.slice(0, 3 * faces), labels.slice(0, faces)]);
  return found;
}
