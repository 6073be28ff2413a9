// Parts of the capture that are lit apart: which splats are in one, and what its own light does. MIT licence.

// entries: of live.json. bytes: of parts.bin, the number of its part from 1, 0 for none, and its share of 255, of each splat.
// rows: of rows.bin, the row of each splat in the source. Null where nothing can be lit apart.
export function partsOf(entries, bytes, rows, count) {
  if (!entries && !rows) return null;
  for (const [name, found, size] of [["parts.bin", entries && (bytes ?? []), 2 * count], ["rows.bin", rows, 4 * count]]) {
    if (found && found.length !== size) throw new Error(`${name} holds ${found.length} bytes, live.json says ${size}: export it again`);
  }
  return { entries: [...entries ?? []], members: bytes?.slice() ?? new Uint8Array(2 * count), rows: rows ? new Uint32Array(rows.slice().buffer) : null };
}

// The changes with the light of each part, in place: as `factor` (3) says, or 1 where it is not `on`. lights: {on, factor} of
// the rest, then of each part.
export function apart({ members }, lights, ratio) {
  for (let n = 0, i = 0; i < ratio.length; n += 2, i += 3) {
    const rest = lights[0], own = lights[members[n]], share = members[n + 1] / 255;
    for (let k = 0; k < 3; k++) {
      const first = rest.on ? ratio[i + k] * rest.factor[k] : 1, second = own.on ? ratio[i + k] * own.factor[k] : 1;
      ratio[i + k] = first + share * (second - first);
    }
  }
}
