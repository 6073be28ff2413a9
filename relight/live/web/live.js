// Live light on Gaussian splats: the bundle of docs/live.md read, lit and written, in plain JavaScript. MIT licence.
// No page and no engine in here: node runs it too. Directions and light are in the scene frame, y up.

import { BANDS, DIRECT, SPREAD, SPREAD_BANDS, harmonics, linear, lookUp, luminance, toneMap, turned } from "./light.js";
import { glossOf } from "./gloss.js";
import { groundOf } from "./ground.js";
import { objectsOf } from "./objects.js";
import { partsOf } from "./parts.js";
import { readCompressed } from "./splats.js";

const LAMPS = DIRECT + SPREAD, COEFFICIENTS = LAMPS + 1;
export const UNLIT = 0;
export const LIT = 1;
export const SKY = 2;
export const GAIN_UNIT = 1024; // of the 16 bits that a gain takes: 0 to 64, as 1e4 times the light is 46

// ---- the bundle

// files: {name: Uint8Array} of transfer.bin, surface.bin, basis.bin, terms.bin where there are terms, and the splat. Throws an Error of one line.
export function readBundle(meta, files, splatFile) {
  if (meta.format !== "relight-live" || meta.version > 2) {
    throw new Error(`expected a relight-live bundle of version 1 or 2, found ${meta.format} ${meta.version}`);
  }
  const count = meta.count, { weights, clusters, directions } = meta.basis, row = 2 + weights;
  const sizes = { "transfer.bin": count * row, "surface.bin": count * 8,
    "basis.bin": (1 + directions) * (4 + 6 * COEFFICIENTS) + clusters * ((1 + weights) * 4 + directions * (2 + weights)) };
  if (meta.terms) sizes["terms.bin"] = meta.terms.reduce((sum, { runs, rows }) => sum + 8 * runs + 3 * rows, 0);
  for (const [name, size] of Object.entries(sizes)) {
    const found = files[name] ? files[name].length : 0;
    if (found !== size) throw new Error(`${name} holds ${found} bytes, live.json says ${size}: export it again`);
  }
  const splats = readCompressed(files[splatFile]);
  if (splats.count !== count) {
    throw new Error(`${splatFile} is not the splat of this bundle (${splats.count} rows, not ${count}): export it again`);
  }
  return { meta, count, weights, clusters, splats, surface: files["surface.bin"], transfer: files["transfer.bin"], basis: basisOf(files["basis.bin"], meta.basis), terms: termsOf(meta.terms ?? [], files["terms.bin"]), gloss: glossOf(meta.gloss, count, files["surface.bin"], files["gloss.bin"]), objects: objectsOf(meta.objects, files), ground: groundOf(meta.ground, files[meta.ground?.file]), parts: partsOf(meta.parts, files["parts.bin"], files["rows.bin"], count) };
}

// Light beside the environment: {kind, name, color, place, mean} of each, with its runs, and a table of its bytes for each
// colour. Without runs it is 1 everywhere.
function termsOf(entries, bytes) {
  let at = 0;
  return entries.map((entry) => {
    if (entry.runs === null) return { ...entry, runs: null };
    const runs = new Uint32Array(bytes.slice(at, at + 8 * entry.runs).buffer), rows = bytes.subarray(at + 8 * entry.runs, at + 8 * entry.runs + 3 * entry.rows);
    at += 8 * entry.runs + 3 * entry.rows;
    const tables = entry.peak.map((peak) => Float32Array.from({ length: 256 }, (_, byte) => byte && peak * 2 ** ((byte - 255) / entry.steps)));
    return { ...entry, runs, rows, tables };
  });
}

// Add to the changes what terms bring, each of them `factors` (3) times as strong as it is stored.
export function addTerms(bundle, factors, ratio) {
  bundle.terms.forEach(({ runs, rows, tables }, index) => {
    const [r, g, b] = factors[index];
    if (!(r > 0 || g > 0 || b > 0)) return;
    if (!runs) {
      for (let i = 0; i < ratio.length; i += 3) {
        ratio[i] += r;
        ratio[i + 1] += g;
        ratio[i + 2] += b;
      }
      return;
    }
    const [red, green, blue] = tables.map((table, k) => table.map((value) => value * factors[index][k]));
    for (let run = 0, at = 0; run < runs.length; run += 2) {
      for (let i = 3 * runs[run], end = i + 3 * runs[run + 1]; i < end; i += 3, at += 3) {
        ratio[i] += red[rows[at]];
        ratio[i + 1] += green[rows[at + 1]];
        ratio[i + 2] += blue[rows[at + 2]];
      }
    }
  });
}

// The factors of all terms as a light of live.json begins, times an exposure.
export const factorsOf = ({ terms }, { captured = 0, unit = 1 }, times = 1) =>
  terms.map(({ kind, color }) => color.map((value) => value * unit * times * (kind === "captured" ? captured : 1)));

// basis.bin: the directions in which responses differ, of which clusters have means and components.
function basisOf(bytes, { clusters, weights, directions }) {
  let at = 0;
  const take = (Type, count) => {
    const part = new Type(bytes.slice(at, at + count * Type.BYTES_PER_ELEMENT).buffer);
    at += part.byteLength;
    return part;
  };
  return {
    clusters, weights, directions, directionScales: take(Float32Array, 1 + directions), coefficients: take(Int16Array, (1 + directions) * COEFFICIENTS * 3),
    scales: take(Float32Array, clusters * (1 + weights)), means: take(Int16Array, clusters * directions), components: take(Int8Array, clusters * weights * directions),
  };
}

// The file must be the one that live.json names. Without a secure context there is no hash: then its size must do.
export async function checkSplat(bytes, entry) {
  if (!globalThis.crypto || !crypto.subtle) return;
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
  const found = Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
  if (found !== entry.sha256) throw new Error(`${entry.file} is not the splat of this bundle (its SHA-256 differs): export it again`);
}

// ---- colours

// What each cluster makes of a light: (C, 1 + W, 3). sun: how strong its suns are, 1 as they are. lamps: of a room, beside it.
export function lightTable(bundle, light, angle, exposure, sun = 1, lamps = light.lamps * exposure / light.exposure) {
  const vector = new Float32Array(COEFFICIENTS * 3), whole = Float64Array.from(light.whole);
  if (sun !== 1) {
    for (const { direction, weight } of light.suns) {
      const values = harmonics(direction, SPREAD_BANDS);
      for (let i = 0; i < SPREAD; i++) for (let k = 0; k < 3; k++) whole[3 * i + k] += (sun - 1) * values[i] * weight[k];
    }
  }
  vector.set(turned(light.rest, angle));
  vector.set(turned(whole, angle), DIRECT * 3);
  for (let i = 0; i < vector.length; i++) vector[i] *= exposure;
  vector.fill(lamps, LAMPS * 3);
  return tableOf(bundle.basis, vector);
}

function tableOf({ clusters, weights, directions, directionScales, coefficients, scales, means, components }, vector) {
  const red = new Float32Array(directions), green = new Float32Array(directions), blue = new Float32Array(directions), base = [0, 0, 0];
  for (let d = 0, at = 0; d <= directions; d++) {
    let r = 0, g = 0, b = 0;
    for (let i = 0; i < COEFFICIENTS * 3; i += 3, at += 3) {
      r += coefficients[at] * vector[i];
      g += coefficients[at + 1] * vector[i + 1];
      b += coefficients[at + 2] * vector[i + 2];
    }
    const scale = directionScales[d];
    if (d) [red[d - 1], green[d - 1], blue[d - 1]] = [r * scale, g * scale, b * scale];
    else [r, g, b].forEach((value, k) => { base[k] = value * scale; });
  }
  const table = new Float32Array(clusters * (1 + weights) * 3);
  for (let cluster = 0, entry = 0; cluster < clusters; cluster++) {
    for (let w = 0; w <= weights; w++, entry++) {
      const values = w ? components : means, start = (w ? cluster * weights + w - 1 : cluster) * directions;
      let r = 0, g = 0, b = 0;
      for (let d = 0; d < directions; d++) {
        const value = values[start + d];
        r += value * red[d];
        g += value * green[d];
        b += value * blue[d];
      }
      const scale = scales[entry];
      table[3 * entry] = r * scale + (w ? 0 : base[0]);
      table[3 * entry + 1] = g * scale + (w ? 0 : base[1]);
      table[3 * entry + 2] = b * scale + (w ? 0 : base[2]);
    }
  }
  return table;
}

// The change of light of every splat but for suns, (N, 3), into `ratio`.
export function changes(bundle, table, ratio) {
  const { count, weights, transfer } = bundle, row = 2 + weights, step = (1 + weights) * 3;
  const signed = new Int8Array(transfer.buffer, transfer.byteOffset, transfer.length);
  if (weights === 6) return changesOfSix(count, transfer, signed, table, ratio);
  for (let n = 0, at = 0; n < count; n++, at += row) {
    let entry = (transfer[at] | transfer[at + 1] << 8) * step, r = table[entry], g = table[entry + 1], b = table[entry + 2];
    for (let w = 2; w < row; w++) {
      const weight = signed[at + w];
      entry += 3;
      r += weight * table[entry];
      g += weight * table[entry + 1];
      b += weight * table[entry + 2];
    }
    ratio[3 * n] = r;
    ratio[3 * n + 1] = g;
    ratio[3 * n + 2] = b;
  }
}

function changesOfSix(count, transfer, signed, t, ratio) {
  for (let n = 0, at = 0, to = 0; n < count; n++, at += 8, to += 3) {
    const e = (transfer[at] | transfer[at + 1] << 8) * 21;
    const a = signed[at + 2], b = signed[at + 3], c = signed[at + 4], d = signed[at + 5], f = signed[at + 6], g = signed[at + 7];
    ratio[to] = t[e] + a * t[e + 3] + b * t[e + 6] + c * t[e + 9] + d * t[e + 12] + f * t[e + 15] + g * t[e + 18];
    ratio[to + 1] = t[e + 1] + a * t[e + 4] + b * t[e + 7] + c * t[e + 10] + d * t[e + 13] + f * t[e + 16] + g * t[e + 19];
    ratio[to + 2] = t[e + 2] + a * t[e + 5] + b * t[e + 8] + c * t[e + 11] + d * t[e + 14] + f * t[e + 17] + g * t[e + 20];
  }
}

// What suns need of every splat, once: normals and places in the scene frame, tables of its bytes, and which are how far
// leaves or grass.
export function surfaceOf(bundle) {
  const { count, surface, splats, meta } = bundle, signed = new Int8Array(surface.buffer, surface.byteOffset, surface.length);
  const normals = new Float32Array(count * 3), places = new Float32Array(count * 3), volume = new Float32Array(count), { means } = splats;
  const [[xx, xy, xz, x0], [yx, yy, yz, y0], [zx, zy, zz, z0]] = meta.frame.scene_from_splat, step = meta.surface.lift;
  let leaves = 0;
  for (let n = 0, at = 0, i = 0; n < count; n++, at += 8, i += 3) {
    const u = signed[at] / 127, v = signed[at + 1] / 127, z = 1 - Math.abs(u) - Math.abs(v), fold = z < 0 ? -z : 0;
    const x = u < 0 ? u + fold : u - fold, y = v < 0 ? v + fold : v - fold, scale = 1 / Math.sqrt(x * x + y * y + z * z), lift = signed[at + 3] * step;
    const nx = x * scale, ny = y * scale, nz = z * scale, px = means[i], py = means[i + 1], pz = means[i + 2];
    normals[i] = nx;
    normals[i + 1] = ny;
    normals[i + 2] = nz;
    places[i] = xx * px + xy * py + xz * pz + x0 + lift * nx;
    places[i + 1] = yx * px + yy * py + yz * pz + y0 + lift * ny;
    places[i + 2] = zx * px + zy * py + zz * pz + z0 + lift * nz;
    const leaf = surface[at + 7] >> 2;
    if (leaf > 0) leaves++;
    volume[n] = leaf / 63;
  }
  const own = [0, 1, 2].map((k) => Float32Array.from({ length: 256 }, (_, byte) => meta.surface.own[k] * 2 ** ((byte - 128) / meta.surface.own_steps)));
  const thick = new Uint32Array(leaves);
  for (let n = 0, to = 0; to < leaves; n++) if (volume[n] > 0) thick[to++] = n;
  return { normals, places, own, volume, thick };
}

// Add suns to the changes. suns: [{direction, weight}], turned, of which each has the Shadow of the same index, or null.
export function addSuns(bundle, surface, suns, shadows, exposure, ratio) {
  suns.forEach(({ direction, weight }, index) => {
    throughLeaves(bundle, surface, direction, weight, exposure, ratio);
    addSun(bundle, surface, direction, weight.map((value) => value * exposure / Math.PI), shadows[index], ratio);
  });
}

// One sun, on what faces it and is not in its shadow: the mean of max(0, n.d) over normals that agree as much as those of
// the splat do, less the share that it is leaves or grass; what hides it is looked up as `Shadow.hide` does.
function addSun({ count, surface: bytes }, { normals, places, volume, own: [red, green, blue] }, [dx, dy, dz], [wr, wg, wb], shadow, ratio) {
  const { depth, size, off, scale, u: [ux, uy, uz], v: [vx, vy, vz], lowU, lowV } = shadow ? shadow.map() : OPEN, last = size - 2;
  for (let n = 0, i = 0, at = 0; n < count; n++, i += 3, at += 8) {
    const kind = bytes[at + 7];
    if ((kind & 3) !== LIT) continue;
    const nx = normals[i], ny = normals[i + 1], nz = normals[i + 2], r = bytes[at + 2] / 255, facing = r * (nx * dx + ny * dy + nz * dz);
    let light = 0.5 * (facing + Math.sqrt(facing * facing + 0.25 * (1 - r) * (1 - r)));
    if (!(light > 1e-3)) continue;
    const x = places[i] + off * nx, y = places[i + 1] + off * ny, z = places[i + 2] + off * nz;
    const column = (x * ux + y * uy + z * uz) * scale - lowU, row = (x * vx + y * vy + z * vz) * scale - lowV;
    if (column >= 0 && row >= 0 && column <= last && row <= last) {
      const left = column | 0, top = row | 0, right = column - left, from = top * size + left, t = x * dx + y * dy + z * dz + 0.5 * off;
      const above = (depth[from] < t ? 1 - right : 0) + (depth[from + 1] < t ? right : 0);
      const below = (depth[from + size] < t ? 1 - right : 0) + (depth[from + size + 1] < t ? right : 0);
      light *= above + (below - above) * (row - top);
      if (light === 0) continue;
    }
    if (kind > 3) light *= 1 - volume[n];
    ratio[i] += wr * light * red[bytes[at + 4]];
    ratio[i + 1] += wg * light * green[bytes[at + 5]];
    ratio[i + 2] += wb * light * blue[bytes[at + 6]];
  }
}

const OPEN = { depth: new Float32Array(4), size: 0, off: 0, scale: 0, u: [0, 0, 0], v: [0, 0, 0], lowU: 0, lowV: 0 }; // no shadow

// What each cluster makes of a sun as smooth as harmonics are: (C, 1 + W, 3).
export function sunTable(bundle, direction, weight, exposure) {
  const vector = new Float32Array(COEFFICIENTS * 3);
  harmonics(direction, BANDS).forEach((value, i) => weight.forEach((strength, k) => { vector[3 * i + k] = value * strength * exposure; }));
  return tableOf(bundle.basis, vector);
}

// Add what gets of a sun through leaves and grass to those, which have no normal: the share that they are such has it by
// its harmonics, as smooth as the way through them is; the rest stays a surface.
function throughLeaves(bundle, { volume, thick }, direction, weight, exposure, ratio) {
  if (!thick.length) return;
  const { weights, transfer } = bundle, row = 2 + weights, step = (1 + weights) * 3, table = sunTable(bundle, direction, weight, exposure), signed = new Int8Array(transfer.buffer, transfer.byteOffset, transfer.length);
  for (let i = 0; i < thick.length; i++) {
    const n = thick[i], at = n * row, share = volume[n];
    let entry = (transfer[at] | transfer[at + 1] << 8) * step, r = table[entry], g = table[entry + 1], b = table[entry + 2];
    for (let w = 2; w < row; w++) {
      const value = signed[at + w];
      entry += 3;
      r += value * table[entry];
      g += value * table[entry + 1];
      b += value * table[entry + 2];
    }
    if (r > 0) ratio[3 * n] += share * r;
    if (g > 0) ratio[3 * n + 1] += share * g;
    if (b > 0) ratio[3 * n + 2] += share * b;
  }
}

export function albedoChanges(bundle, surface, ratio) {
  for (let n = 0; n < bundle.count; n++) for (let k = 0; k < 3; k++) ratio[3 * n + k] = surface.own[k][bundle.surface[8 * n + 4 + k]];
}

// What the albedo is multiplied by, red, green and blue, where the captured light was warmer (1: red over blue twice as
// much) or cooler (-1) than estimated, greener, or brighter by stops; warmth and green leave the luminance.
export function balanceOf(tint, green = 0, bright = 0) {
  const color = [2 ** (-tint / 2), 2 ** -green, 2 ** (tint / 2)], level = luminance(...color) * 2 ** bright;
  return color.map((value) => value / level);
}

// The changes times a balance, in place.
export function balanced(ratio, [red, green, blue]) {
  if (red === 1 && green === 1 && blue === 1) return;
  for (let i = 0; i < ratio.length; i += 3) {
    ratio[i] *= red;
    ratio[i + 1] *= green;
    ratio[i + 2] *= blue;
  }
}

// How much the scene as a whole brightens, for the part of colours that depends on the view: (3) gains of 1 at least.
export function usualGain(bundle, light, angle, exposure, lamps = light.lamps * exposure / light.exposure, factors = factorsOf(bundle, light), balance = [1, 1, 1]) {
  return meanChange(bundle, light, angle, exposure, lamps, factors, balance).map((value) => Math.max(value, 1) ** (1 / 2.4));
}

// The mean change of light of the scene, (3).
export function meanChange(bundle, light, angle, exposure, lamps = light.lamps * exposure / light.exposure, factors = factorsOf(bundle, light), balance = [1, 1, 1]) {
  const whole = turned(light.whole, angle), sum = bundle.meta.mean[SPREAD].map((value) => lamps * value);
  for (let i = 0; i < SPREAD; i++) bundle.meta.mean[i].forEach((value, k) => { sum[k] += exposure * value * whole[3 * i + k]; });
  balance.forEach((value, k) => { sum[k] *= value; });
  bundle.terms.forEach(({ mean }, index) => mean.forEach((value, k) => { sum[k] += value * factors[index][k]; }));
  return sum;
}

const LOWEST_BITS = 0x38800000 >> 12, HIGHEST_BITS = 0x461c4000 >> 12; // 2^-14, 1e4
const LINEAR = Float32Array.from({ length: 256 }, (_, byte) => Math.max(linear(byte / 255), 1e-4));
const ROLLED = Float32Array.from({ length: 1025 }, (_, i) => 1 - Math.exp(-i / 128)); // up to 8: what is left is no step of a display
let gainTable = null;

function gainsByBits() {
  const number = new Float32Array(1), bits = new Uint32Array(number.buffer);
  return Uint16Array.from({ length: HIGHEST_BITS - LOWEST_BITS + 1 }, (_, i) => {
    bits[0] = (i + LOWEST_BITS << 12) + 2048;
    return Math.round(GAIN_UNIT * number[0] ** (1 / 2.4));
  });
}

// Gains of all splats as 16 bits, red, green, blue, and 1 where they are a colour instead: (N, 4) into `out`. What would
// be shown brighter than .8 runs into 1.
export function gains(bundle, ratio, out) {
  const { count, splats: { colors }, surface } = bundle, table = gainTable ??= gainsByBits(), most = table.length - 1;
  const bits = new Int32Array(ratio.buffer, ratio.byteOffset, ratio.length), lit = LINEAR; // negative numbers have negative bits
  for (let n = 0, i = 0, to = 0, at = 7; n < count; n++, i += 3, to += 4, at += 8) {
    if ((surface[at] & 3) !== LIT) {
      out[to] = out[to + 1] = out[to + 2] = GAIN_UNIT;
      out[to + 3] = 0;
      continue;
    }
    const red = lit[colors[i]], green = lit[colors[i + 1]], blue = lit[colors[i + 2]];
    const r = ((ratio[i] * red > 0.8 ? bitsOf(rolledOff(ratio[i], red)) : bits[i]) >> 12) - LOWEST_BITS;
    const g = ((ratio[i + 1] * green > 0.8 ? bitsOf(rolledOff(ratio[i + 1], green)) : bits[i + 1]) >> 12) - LOWEST_BITS;
    const b = ((ratio[i + 2] * blue > 0.8 ? bitsOf(rolledOff(ratio[i + 2], blue)) : bits[i + 2]) >> 12) - LOWEST_BITS;
    out[to] = table[r < 0 ? 0 : r > most ? most : r];
    out[to + 1] = table[g < 0 ? 0 : g > most ? most : g];
    out[to + 2] = table[b < 0 ? 0 : b > most ? most : b];
    out[to + 3] = 0;
  }
}

const ONE = new Float32Array(1), ONE_BITS = new Int32Array(ONE.buffer);
function bitsOf(value) {
  ONE[0] = value;
  return ONE_BITS[0];
}

// Gains of splats as captured, (N, 4).
export function plainGains(count) {
  const gains = new Uint16Array(4 * count).fill(GAIN_UNIT);
  for (let i = 3; i < gains.length; i += 4) gains[i] = 0;
  return gains;
}

// A change that would show more than .8 of a captured linear colour: it runs into 1, unless it was brighter then.
function rolledOff(ratio, color) {
  const start = color > 0.8 ? color : 0.8, shown = ratio * color;
  if (shown <= start) return ratio;
  const room = start < 0.999 ? 1 - start : 0.001, over = (shown - start) / room * 128;
  if (over >= 1024) return (start + room) / color;
  const at = over | 0;
  return (start + room * (ROLLED[at] + (ROLLED[at + 1] - ROLLED[at]) * (over - at))) / color;
}

// Changes (3) as gains of GAIN_UNIT.
export const gainsOf = (changes) => changes.map((value) => Math.round(GAIN_UNIT * Math.min(Math.max(value, 1e-4), 1e4) ** (1 / 2.4)));

// Far background shows the sky, turned: colours in place of gains. Under the light of the capture it is `captured` (3)
// times as bright as it was.
export function showSky(bundle, light, angle, exposure, out, captured = [1, 1, 1]) {
  const { rows, directions } = bundle.sky ??= skyRows(bundle), color = [0, 0, 0];
  if (light.sky === "captured") {
    const kept = gainsOf(captured);
    for (const row of rows) out.set([...kept, 0], 4 * row);
    return;
  }
  for (let i = 0; i < rows.length; i++) {
    lookUp(light.image, directions[3 * i], directions[3 * i + 1], directions[3 * i + 2], angle, exposure, color);
    toneMap(color);
    for (let k = 0; k < 3; k++) out[4 * rows[i] + k] = Math.round(color[k] * GAIN_UNIT);
    out[4 * rows[i] + 3] = 1;
  }
}

function skyRows({ count, surface, splats, meta }) {
  const rows = [], directions = [], { scene_from_splat: frame, middle } = meta.frame;
  for (let n = 0; n < count; n++) {
    if ((surface[8 * n + 7] & 3) !== SKY) continue;
    const away = [0, 1, 2].map((k) => splats.means[3 * n + k] - middle[k]);
    rows.push(n);
    directions.push(...frame.slice(0, 3).map((row) => row[0] * away[0] + row[1] * away[1] + row[2] * away[2]));
  }
  return { rows, directions };
}

// The exposure of a light that came without one, by the rule of live.json. ratio: changes of the splats at exposure 1.
export function exposureOf(bundle, light, ratio) {
  const shown = [], step = Math.max(1, Math.floor(bundle.count / 20000));
  for (let n = 0; n < bundle.count; n += step) {
    if ((bundle.surface[8 * n + 7] & 3) !== LIT) continue;
    shown.push(Math.max(...[0, 1, 2].map((k) => ratio[3 * n + k] * LINEAR[bundle.splats.colors[3 * n + k]])));
  }
  shown.sort((a, b) => a - b);
  const bright = shown.length ? shown[Math.floor(0.98 * (shown.length - 1))] : 1, auto = bright > 0 ? 0.8 / bright : 1;
  if (bundle.meta.brightness === null || !(light.mean > 0)) return auto;
  if (bundle.meta.lamps !== null) return bundle.meta.brightness / light.mean;
  return Math.min(Math.max(bundle.meta.brightness / light.mean, auto / 2), auto * 2);
}
