// Light: harmonics about +y, lat-long images, Radiance files, suns. MIT licence.

import { XYZ_PRIMARIES, toSrgb } from "./primaries.js";

export const BANDS = 10;
export const SPREAD_BANDS = 4;
export const HEIGHT = 64;
export const WIDTH = 128;
export const DIRECT = BANDS * BANDS;
export const SPREAD = SPREAD_BANDS * SPREAD_BANDS;

// Coefficients (K x 3, about +y) of light turned by an angle in radians, counter-clockwise from above.
export function turned(coefficients, angle) {
  const result = new Float64Array(coefficients.length);
  for (let l = 0; l * l * 3 < coefficients.length; l++) {
    for (let m = -l; m <= l; m++) {
      const i = (l * (l + 1) + m) * 3, j = (l * (l + 1) - m) * 3, c = Math.cos(m * angle), s = Math.sin(m * angle);
      for (let k = 0; k < 3; k++) result[i + k] = c * coefficients[i + k] - s * coefficients[j + k];
    }
  }
  return result;
}

export function turnedDirection([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return [c * x + s * z, y, c * z - s * x];
}

// Values of the harmonics about +y in a direction: Float64Array of bands^2.
export function harmonics([x, y, z], bands, out = new Float64Array(bands * bands)) {
  const sine = Math.hypot(x, z), longitude = Math.atan2(x, z);
  legendre(y, sine, bands, (l, m, value) => {
    const i = l * (l + 1);
    if (m === 0) out[i] = value;
    else {
      out[i + m] = value * Math.SQRT2 * Math.cos(m * longitude);
      out[i - m] = value * Math.SQRT2 * Math.sin(m * longitude);
    }
  });
  return out;
}

// Normalised associated Legendre functions, all positive: visit(l, m, value) for 0 <= m <= l < bands.
function legendre(cosine, sine, bands, visit) {
  let diagonal = Math.sqrt(1 / (4 * Math.PI));
  for (let m = 0; m < bands; m++) {
    if (m > 0) diagonal *= sine * Math.sqrt((2 * m + 1) / (2 * m));
    let before = 0, value = diagonal;
    visit(m, m, value);
    for (let l = m + 1; l < bands; l++) {
      const a = Math.sqrt((4 * l * l - 1) / (l * l - m * m));
      const b = l - 1 > m ? Math.sqrt(((l - 1) * (l - 1) - m * m) / (4 * (l - 1) * (l - 1) - 1)) : 0;
      const next = a * (cosine * value - b * before);
      before = value;
      value = next;
      visit(l, m, value);
    }
  }
}

export const rowArea = (row, height = HEIGHT, width = WIDTH) =>
  (Math.cos(Math.PI * row / height) - Math.cos(Math.PI * (row + 1) / height)) * 2 * Math.PI / width;

export function texelDirection(row, column, height = HEIGHT, width = WIDTH) {
  const latitude = Math.PI * (0.5 - (row + 0.5) / height), longitude = Math.PI * (1 - 2 * (column + 0.5) / width);
  return [Math.sin(longitude) * Math.cos(latitude), Math.sin(latitude), Math.cos(longitude) * Math.cos(latitude)];
}

// Coefficients (K x 3) about +y of a lat-long image (height x width x 3).
export function project(image, height = HEIGHT, width = WIDTH, bands = BANDS) {
  const result = new Float64Array(bands * bands * 3), waves = 2 * bands - 1, sums = new Float64Array(waves * 3);
  const cos = new Float64Array(bands * width), sin = new Float64Array(bands * width);
  for (let m = 0; m < bands; m++) {
    const wide = m ? Math.sin(Math.PI * m / width) / (Math.PI * m / width) : 1; // integrated along the texel
    for (let c = 0; c < width; c++) {
      const longitude = Math.PI * (1 - 2 * (c + 0.5) / width);
      cos[m * width + c] = wide * Math.cos(m * longitude);
      sin[m * width + c] = wide * Math.sin(m * longitude);
    }
  }
  for (let row = 0; row < height; row++) {
    sums.fill(0);
    for (let m = 0; m < bands; m++) {
      for (let c = 0; c < width; c++) {
        const at = (row * width + c) * 3, a = cos[m * width + c], b = sin[m * width + c];
        for (let k = 0; k < 3; k++) {
          sums[(bands - 1 + m) * 3 + k] += a * image[at + k];
          if (m) sums[(bands - 1 - m) * 3 + k] += b * image[at + k];
        }
      }
    }
    const latitude = Math.PI * (0.5 - (row + 0.5) / height), area = rowArea(row, height, width);
    legendre(Math.sin(latitude), Math.cos(latitude), bands, (l, m, value) => {
      const weight = value * area * (m ? Math.SQRT2 : 1);
      for (let k = 0; k < 3; k++) {
        result[(l * (l + 1) + m) * 3 + k] += weight * sums[(bands - 1 + m) * 3 + k];
        if (m) result[(l * (l + 1) - m) * 3 + k] += weight * sums[(bands - 1 - m) * 3 + k];
      }
    });
  }
  return result;
}

export const luminance = (r, g, b) => 0.2126 * r + 0.7152 * g + 0.0722 * b;

export function meanLuminance(image) {
  let sum = 0;
  for (let row = 0; row < HEIGHT; row++) {
    const area = rowArea(row);
    for (let at = row * WIDTH * 3; at < (row + 1) * WIDTH * 3; at += 3) sum += area * luminance(image[at], image[at + 1], image[at + 2]);
  }
  return sum / (4 * Math.PI);
}

export function fromRgbe(bytes) {
  const image = new Float32Array(bytes.length / 4 * 3);
  for (let i = 0; i * 4 < bytes.length; i++) {
    const scale = bytes[4 * i + 3] ? 2 ** (bytes[4 * i + 3] - 136) : 0;
    for (let k = 0; k < 3; k++) image[3 * i + k] = (bytes[4 * i + k] + 0.5) * scale;
  }
  return image;
}

// A Radiance .hdr: {width, height, image} from the top row down. Throws an Error of one line.
export function readHdr(bytes) {
  let at = 0, primaries = [];
  const line = () => {
    let text = "";
    while (at < bytes.length && bytes[at] !== 10) text += String.fromCharCode(bytes[at++]);
    at++;
    return text;
  };
  if (!line().startsWith("#?")) throw new Error("not a Radiance .hdr: convert the light to one, 2:1");
  for (let text = line(); text !== ""; text = line()) {
    if (text.startsWith("FORMAT=") && !/32-bit_rle_(rgb|xyz)e/.test(text)) throw new Error(`a .hdr in ${text.slice(7)}: export it as 32-bit_rle_rgbe`);
    if (text.includes("32-bit_rle_xyze")) primaries = XYZ_PRIMARIES;
    if (text.startsWith("PRIMARIES=") && primaries !== XYZ_PRIMARIES) primaries = text.slice(10).trim().split(/\s+/).map(Number);
    if (at >= bytes.length) throw new Error("a .hdr without a picture: it is cut short");
  }
  const size = /^-Y (\d+) \+X (\d+)$/.exec(line());
  if (!size) throw new Error("a .hdr whose rows do not run from the top: export it again");
  const height = +size[1], width = +size[2], packed = new Uint8Array(width * 4), image = new Float32Array(width * height * 3);
  if (!width || !height || width * height > 1 << 27) throw new Error(`a .hdr of ${width} x ${height}: expected up to 16384 x 8192`);
  const short = () => { throw new Error("a .hdr that is cut short: copy it again"); };
  for (let row = 0; row < height; row++) {
    if (at + 4 > bytes.length) short();
    if (width >= 8 && width < 32768 && bytes[at] === 2 && bytes[at + 1] === 2 && (bytes[at + 2] << 8 | bytes[at + 3]) === width) {
      at += 4;
      for (let channel = 0; channel < 4; channel++) {
        for (let x = 0; x < width;) {
          if (at >= bytes.length) short();
          let run = bytes[at++];
          const repeated = run > 128;
          if (repeated) run -= 128;
          if (!run || x + run > width || at + (repeated ? 1 : run) > bytes.length) short();
          for (const end = x + run; x < end; x++) packed[4 * x + channel] = repeated ? bytes[at] : bytes[at++];
          if (repeated) at++;
        }
      }
    } else {
      if (at + 4 * width > bytes.length) short();
      packed.set(bytes.subarray(at, at + 4 * width));
      at += 4 * width;
    }
    image.set(fromRgbe(packed), row * width * 3);
  }
  return { width, height, image: toSrgb(image, primaries) };
}

// A lat-long image in 64 x 128 texels, means by solid angle.
export function reduced({ width, height, image }) {
  const result = new Float64Array(HEIGHT * WIDTH * 3), rows = overlaps(height, HEIGHT, (s) => -Math.cos(Math.PI * s));
  const columns = overlaps(width, WIDTH, (s) => s);
  for (const [from, to, share] of rows) {
    for (const [left, right, part] of columns) {
      for (let k = 0; k < 3; k++) result[(to * WIDTH + right) * 3 + k] += share * part * image[(from * width + left) * 3 + k];
    }
  }
  return Float32Array.from(result);
}

// [texel, cell, share of the cell] along one axis.
function overlaps(texels, cells, measure) {
  const found = [];
  for (let texel = 0; texel < texels; texel++) {
    for (let cell = Math.floor(texel * cells / texels); cell < cells && cell * texels < (texel + 1) * cells; cell++) {
      const low = Math.max(texel / texels, cell / cells), high = Math.min((texel + 1) / texels, (cell + 1) / cells);
      found.push([texel, cell, (measure(high) - measure(low)) / (measure((cell + 1) / cells) - measure(cell / cells))]);
    }
  }
  return found;
}

const MOST_SUNS = 4, SUN_LEVEL = 12, SUN_RADIUS = Math.cos(10 * Math.PI / 180), LEAST_SUN = 0.04;

// Suns of an image: texels above 12 times the mean, in patches of 10 degrees that bring at least 4% of all light.
export function findSuns(image) {
  const mean = meanLuminance(image), bright = [];
  for (let row = 0; row < HEIGHT; row++) {
    for (let column = 0; column < WIDTH; column++) {
      const at = (row * WIDTH + column) * 3, value = luminance(image[at], image[at + 1], image[at + 2]);
      if (value > SUN_LEVEL * mean) bright.push({ at, value, area: rowArea(row), direction: texelDirection(row, column), share: 1 - SUN_LEVEL * mean / value });
    }
  }
  bright.sort((a, b) => b.value - a.value || a.at - b.at);
  const suns = [];
  for (const texel of bright) {
    let sun = suns.find(({ first }) => dot(first, texel.direction) > SUN_RADIUS);
    if (!sun) suns.push(sun = { first: texel.direction, sum: [0, 0, 0], weight: [0, 0, 0] });
    for (let k = 0; k < 3; k++) {
      sun.sum[k] += texel.direction[k] * texel.value * texel.share * texel.area;
      sun.weight[k] += image[texel.at + k] * texel.share * texel.area;
    }
  }
  return suns.filter(({ weight }) => luminance(...weight) > LEAST_SUN * 4 * Math.PI * mean).slice(0, MOST_SUNS).map(({ sum, weight }) => ({ direction: unit(sum), weight }));
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const unit = (a) => a.map((value) => value / Math.hypot(...a));

// A light from an image (64 x 128 x 3), in the form of live.json. The caller sets its exposure.
export function lightFrom(name, image) {
  const whole = project(image), suns = findSuns(image), rest = Float64Array.from(whole);
  for (const { direction, weight } of suns) {
    const values = harmonics(direction, BANDS);
    for (let i = 0; i < DIRECT; i++) for (let k = 0; k < 3; k++) rest[3 * i + k] -= values[i] * weight[k];
  }
  return { name, image, whole: whole.subarray(0, SPREAD * 3), rest, suns, mean: meanLuminance(image), exposure: 1, lamps: 0 };
}

// A light of live.json, with its numbers flattened and its image read.
export const lightOf = (entry, rgbe) => ({ ...entry, rest: Float64Array.from(entry.rest.flat()), whole: Float64Array.from(entry.whole.flat()), image: fromRgbe(rgbe) });

// Radiance of an image (64 x 128) in a direction, turned by an angle: bilinear, into `color`, times the exposure.
export function lookUp(image, x, y, z, angle, exposure, color) {
  let column = (0.5 - (Math.atan2(x, z) - angle) / (2 * Math.PI)) * WIDTH - 0.5;
  const row = (0.5 - Math.atan2(y, Math.hypot(x, z)) / Math.PI) * HEIGHT - 0.5;
  column -= Math.floor(column / WIDTH) * WIDTH;
  const top = Math.floor(row), left = Math.floor(column), down = row - top, right = column - left;
  color[0] = color[1] = color[2] = 0;
  for (let j = 0; j < 2; j++) {
    const at = top + j, half = at < 0 || at >= HEIGHT ? WIDTH / 2 : 0, line = Math.min(Math.max(at, 0), HEIGHT - 1) * WIDTH;
    for (let i = 0; i < 2; i++) {
      const share = exposure * (j ? down : 1 - down) * (i ? right : 1 - right), from = (line + (left + i + half) % WIDTH) * 3;
      for (let k = 0; k < 3; k++) color[k] += share * image[from + k];
    }
  }
}

export function linear(value) {
  return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
}

// A picked colour, #rrggbb, as linear light of luminance 1; and the reverse.
export function tintOf(hex) {
  const color = [1, 3, 5].map((at) => linear(parseInt(hex.slice(at, at + 2), 16) / 255)), bright = luminance(...color);
  return bright > 0 ? color.map((value) => value / bright) : [1, 1, 1];
}

export function hexOf(color) {
  const most = Math.max(...color, 1e-9);
  return `#${color.map((value) => Math.round(255 * encoded(Math.max(value / most, 0))).toString(16).padStart(2, "0")).join("")}`;
}

const encoded = (value) => value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;

// sRGB of unbounded linear light, in place: the shoulder of the Khronos PBR Neutral mapper, then the sRGB curve.
export function toneMap(color) {
  const peak = Math.max(...color);
  let [r, g, b] = color;
  if (peak > 0.8) {
    const shown = 1 - 0.04 / (peak - 0.6), keep = 1 / (0.15 * (peak - shown) + 1);
    [r, g, b] = color.map((value) => shown * (1 + keep * (value / peak - 1)));
  }
  [r, g, b].forEach((value, k) => { color[k] = value <= 0.0031308 ? 12.92 * Math.max(value, 0) : 1.055 * Math.min(value, 1) ** (1 / 2.4) - 0.055; });
}

const DISPLAYED = Uint8Array.from({ length: 65537 }, (_, i) => Math.round(255 * encoded(i / 65536))); // of display-linear values

// The sky of an image (64 x 128), turned by an angle, tone-mapped: RGBA bytes (height x width x 4) into `out`. As `lookUp`
// and `toneMap` of every `texelDirection`, in a pass along rows.
export function paintSky(image, angle, exposure, height, width, out) {
  const line = new Float32Array(3 * (WIDTH + 1)), left = new Uint16Array(width), right = new Float32Array(width);
  for (let column = 0; column < width; column++) {
    let at = (column + 0.5) / width * WIDTH - 0.5 + angle / (2 * Math.PI) * WIDTH;
    at -= Math.floor(at / WIDTH) * WIDTH;
    left[column] = Math.min(Math.floor(at), WIDTH - 1);
    right[column] = at - left[column];
  }
  for (let row = 0, to = 0; row < height; row++) {
    const place = (row + 0.5) / height * HEIGHT - 0.5, top = Math.floor(place), down = place - top;
    const above = Math.max(top, 0) * WIDTH, below = Math.min(top + 1, HEIGHT - 1) * WIDTH, halfAbove = top < 0 ? WIDTH / 2 : 0, halfBelow = top + 1 >= HEIGHT ? WIDTH / 2 : 0;
    for (let i = 0; i <= WIDTH; i++) {
      const a = 3 * (above + (i + halfAbove) % WIDTH), b = 3 * (below + (i + halfBelow) % WIDTH);
      for (let k = 0; k < 3; k++) line[3 * i + k] = exposure * (image[a + k] * (1 - down) + image[b + k] * down);
    }
    for (let column = 0; column < width; column++, to += 4) {
      const at = 3 * left[column], share = right[column];
      let r = line[at] + (line[at + 3] - line[at]) * share, g = line[at + 1] + (line[at + 4] - line[at + 1]) * share, b = line[at + 2] + (line[at + 5] - line[at + 2]) * share;
      const peak = r > g ? r > b ? r : b : g > b ? g : b;
      if (peak > 0.8) {
        const shown = 1 - 0.04 / (peak - 0.6), keep = 1 / (0.15 * (peak - shown) + 1);
        r = shown * (1 + keep * (r / peak - 1));
        g = shown * (1 + keep * (g / peak - 1));
        b = shown * (1 + keep * (b / peak - 1));
      }
      out[to] = DISPLAYED[r > 0 ? r * 65536 + 0.5 | 0 : 0];
      out[to + 1] = DISPLAYED[g > 0 ? g * 65536 + 0.5 | 0 : 0];
      out[to + 2] = DISPLAYED[b > 0 ? b * 65536 + 0.5 | 0 : 0];
      out[to + 3] = 255;
    }
  }
}
