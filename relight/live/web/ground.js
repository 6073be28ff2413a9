// The ground under an object: how much of the light from above reaches its points. docs/live.md describes ground.bin. MIT licence.

import { HEIGHT, WIDTH, rowArea, texelDirection } from "./light.js";

const POWER = 1 / 2.4, LEVELS = 4096, SOFT = 0.8; // the part of its radius in which a disc fades out
const DARK = Uint8Array.from({ length: LEVELS + 1 }, (_, i) => Math.round(255 * (1 - (i / LEVELS) ** POWER))); // by the share of light

// The ground of a bundle, null without. Throws an Error of one line.
export function groundOf(entry, bytes) {
  if (!entry) return null;
  const { side, directions: count, file } = entry, start = 4 * side + 12 * count;
  if (bytes?.length !== entry.bytes) throw new Error(`${file} holds ${bytes ? bytes.length : 0} bytes, live.json says ${entry.bytes}: export it again`);
  const steps = new Float32Array(bytes.slice(0, 4 * side).buffer), directions = new Float32Array(bytes.slice(4 * side, start).buffer);
  const edges = new Uint16Array(bytes.length - start), ends = new Uint32Array(count);
  let at = start, to = 0;
  const next = () => {
    let value = 0, shift = 0, byte;
    do {
      byte = bytes[at++];
      value |= (byte & 127) << shift;
      shift += 7;
    } while (byte & 128);
    return value;
  };
  for (let k = 0; k < count; k++) {
    for (let left = next(), place = 0; left > 0; left--) edges[to++] = place += next();
    ends[k] = to;
  }
  const ground = { ...entry, steps, directions, edges, ends, ...rimOf(steps), open: new Float32Array(3 * side * side), cosines: new Float64Array(entry.shared), numbers: new Int32Array(entry.shared) };
  return { ...ground, texels: texelsOf(ground), taps: tapsOf(entry.blur) };
}

// Of each point how much of a shadow is drawn, and how far a disc is there: nothing at the rim, without an edge.
function rimOf(steps) {
  const side = steps.length, away = Float32Array.from({ length: side * side }, (_, i) => Math.min(Math.sqrt(steps[i % side] ** 2 + steps[Math.floor(i / side)] ** 2), 1));
  const soft = (share) => share * share * (3 - 2 * share);
  return { fade: away.map((value) => Math.min(4 * (1 - value), 1)), disc: away.map((value) => 255 * soft(Math.min((1 - value) / SOFT, 1))) };
}

function tapsOf(blur) {
  const radius = Math.floor(4 * blur + 0.5), taps = Array.from({ length: 2 * radius + 1 }, (_, i) => Math.exp(-((i - radius) ** 2) / (2 * blur * blur)));
  return taps.map((value) => value / taps.reduce((sum, each) => sum + each, 0));
}

// The directions that share the light from (x, y, z): their numbers into `to`, their shares into `shares`, from an offset
// on, times a factor.
function sharedBy({ directions, shared, cosines, numbers }, x, y, z, to, shares, at, factor) {
  cosines.fill(-2);
  for (let k = 0, i = 0; i < directions.length; k++, i += 3) {
    const cosine = x * directions[i] + y * directions[i + 1] + z * directions[i + 2];
    let place = shared - 1;
    if (cosine <= cosines[place]) continue;
    for (; place > 0 && cosines[place - 1] < cosine; place--) {
      cosines[place] = cosines[place - 1];
      numbers[place] = numbers[place - 1];
    }
    cosines[place] = cosine;
    numbers[place] = k;
  }
  const away = (i) => Math.sqrt(Math.max(2 - 2 * cosines[i], 0)), last = Math.max(1.2 * away(shared - 1), 1e-9);
  let sum = 0;
  for (let i = 0; i < shared; i++) {
    const weight = Math.max(1 - away(i) / last, 0);
    to[at + i] = numbers[i];
    shares[at + i] = weight * weight;
    sum += weight * weight;
  }
  for (let i = 0; i < shared; i++) shares[at + i] *= factor / sum;
}

// Of each texel of the upper half of a light, the directions that share its light on level ground.
function texelsOf(ground) {
  const { shared } = ground, count = HEIGHT / 2 * WIDTH * shared, to = new Uint16Array(count), shares = new Float32Array(count);
  for (let row = 0, at = 0; row < HEIGHT / 2; row++) {
    const area = rowArea(row);
    for (let column = 0; column < WIDTH; column++, at += shared) {
      const [x, y, z] = texelDirection(row, column);
      sharedBy(ground, x, y, z, to, shares, at, y * area);
    }
  }
  return { to, shares };
}

// Light on level ground from around each direction, (K, 3), of an image turned by an angle. moved: suns [{direction,
// weight}] that are there beside it, of negative weight where they are not.
export function arriving(ground, image, angle, moved = []) {
  const { directions, shared, texels: { to, shares } } = ground, result = new Float64Array(directions.length);
  const shift = ((angle / (2 * Math.PI)) % 1 + 1) % 1 * WIDTH, low = Math.floor(shift), right = shift - low;
  for (let row = 0, at = 0; row < HEIGHT / 2; row++) {
    for (let column = 0; column < WIDTH; column++) {
      const a = (row * WIDTH + (column + low) % WIDTH) * 3, b = (row * WIDTH + (column + low + 1) % WIDTH) * 3;
      const red = image[a] + (image[b] - image[a]) * right, green = image[a + 1] + (image[b + 1] - image[a + 1]) * right, blue = image[a + 2] + (image[b + 2] - image[a + 2]) * right;
      for (let i = 0; i < shared; i++, at++) {
        const k = 3 * to[at], part = shares[at];
        result[k] += part * red;
        result[k + 1] += part * green;
        result[k + 2] += part * blue;
      }
    }
  }
  const near = new Uint16Array(shared), parts = new Float32Array(shared);
  for (const { direction: [x, y, z], weight } of moved) {
    if (y <= 0) continue;
    sharedBy(ground, x, y, z, near, parts, 0, y);
    for (let i = 0; i < shared; i++) for (let k = 0; k < 3; k++) result[3 * near[i] + k] += parts[i] * weight[k];
  }
  return moved.length ? result.map((value) => Math.max(value, 0)) : result;
}

// The colour of the ground in a light, linear: the mean of what the light shows below the horizon.
export function groundColor(image) {
  const color = [0, 0, 0];
  let all = 0;
  for (let row = HEIGHT / 2; row < HEIGHT; row++) {
    const weight = -texelDirection(row, 0)[1] * rowArea(row);
    for (let at = row * WIDTH * 3; at < (row + 1) * WIDTH * 3; at += 3) for (let k = 0; k < 3; k++) color[k] += weight * image[at + k];
    all += weight * WIDTH;
  }
  return color.map((value) => value / all);
}

// What `arriving` light leaves of the ground, as bytes (S, S, 4): 1 minus the factor on its display colour, and how far
// a disc is there.
export function groundShade(ground, light, out) {
  const { side, edges, ends, fade, disc, open } = ground, whole = [0, 0, 0];
  for (let i = 0; i < light.length; i++) whole[i % 3] += light[i];
  open.fill(0);
  for (let k = 0, edge = 0; k < ends.length; k++) {
    let red = light[3 * k] / (whole[0] || 1), green = light[3 * k + 1] / (whole[1] || 1), blue = light[3 * k + 2] / (whole[2] || 1);
    for (; edge < ends[k]; edge++) {
      const at = 3 * edges[edge];
      open[at] -= red;
      open[at + 1] -= green;
      open[at + 2] -= blue;
      [red, green, blue] = [-red, -green, -blue];
    }
  }
  let red = 1, green = 1, blue = 1;
  for (let i = 0; i < open.length; i += 3) {
    open[i] = red += open[i];
    open[i + 1] = green += open[i + 1];
    open[i + 2] = blue += open[i + 2];
  }
  smoothed(ground);
  for (let i = 0, from = 0, to = 0; i < fade.length; i++) {
    for (let k = 0; k < 3; k++) out[to++] = DARK[Math.min(Math.max(LEVELS * (1 - fade[i] * (1 - open[from++])) + 0.5, 0), LEVELS) | 0];
    out[to++] = disc[i] + 0.5;
  }
  return out;
}

// Along rows, then along columns; the outermost points go on beyond the side.
function smoothed({ side, open, taps }) {
  const radius = taps.length >> 1, line = new Float32Array(side), pass = (step, across) => {
    for (let start = 0; start < side; start++) {
      for (let k = 0, first = 3 * start * across; k < 3; k++) {
        for (let i = 0, at = first + k; i < side; i++, at += 3 * step) line[i] = open[at];
        for (let i = 0, at = first + k; i < side; i++, at += 3 * step) {
          let sum = 0;
          for (let j = 0, from = i - radius; j < taps.length; j++, from++) sum += taps[j] * line[from < 0 ? 0 : from >= side ? side - 1 : from];
          open[at] = sum;
        }
      }
    }
  };
  pass(1, side);
  pass(side, 1);
}
