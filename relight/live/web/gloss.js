// Gloss: reflections of splats for the shader of the page. docs/live.md describes gloss.bin. MIT licence.

import { BANDS, DIRECT, harmonics, linear, turned } from "./light.js";

export const MIRROR = { rows: 32, columns: 64, spare: 3, level: 8, lamp: 64 }; // a blurred light, and the rows behind all of them

// The gloss of a bundle: materials and levels, and for each splat 16 bytes in four numbers, all 0 where it is matt:
// normal (2), material, colour of the occluders (3), coefficients of visibility (4), light of up to 6 lamps. Throws an Error of one line.
export function glossOf(meta, count, surface, bytes) {
  if (!meta) return null;
  const expected = 8 * meta.runs + meta.bytes * meta.rows, found = bytes ? bytes.length : 0;
  if (found !== expected) throw new Error(`${meta.file} holds ${found} bytes, live.json says ${expected}: export it again`);
  const runs = new Uint32Array(bytes.slice(0, 8 * meta.runs).buffer), rows = bytes.subarray(8 * meta.runs);
  const packed = new Uint8Array(16 * count);
  for (let run = 0, at = 0; run < runs.length; run += 2) {
    for (let n = runs[run], end = n + runs[run + 1]; n < end; n++, at += meta.bytes) {
      if (!rows[at]) continue;
      packed.set(surface.subarray(8 * n, 8 * n + 2), 16 * n);
      packed.set(rows.subarray(at, at + meta.bytes), 16 * n + 2);
    }
  }
  return { lamps: [], ...meta, captured: Float64Array.from(meta.captured.flat()), packed: new Uint32Array(packed.buffer) };
}

// Coefficients (K x 3, about +y) of a mirrored light: turned, with its suns, times an exposure, plus factors (3) times the
// captured light. The light that keeps the captured state mirrors the captured light itself, so nothing changes.
export function mirroredLight({ captured }, light, angle, exposure, suns, factor = [0, 0, 0]) {
  const result = turned(light.name === "capture" ? captured : light.rest, angle);
  for (const { direction, weight } of suns) {
    const values = harmonics(direction, BANDS);
    for (let i = 0; i < DIRECT; i++) for (let k = 0; k < 3; k++) result[3 * i + k] += values[i] * weight[k];
  }
  for (let i = 0; i < result.length; i++) result[i] = exposure * result[i] + factor[i % 3] * captured[i];
  return result;
}

// The texture that the shader reads, RGBA floats, 128 x (32 a level + 3): the captured light on the left and the new one on
// the right, blurred for each level of roughness, lat-long; then the materials, 128 to a row, reflectance and level, half
// more for metals; then a row of the peaks of visibility, alpha of each level, and two texels a lamp: place and reach, steps of
// its bytes and light. factors: of all terms (3).
export function mirrorTexture(gloss, coefficients, factors = [], out = new Float32Array(mirrorSize(gloss).width * mirrorSize(gloss).height * 4)) {
  const { rows, columns } = MIRROR, { width } = mirrorSize(gloss), { levels, materials, peaks, lamps } = gloss;
  gloss.basis ??= mirrorBasis();
  levels.forEach(({ factors }, level) => {
    blurred(gloss.basis, factors, coefficients, out, (level * rows * width + columns) * 4);
    if (!gloss.drawn) blurred(gloss.basis, factors, gloss.captured, out, level * rows * width * 4);
  });
  const end = levels.length * rows * width * 4;
  materials.forEach(({ reflectance, level, metal }, number) => { out.set([...reflectance, level + (metal ? 0.5 : 0)], end + 4 * number); });
  peaks.forEach((peak, number) => { out[end + (2 * width + number) * 4] = peak / 127; });
  levels.forEach(({ alpha }, level) => { out[end + (2 * width + MIRROR.level + level) * 4] = alpha; });
  lamps.forEach(({ term, place, reach, peak, steps }, number) => {
    out.set([...place, reach, ...factors[term].map((value) => value * peak), steps], end + (2 * width + MIRROR.lamp + 2 * number) * 4);
  });
  gloss.drawn = true; // the left half stays, in the same array
  return out;
}

export const mirrorSize = ({ levels }) => ({ width: 2 * MIRROR.columns, height: MIRROR.rows * levels.length + MIRROR.spare });

function mirrorBasis() {
  const { rows, columns } = MIRROR, basis = new Float32Array(rows * columns * DIRECT), one = new Float64Array(DIRECT);
  for (let row = 0, at = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++, at += DIRECT) {
      const latitude = Math.PI * (0.5 - (row + 0.5) / rows), longitude = Math.PI * (1 - 2 * (column + 0.5) / columns);
      basis.set(harmonics([Math.sin(longitude) * Math.cos(latitude), Math.sin(latitude), Math.cos(longitude) * Math.cos(latitude)], BANDS, one), at);
    }
  }
  return basis;
}

// A light blurred by a lobe of factors on its degrees, in all texels, into `out` from an offset on.
function blurred(basis, factors, coefficients, out, start) {
  const { rows, columns } = MIRROR, red = new Float32Array(DIRECT), green = new Float32Array(DIRECT), blue = new Float32Array(DIRECT);
  for (let l = 0, i = 0; l < BANDS; l++) {
    for (; i < (l + 1) * (l + 1); i++) [red[i], green[i], blue[i]] = [0, 1, 2].map((k) => factors[l] * coefficients[3 * i + k]);
  }
  for (let row = 0, at = 0; row < rows; row++) {
    for (let column = 0, to = start + row * 2 * columns * 4; column < columns; column++, to += 4) {
      let r = 0, g = 0, b = 0;
      for (let i = 0; i < DIRECT; i++, at++) {
        const value = basis[at];
        r += value * red[i];
        g += value * green[i];
        b += value * blue[i];
      }
      out[to] = r > 0 ? r : 0;
      out[to + 1] = g > 0 ? g : 0;
      out[to + 2] = b > 0 ? b : 0;
    }
  }
}

// The linear change (3) of splat n seen from `eye`, from its position and normal (3) in the scene frame, the change of its
// diffuse light (3): a readable copy of the shader, for tests.
export function glossChange({ packed, peaks, materials, levels, lamps }, texture, n, eye, place, normal, ratio, hidden) {
  const bytes = new Uint8Array(packed.buffer, 16 * n, 16), material = materials[bytes[2] - 1];
  if (!material) return [0, 0, 0];
  const away = eye.map((value, k) => value - place[k]), far = Math.hypot(...away), toward = away.map((value) => value / far);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2], bend = Math.max(0.05 - dot(normal, toward), 0);
  const bent = normal.map((value, k) => value + bend * toward[k]), length = Math.hypot(...bent), n1 = bent.map((value) => value / length);
  const cosine = dot(n1, toward), [x, y, z] = n1.map((value, k) => 2 * cosine * value - toward[k]);
  const basis = [0.282095, 0.488603 * y, 0.488603 * z, 0.488603 * x];
  const signed = new Int8Array(packed.buffer, 16 * n + 6, 4), seen = Math.min(Math.max(basis.reduce((sum, value, i) => sum + value * signed[i] * peaks[i] / 127, 0), 0), 1);
  const rise = material.metal ? 1 : 1 + 24 * (1 - Math.min(Math.max(cosine, 0), 1)) ** 5;
  const alpha = levels[material.level].alpha, from = texture.length - 4 * ((MIRROR.spare - 2) * 2 * MIRROR.columns - MIRROR.lamp);
  const lobes = lamps.map((_, i) => bytes[10 + i] && lampLobe(texture.subarray(from + 8 * i, from + 8 * i + 4), alpha, place, n1, toward) * 2 ** ((bytes[10 + i] - 255) / texture[from + 8 * i + 7]));
  const shines = [0, 1, 2].map((k) => lobes.reduce((sum, lobe, i) => sum + lobe * texture[from + 8 * i + 4 + k], 0));
  return [0, 1, 2].map((k) => {
    const strength = Math.min(material.reflectance[k] * rise, 1), stands = linear(bytes[3 + k] / 255);
    const sent = (level) => [1, hidden[k]].map((brighter, side) => seen * mirrorAt(texture, side, level, [x, y, z], k) + (1 - seen) * stands * brighter);
    const [old, now] = sent(material.level);
    return strength * (now + shines[k] - ratio[k] * old);
  });
}

// The lobe of a lamp of [x, y, z, reach] per light that arrives on what faces it: GGX, widened by half the angle of the lamp.
function lampLobe([x, y, z, reach], alpha, place, normal, toward) {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2], way = [x - place[0], y - place[1], z - place[2]], far = Math.max(Math.hypot(...way), 1e-9);
  const light = way.map((value) => value / far), lit = dot(normal, light), seen = dot(normal, toward);
  if (!(lit > 0)) return 0;
  const half = light.map((value, k) => value + toward[k]), cosine = dot(half, normal) / Math.max(Math.hypot(...half), 1e-9);
  const square = Math.min(alpha + reach / (2 * Math.max(far, reach)), 1) ** 2, spread = cosine * cosine * (square - 1) + 1;
  const masking = (value) => 2 * value / (value + Math.sqrt(square + (1 - square) * value * value));
  return square / (Math.PI * spread * spread) * masking(lit) * masking(seen) / (4 * seen);
}

function mirrorAt(texture, side, level, [x, y, z], k) {
  const { rows, columns } = MIRROR, across = (0.5 - Math.atan2(x, z) / (2 * Math.PI)) * columns - 0.5;
  const down = Math.min(Math.max((0.5 - Math.atan2(y, Math.hypot(x, z)) / Math.PI) * rows - 0.5, 0), rows - 1);
  const left = Math.floor(across), top = Math.min(Math.floor(down), rows - 2), right = across - left, low = down - top;
  const at = (column, row) => texture[((level * rows + row) * 2 * columns + side * columns + (column + columns) % columns) * 4 + k];
  return (1 - low) * ((1 - right) * at(left, top) + right * at(left + 1, top)) + low * ((1 - right) * at(left, top + 1) + right * at(left + 1, top + 1));
}
