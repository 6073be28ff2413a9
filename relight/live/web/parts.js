// Parts of the capture that are lit apart: which splats are in one, and what its own light does. MIT licence.

// entries: of live.json. bytes: of parts.bin, the number of its part from 1, 0 for none, and its share of 255, of each splat.
export function partsOf(entries, bytes, count) {
  if (!entries) return null;
  if (bytes?.length !== 2 * count) throw new Error(`parts.bin holds ${bytes?.length ?? 0} bytes, live.json says ${2 * count}: export it again`);
  return { entries, members: bytes };
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
