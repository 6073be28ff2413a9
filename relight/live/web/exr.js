// OpenEXR pictures: one part, scanlines, half or float, uncompressed or by RLE, ZIP, ZIPS and PIZ. MIT licence.
// After the layout of openexr.com/en/latest/OpenEXRFileLayout.html.

import { unpackPiz } from "./piz.js";
import { toSrgb } from "./primaries.js";

const MAGIC = 20000630, TILED = 0x200, DEEP = 0x800, PARTS = 0x1000;
const ROWS = { 0: 1, 1: 1, 2: 1, 3: 16, 4: 32 }; // of a block, by compression
const OTHERS = { 5: "PXR24", 6: "B44", 7: "B44A", 8: "DWAA", 9: "DWAB", 10: "HTJ2K" };
const UINT = 0, HALF = 1, FLOAT = 2, BYTES = { [UINT]: 4, [HALF]: 2, [FLOAT]: 4 };
const COMBINED = ["combined", "beauty", "rgba"]; // as relight/light/environment_files.py
const MOST_PIXELS = 1 << 27;

// An .exr: {width, height, image} from the top row down, image width x height x 3, linear. Throws an Error of one line.
export async function readExr(bytes) {
  try {
    return await read(bytes);
  } catch (error) {
    throw error instanceof RangeError ? new Error("an .exr that is cut short or damaged: copy it again") : error;
  }
}

async function read(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), { attributes, flags, end } = header(view);
  if (flags & (TILED | DEEP | PARTS)) throw new Error("an .exr of tiles or several parts: save it as one part of scanlines");
  const compression = view.getUint8(attributes.compression), rows = ROWS[compression];
  if (!rows) throw new Error(`an .exr packed by ${OTHERS[compression] ?? compression}: save it with ZIP or PIZ`);
  const [left, top, right, bottom] = [0, 4, 8, 12].map((at) => view.getInt32(attributes.dataWindow + at, true));
  const width = right - left + 1, height = bottom - top + 1;
  if (!(width > 0 && height > 0 && width * height <= MOST_PIXELS)) throw new Error(`an .exr of ${width} x ${height}: expected up to 16384 x 8192`);
  const channels = channelsOf(view, attributes.channels), shown = colorsOf(channels);
  const image = new Float32Array(width * height * 3), blocks = Math.ceil(height / rows);
  const row = width * channels.reduce((sum, { size }) => sum + size, 0);
  for (let block = 0; block < blocks; block++) {
    const at = Number(view.getBigUint64(end + 8 * block, true)), first = view.getInt32(at, true) - top, size = view.getInt32(at + 4, true);
    const count = Math.min(rows, height - first), whole = count * row;
    if (first < 0 || count <= 0 || size < 0 || at + 8 + size > bytes.length) throw new RangeError();
    const packed = bytes.subarray(at + 8, at + 8 + size);
    const plain = size === whole ? packed : await unpacked(compression, packed, whole, channels, width, count);
    place(plain, channels, shown, width, count, image, first * width);
  }
  if ("chromaticities" in attributes) toSrgb(image, [0, 1, 2, 3, 4, 5, 6, 7].map((k) => view.getFloat32(attributes.chromaticities + 4 * k, true)));
  return { width, height, image };
}

// Where each attribute's value begins, the flags, and where the header ends.
function header(view) {
  if (view.byteLength < 8 || view.getInt32(0, true) !== MAGIC) throw new Error("not an OpenEXR picture");
  const attributes = {};
  let at = 8;
  const text = () => {
    let found = "";
    for (let code = view.getUint8(at++); code; code = view.getUint8(at++)) found += String.fromCharCode(code);
    return found;
  };
  for (let name = text(); name; name = text()) {
    text();
    const size = view.getInt32(at, true);
    if (size < 0) throw new RangeError();
    attributes[name] = at + 4;
    at += 4 + size;
  }
  for (const name of ["channels", "compression", "dataWindow"]) if (!(name in attributes)) throw new Error(`an .exr without ${name}`);
  return { attributes, flags: view.getUint32(4, true) & ~0xff, end: at };
}

// Channels in the order of the file: {name, type, size}, size in bytes of a value.
function channelsOf(view, start) {
  const found = [];
  for (let at = start; view.getUint8(at); at += 16) {
    let name = "";
    for (let code = view.getUint8(at++); code; code = view.getUint8(at++)) name += String.fromCharCode(code);
    const type = view.getInt32(at, true);
    if (!(type in BYTES)) throw new RangeError();
    if (view.getInt32(at + 8, true) !== 1 || view.getInt32(at + 12, true) !== 1) throw new Error("an .exr with channels of fewer pixels: save it as RGB");
    found.push({ name, type, size: BYTES[type] });
  }
  return found;
}

// Rows of `channels` that are red, green and blue: of the picture itself, else grey, else of Combined or the first layer.
function colorsOf(channels) {
  const names = channels.map(({ name }) => name), layers = names.filter((name) => name.endsWith(".R"));
  const combined = layers.find((name) => name.toLowerCase().split(".").some((word) => COMBINED.includes(word)));
  const red = names.includes("R") ? "R" : names.includes("Y") ? undefined : combined ?? layers[0];
  if (red !== undefined) {
    const found = ["R", "G", "B"].map((color) => names.indexOf(red.slice(0, -1) + color));
    if (found.every((index) => index >= 0)) return found;
  }
  const grey = names.indexOf("Y");
  if (grey < 0) throw new Error(`an .exr without R, G and B: it has ${names.join(", ")}`);
  return [grey, grey, grey];
}

async function unpacked(compression, packed, whole, channels, width, count) {
  if (compression === 4) return unpackPiz(packed, whole, channels, width, count);
  const bytes = compression === 1 ? runs(packed, whole) : await inflated(packed);
  if (bytes.length !== whole) throw new RangeError();
  for (let i = 1; i < whole; i++) bytes[i] += bytes[i - 1] - 128;
  const plain = new Uint8Array(whole), half = whole + 1 >> 1;
  for (let i = 0; i < whole; i++) plain[i] = bytes[i & 1 ? half + (i >> 1) : i >> 1];
  return plain;
}

async function inflated(packed) {
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  try {
    return new Uint8Array(await new Response(stream).arrayBuffer());
  } catch {
    throw new RangeError();
  }
}

function runs(packed, whole) {
  const bytes = new Uint8Array(whole);
  let to = 0;
  for (let at = 0; at < packed.length;) {
    const count = packed[at++] << 24 >> 24;
    if (count < 0) {
      bytes.set(packed.subarray(at, at - count), to);
      at -= count;
      to -= count;
    } else {
      bytes.fill(packed[at++], to, to + count + 1);
      to += count + 1;
    }
  }
  if (to !== whole) throw new RangeError();
  return bytes;
}

// Write the colours of a block into the image, from a pixel on. Light below zero and what is no number are black.
function place(plain, channels, shown, width, count, image, from) {
  const view = new DataView(plain.buffer, plain.byteOffset, plain.byteLength);
  let at = 0;
  for (let row = 0; row < count; row++) {
    channels.forEach(({ type, size }, index) => {
      shown.forEach((wanted, k) => {
        if (wanted !== index) return;
        for (let x = 0; x < width; x++) {
          const value = type === HALF ? fromHalf(view.getUint16(at + x * size, true)) : type === FLOAT ? view.getFloat32(at + x * size, true) : view.getUint32(at + x * size, true);
          image[(from + row * width + x) * 3 + k] = value > 0 && value < Infinity ? value : 0;
        }
      });
      at += width * size;
    });
  }
}

function fromHalf(bits) {
  const exponent = bits >> 10 & 31, fraction = bits & 1023, sign = bits & 0x8000 ? -1 : 1;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (exponent ? (1 + fraction / 1024) * 2 ** (exponent - 15) : fraction * 2 ** -24);
}
