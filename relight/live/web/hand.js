// The captured light set by hand: an offered light with its sun moved, as relight/albedo/by_hand.py has it.

import { BANDS, HEIGHT, SPREAD, WIDTH, fromRgbe, harmonics, luminance, rowArea, texelDirection } from "./light.js";
import { addSuns, changes, lightTable } from "./live.js";

const RADIANS_OF = Math.PI / 180, SUN_WIDTH = 2.8 * RADIANS_OF; // of a sun in a written image: a texel

export const LEAST_RECEIVED = 0.1; // of what the estimate gave, as SOFTNESS of relight/albedo/division.py: below it the albedo is not divided further

// Lights of live.json that may have lit the capture, with their numbers flattened and their images read.
export const offeredOf = (entries, images) => entries.map((entry, i) => ({ ...entry, rest: Float64Array.from(entry.rest.flat()), image: fromRgbe(images[i]) }));

// The direction toward a sun: azimuth from -z, clockwise seen from above.
export function towardSun(azimuth, height) {
  const a = azimuth * RADIANS_OF, h = height * RADIANS_OF;
  return [Math.sin(a) * Math.cos(h), Math.sin(h), -Math.cos(a) * Math.cos(h)];
}

// Irradiance (3) of a surface that faces a direction, of an image.
function facing(image, [x, y, z]) {
  const sum = [0, 0, 0];
  for (let row = 0; row < HEIGHT; row++) {
    const area = rowArea(row);
    for (let column = 0; column < WIDTH; column++) {
      const [dx, dy, dz] = texelDirection(row, column), cosine = dx * x + dy * y + dz * z, at = 3 * (row * WIDTH + column);
      if (cosine > 0) for (let k = 0; k < 3; k++) sum[k] += area * cosine * image[at + k];
    }
  }
  return sum;
}

// The factor on the sky of an offered light, and the irradiance (3) of its sun, moved by a hand {azimuth, height, share}.
// What faces the sun is as bright as in the offered light.
function parts(offered, { azimuth, height, share }) {
  const { image, color, azimuth_deg, height_deg, sun_share } = offered, direction = towardSun(azimuth, height);
  const level = luminance(...facing(image, towardSun(azimuth_deg, height_deg))) / (1 - sun_share);
  return { direction, sky: (1 - share) * level / Math.max(luminance(...facing(image, direction)), 1e-12), sun: color.map((value) => share * level * value) };
}

// An offered light moved by a hand, in the form of live.json, in the unit of the captured colours.
export function lightByHand(offered, hand) {
  const { direction, sky, sun } = parts(offered, hand), rest = offered.rest.map((value) => sky * value), whole = rest.slice(0, 3 * SPREAD), shines = sun.some((value) => value > 0);
  if (shines) harmonics(direction, BANDS).subarray(0, SPREAD).forEach((value, i) => sun.forEach((weight, k) => { whole[3 * i + k] += value * weight; }));
  return { rest, whole, suns: shines ? [{ direction, weight: sun }] : [], exposure: 1, lamps: 0 };
}

// What every splat received of a captured light over what the estimate gave it, (N, 3). shadow(direction): of a sun.
export function received(bundle, surface, light, shadow) {
  const ratio = new Float32Array(3 * bundle.count);
  changes(bundle, lightTable(bundle, light, 0, 1), ratio);
  addSuns(bundle, surface, light.suns, light.suns.map(({ direction }) => shadow(direction)), 1, ratio);
  return ratio;
}

// The changes over what was received, in place.
export function divided(ratio, given) {
  for (let i = 0; i < ratio.length; i++) ratio[i] /= Math.max(given[i], LEAST_RECEIVED);
}

// The light as an image (64 x 128 x 3), times factors (3), its sun a lobe.
export function imageByHand(offered, hand, factors = [1, 1, 1]) {
  const { direction, sky, sun } = parts(offered, hand), image = offered.image.map((value, i) => value * sky * factors[i % 3]);
  if (!sun.some((value) => value > 0)) return image;
  const lobe = new Float32Array(image.length);
  for (let i = 0; i < HEIGHT * WIDTH; i++) {
    const [x, y, z] = texelDirection(Math.floor(i / WIDTH), i % WIDTH), cosine = x * direction[0] + y * direction[1] + z * direction[2];
    lobe.fill(Math.exp(-0.5 * (Math.acos(Math.min(Math.max(cosine, -1), 1)) / SUN_WIDTH) ** 2), 3 * i, 3 * i + 3);
  }
  const [size] = facing(lobe, direction);
  return image.map((value, i) => value + lobe[i] / size * sun[i % 3] * factors[i % 3]);
}

// A Radiance .hdr of an image (64 x 128 x 3): Uint8Array.
export function writeHdr(image) {
  const header = new TextEncoder().encode(`#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y ${HEIGHT} +X ${WIDTH}\n`), bytes = new Uint8Array(header.length + 4 * HEIGHT * WIDTH);
  bytes.set(header);
  for (let i = 0, to = header.length; i < HEIGHT * WIDTH; i++, to += 4) {
    const most = Math.max(image[3 * i], image[3 * i + 1], image[3 * i + 2]);
    if (!(most > 1e-32)) continue;
    const exponent = Math.floor(Math.log2(most)) + 1;
    for (let k = 0; k < 3; k++) bytes[to + k] = Math.min(Math.max(Math.floor(image[3 * i + k] * 2 ** (8 - exponent)), 0), 255);
    bytes[to + 3] = exponent + 128;
  }
  return bytes;
}

// The content of a captured_light.json that names that image as chosen.
export function chosenLight(offered, { azimuth, height, share }, factors, environment) {
  const { sky, sun } = parts(offered, { azimuth, height, share }), before = parts(offered, { azimuth: offered.azimuth_deg, height: offered.height_deg, share: offered.sun_share });
  const had = luminance(...before.sun), stronger = had > 0 ? luminance(...sun) / had : 1, brightness = luminance(...factors);
  const entry = {
    name: `set by hand from ${offered.name.replace(/^set by hand from /, "")}`, share: 1, environment, by_hand: true,
    sun: share > 0 ? { azimuth_deg: azimuth, height_deg: height, irradiance: sun.map((value, k) => value * factors[k]) } : null,
    brightness, tint: factors.map((value) => value / brightness), sun_strength: stronger, sky_to_sun: stronger > 0 ? sky / stronger : 1,
  };
  return { schema_version: 1, chosen: entry, candidates: [] };
}
