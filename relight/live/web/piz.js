// Blocks of OpenEXR pictures that PIZ packed: Huffman codes of a Haar wavelet of 16-bit words. MIT licence.

const WORDS = 1 << 16, LONGEST = 58, SHORT_RUN = 59, LONG_RUN = 63, SHORTEST = 2 + LONG_RUN - SHORT_RUN;
const LOOKED_UP = 12; // bits of a code that a table holds

// The unpacked bytes of a block: row by row, channel by channel. channels: {size} in bytes of a value.
export function unpackPiz(packed, whole, channels, width, count) {
  const view = new DataView(packed.buffer, packed.byteOffset, packed.byteLength), { table, most, end } = valuesOf(view);
  const length = view.getInt32(end, true), words = new Uint16Array(whole / 2);
  if (length < 0 || end + 4 + length > packed.length) throw new RangeError();
  if (length) decodeHuffman(packed.subarray(end + 4, end + 4 + length), words);
  const starts = [];
  let at = 0;
  for (const { size } of channels) {
    starts.push(at);
    for (let part = 0; part < size / 2; part++) unwave(words, at + part, width, size / 2, count, width * size / 2, most);
    at += width * count * size / 2;
  }
  const plain = new Uint16Array(words.length);
  let to = 0;
  for (let row = 0; row < count; row++) {
    channels.forEach(({ size }, index) => {
      const across = width * size / 2, from = starts[index] + row * across;
      for (let i = 0; i < across; i++) plain[to++] = table[words[from + i]];
    });
  }
  return new Uint8Array(plain.buffer);
}

// The words that occur, in order; packed words index them. most: of the packed ones.
function valuesOf(view) {
  const least = view.getUint16(0, true), last = view.getUint16(2, true), table = new Uint16Array(WORDS);
  if (last >= WORDS / 8) throw new RangeError();
  let kept = 1, end = 4; // 0 always occurs
  for (let byte = least; byte <= last; byte++) {
    const bits = view.getUint8(end++);
    for (let bit = 0; bit < 8; bit++) if (bits >> bit & 1 && 8 * byte + bit) table[kept++] = 8 * byte + bit;
  }
  return { table, most: kept - 1, end };
}

// Bits of some bytes, the highest of each first.
class Bits {
  constructor(bytes, at) {
    Object.assign(this, { bytes, at, held: 0, count: 0 });
  }

  take(wanted) {
    while (this.count < wanted) {
      if (this.at >= this.bytes.length) throw new RangeError();
      this.held = (this.held << 8 | this.bytes[this.at++]) & 0xffffff;
      this.count += 8;
    }
    this.count -= wanted;
    return this.held >> this.count & (1 << wanted) - 1;
  }
}

// Fill `words` from the Huffman codes. The last symbol repeats the word before it; the next 8 bits are the count.
function decodeHuffman(bytes, words) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), first = view.getUint32(0, true), repeat = view.getUint32(4, true);
  if (first >= WORDS + 1 || repeat >= WORDS + 1) throw new RangeError();
  const bits = new Bits(bytes, 20), lengths = new Uint8Array(WORDS + 1);
  for (let symbol = first; symbol <= repeat;) {
    const length = bits.take(6);
    if (length < SHORT_RUN) lengths[symbol++] = length;
    else symbol += length === LONG_RUN ? bits.take(8) + SHORTEST : length - SHORT_RUN + 2;
  }
  const book = codesOf(lengths), data = new Bits(bytes, bits.at);
  for (let to = 0; to < words.length;) {
    const symbol = nextSymbol(data, book);
    if (symbol !== repeat) {
      words[to++] = symbol;
      continue;
    }
    const times = data.take(8);
    if (!to || to + times > words.length) throw new RangeError();
    words.fill(words[to - 1], to, to + times);
    to += times;
  }
}

// Canonical codes, the longest from 0 on: for each length the first code, how many, and their symbols in order. `quick`
// holds 64 times the symbol plus the length for every beginning of LOOKED_UP bits that has a whole code, else 0.
function codesOf(lengths) {
  const counts = new Array(LONGEST + 1).fill(0), first = new Array(LONGEST + 1).fill(0), offsets = new Array(LONGEST + 2).fill(0);
  for (const length of lengths) counts[length]++;
  counts[0] = 0;
  for (let length = LONGEST, code = 0; length > 0; length--) {
    first[length] = code;
    code = Math.floor((code + counts[length]) / 2);
  }
  for (let length = 1; length <= LONGEST; length++) offsets[length + 1] = offsets[length] + counts[length];
  const symbols = new Uint32Array(offsets[LONGEST + 1]), filled = offsets.slice(), quick = new Uint32Array(1 << LOOKED_UP);
  lengths.forEach((length, symbol) => {
    if (!length) return;
    const rank = filled[length]++ - offsets[length];
    symbols[offsets[length] + rank] = symbol;
    if (length > LOOKED_UP) return;
    const spare = LOOKED_UP - length, from = (first[length] + rank) * 2 ** spare;
    quick.fill(64 * symbol + length, from, from + 2 ** spare);
  });
  return { counts, first, offsets, symbols, quick };
}

function nextSymbol(data, { counts, first, offsets, symbols, quick }) {
  while (data.count < LOOKED_UP && data.at < data.bytes.length) {
    data.held = (data.held << 8 | data.bytes[data.at++]) & 0xffffff;
    data.count += 8;
  }
  if (data.count >= LOOKED_UP) {
    const found = quick[data.held >> data.count - LOOKED_UP & (1 << LOOKED_UP) - 1];
    if (found) {
      data.count -= found & 63;
      return found >> 6;
    }
  }
  for (let length = 1, code = 0; length <= LONGEST; length++) {
    code = 2 * code + data.take(1);
    const rank = code - first[length];
    if (rank >= 0 && rank < counts[length]) return symbols[offsets[length] + rank];
  }
  throw new RangeError();
}

// Undo the wavelet of a channel, in place: `across` words from pixel to pixel, `down` from row to row, none above `most`.
function unwave(words, start, width, across, height, down, most) {
  const undo = most < 1 << 14 ? pair14 : pair16, both = [0, 0];
  const at = (a, b) => {
    undo(words[a], words[b], both);
    [words[a], words[b]] = both;
  };
  let step = 1;
  while (2 * step <= Math.min(width, height)) step *= 2;
  for (let half = step >> 1; half >= 1; step = half, half >>= 1) {
    const right = across * half, below = down * half;
    let y = 0;
    for (; y + step <= height; y += step) {
      let x = 0;
      for (; x + step <= width; x += step) {
        const p = start + y * down + x * across;
        at(p, p + below);
        at(p + right, p + below + right);
        at(p, p + right);
        at(p + below, p + below + right);
      }
      if (width & half) at(start + y * down + x * across, start + y * down + x * across + below);
    }
    if (!(height & half)) continue;
    for (let x = 0; x + step <= width; x += step) at(start + y * down + x * across, start + y * down + x * across + right);
  }
}

// A mean and a difference back to two words: signed where 14 bits suffice, else modulo 65,536.
function pair14(low, high, both) {
  const difference = high << 16 >> 16, first = (low << 16 >> 16) + (difference & 1) + (difference >> 1);
  both[0] = first;
  both[1] = first - difference;
}

function pair16(low, high, both) {
  both[1] = low - (high >> 1) & 0xffff;
  both[0] = high + both[1] - 0x8000 & 0xffff;
}
