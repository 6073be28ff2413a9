// A brush: which splats are seen at a place of the picture, and the files that keep a painted part. MIT licence.

const CELL = 2; // pixels across a cell, in each of which the nearest solid splat is found
const SOLID = 77; // of 255, as in Python: splats that are a surface
const CURVE = 8, NEIGHBOUR = 3; // of the rows as far away on both sides of a splat, the one that is its fourth nearest
const NEAR = 3; // spacings and cells of a surface that what belongs to it lies from it; its splats hide one spacing around them
const WIDEST = 32; // cells that a splat hides on each side at most

// Where splats are, (N, 3) in the scene frame, and how far apart around each, (N,): rows follow a curve through space.
export function placed({ count, splats: { means, opacities }, meta: { frame: { scene_from_splat: frame } } }) {
  const places = new Float32Array(3 * count), spacing = new Float32Array(count), nearest = new Float64Array(NEIGHBOUR + 1);
  for (let i = 0; i < places.length; i += 3) {
    for (let k = 0; k < 3; k++) places[i + k] = frame[k][0] * means[i] + frame[k][1] * means[i + 1] + frame[k][2] * means[i + 2] + frame[k][3];
  }
  for (let n = 0; n < count; n++) {
    nearest.fill(Infinity);
    for (let m = Math.max(n - CURVE, 0); m <= Math.min(n + CURVE, count - 1); m++) {
      const far = Math.hypot(places[3 * m] - places[3 * n], places[3 * m + 1] - places[3 * n + 1], places[3 * m + 2] - places[3 * n + 2]);
      if (m === n || !(far < nearest[NEIGHBOUR])) continue;
      let to = NEIGHBOUR;
      for (; to > 0 && nearest[to - 1] > far; to--) nearest[to] = nearest[to - 1];
      nearest[to] = far;
    }
    spacing[n] = nearest[NEIGHBOUR];
  }
  return { count, places, spacing, opacities };
}

// What a camera sees of `placed` splats: those on the surface that is nearest. matrix: (16), columns first, from the scene to
// the clip space of a picture of width x height. Returns their rows, and a function that finds those under a brush on its way
// from a place {x, y} of it to another.
export function seen({ count, places, spacing, opacities }, matrix, width, height) {
  const across = Math.ceil(width / CELL), down = Math.ceil(height / CELL), front = new Float32Array(across * down).fill(Infinity), deep = new Float32Array(across * down);
  const x = new Float32Array(count), y = new Float32Array(count), far = new Float32Array(count), focal = Math.hypot(matrix[1], matrix[5], matrix[9]) * height / 2;
  for (let n = 0, i = 0; n < count; n++, i += 3) {
    const px = places[i], py = places[i + 1], pz = places[i + 2], depth = matrix[3] * px + matrix[7] * py + matrix[11] * pz + matrix[15];
    x[n] = (1 + (matrix[0] * px + matrix[4] * py + matrix[8] * pz + matrix[12]) / depth) * width / 2;
    y[n] = (1 - (matrix[1] * px + matrix[5] * py + matrix[9] * pz + matrix[13]) / depth) * height / 2;
    far[n] = x[n] >= 0 && x[n] < width && y[n] >= 0 && y[n] < height && depth > 0 ? depth : Infinity;
    if (!(depth > 0) || opacities[n] < SOLID) continue;
    const reach = Math.min(spacing[n] * focal / depth / CELL, WIDEST), column = x[n] / CELL, row = y[n] / CELL;
    for (let v = Math.max(Math.floor(row - reach), 0); v <= Math.min(row + reach, down - 1); v++) {
      for (let u = Math.max(Math.floor(column - reach), 0); u <= Math.min(column + reach, across - 1); u++) {
        const inside = Math.max(Math.abs(u + 0.5 - column) - 0.5, 0) ** 2 + Math.max(Math.abs(v + 0.5 - row) - 0.5, 0) ** 2 <= reach * reach;
        if (!inside || depth >= front[v * across + u]) continue;
        front[v * across + u] = depth;
        deep[v * across + u] = NEAR * (spacing[n] + CELL * depth / focal);
      }
    }
  }
  const rows = [];
  for (let n = 0; n < count; n++) {
    const cell = Math.floor(y[n] / CELL) * across + Math.floor(x[n] / CELL);
    if (far[n] < Infinity && Math.abs(far[n] - front[cell]) <= deep[cell]) rows.push(n);
  }
  const under = (from, to, radius) => {
    const dx = to.x - from.x, dy = to.y - from.y, length = dx * dx + dy * dy;
    return rows.filter((n) => {
      const share = length && Math.min(Math.max(((x[n] - from.x) * dx + (y[n] - from.y) * dy) / length, 0), 1);
      return (x[n] - from.x - share * dx) ** 2 + (y[n] - from.y - share * dy) ** 2 <= radius ** 2;
    });
  };
  return { rows, under };
}

// Begin a part: an entry with a name that none has; returns its number.
export function newPart(parts) {
  const taken = new Set(parts.entries.flatMap(({ name, kept }) => [name, kept?.file.replace(/\.npy$/, "")]));
  let number = 1;
  while (taken.has(`part${number}`)) number++;
  parts.before ??= parts.members.slice();
  parts.entries.push({ name: `part${number}`, exposure: 0, tint: [1, 1, 1], painted: true });
  return parts.entries.length;
}

// Put splats into a part, or back into what they were in before any were painted.
export function paint({ members, before }, rows, number, erase = false) {
  for (const n of rows) {
    if (!erase) members.set([number, 255], 2 * n);
    else if (members[2 * n] === number) members.set(before.subarray(2 * n, 2 * n + 2), 2 * n);
  }
}

// The painted parts as files for the folder of the scene: {name: bytes}. lights: {exposure, tint} of each entry.
export function partFiles({ entries, members, rows }, lights) {
  const files = {}, kept = entries.filter((entry) => entry.kept).map((entry) => entry.kept), text = (value) => new TextEncoder().encode(`${JSON.stringify(value, null, 1)}\n`);
  entries.forEach(({ name, painted }, index) => {
    const mask = new Uint8Array(rows.length);
    let splats = 0;
    for (let n = 0; painted && n < rows.length; n++) if (members[2 * n] === index + 1) splats += mask[rows[n]] = 1;
    if (!splats) return;
    files[`${name}.npy`] = npy(mask);
    const { exposure, tint } = lights[index], light = { ...(exposure ? { exposure } : {}), ...(tint.every((value) => value === 1) ? {} : { tint }) };
    kept.push({ name, file: `${name}.npy`, splats, ...(Object.keys(light).length ? { light } : {}) });
  });
  return Object.keys(files).length ? { ...files, "parts.json": text({ schema_version: 1, parts: kept }) } : files;
}

// A truth for each row as NumPy has it in a file.
function npy(mask) {
  const head = `{'descr': '|b1', 'fortran_order': False, 'shape': (${mask.length},), }`, size = Math.ceil((head.length + 11) / 64) * 64;
  const bytes = new Uint8Array(size + mask.length), put = (text, at) => bytes.set(Array.from(text, (letter) => letter.charCodeAt(0)), at);
  put("\x93NUMPY\x01\x00", 0);
  new DataView(bytes.buffer).setUint16(8, size - 10, true);
  put(`${head.padEnd(size - 11)}\n`, 10);
  bytes.set(mask, size);
  return bytes;
}
