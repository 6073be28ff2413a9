// Primaries of pictures of light to linear sRGB, white to white by Bradford's adaptation. MIT licence.
// As relight/light/color_spaces.py, from whose sources it is.

export const XYZ_PRIMARIES = [1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3];
const SRGB_PRIMARIES = [0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329], SAME_PRIMARIES = 1e-5, FARTHEST_PRIMARY = 2;
const BRADFORD = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];

// Change an image of these primaries, x and y of red, green, blue and white, in place. What spans no colours changes nothing.
export function toSrgb(image, primaries) {
  const matrix = srgbFrom(primaries);
  if (!matrix) return image;
  for (let at = 0; at < image.length; at += 3) {
    const found = applied3(matrix, [image[at], image[at + 1], image[at + 2]]);
    for (let k = 0; k < 3; k++) image[at + k] = Math.max(0, found[k]);
  }
  return image;
}

function srgbFrom(primaries) {
  const own = xyzOf(primaries), srgb = xyzOf(SRGB_PRIMARIES);
  if (!own || primaries.every((each, k) => Math.abs(each - SRGB_PRIMARIES[k]) < SAME_PRIMARIES)) return null;
  const [from, to] = [own, srgb].map((matrix) => applied3(BRADFORD, applied3(matrix, [1, 1, 1])));
  if (!from.every((each) => each > 0)) return null;
  const scaled = BRADFORD.map((row, k) => row.map((value) => value * to[k] / from[k]));
  return product3(inverse3(srgb), product3(inverse3(BRADFORD), product3(scaled, own)));
}

function xyzOf(primaries) {
  if (primaries.length !== 8 || !primaries.every((each) => Math.abs(each) <= FARTHEST_PRIMARY) || !(primaries[7] > 0)) return null;
  const [red, green, blue, white] = [0, 2, 4, 6].map((k) => [primaries[k], primaries[k + 1], 1 - primaries[k] - primaries[k + 1]]);
  const columns = [0, 1, 2].map((k) => [red[k], green[k], blue[k]]), back = inverse3(columns);
  const amount = back && applied3(back, white.map((value) => value / primaries[7]));
  return amount?.every((value) => value > 0) ? columns.map((row) => row.map((value, k) => value * amount[k])) : null;
}

const applied3 = (matrix, vector) => matrix.map((row) => row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2]);

const product3 = (a, b) => a.map((row) => [0, 1, 2].map((k) => row[0] * b[0][k] + row[1] * b[1][k] + row[2] * b[2][k]));

function inverse3(m) {
  const minor = (i, k) => m[(i + 1) % 3][(k + 1) % 3] * m[(i + 2) % 3][(k + 2) % 3] - m[(i + 1) % 3][(k + 2) % 3] * m[(i + 2) % 3][(k + 1) % 3];
  const whole = m[0][0] * minor(0, 0) + m[0][1] * minor(0, 1) + m[0][2] * minor(0, 2);
  return Math.abs(whole) < SAME_PRIMARIES ? null : [0, 1, 2].map((i) => [0, 1, 2].map((k) => minor(k, i) / whole));
}
