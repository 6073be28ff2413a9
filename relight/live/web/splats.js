// Splat files: PlayCanvas compressed PLY in, INRIA PLY out; the positions and faces of the proxy. MIT licence.

const SH_C0 = 0.28209479177387814;

// A compressed PLY: {count, means (N, 3), colors (N, 3) sRGB bytes, opacities (N) bytes, degree, row(n)}. Throws an Error of one line.
export function readCompressed(bytes) {
  const end = find(bytes, "end_header\n"), header = new TextDecoder().decode(bytes.subarray(0, Math.max(end, 0)));
  const elements = {};
  let current = null;
  for (const line of header.split("\n")) {
    const [word, kind, name] = line.split(" ");
    if (word === "element") elements[kind] = current = { count: +name, names: [] };
    if (word === "property") current.names.push(name);
  }
  const { chunk, vertex, sh } = elements;
  if (end < 0 || !chunk || !vertex || vertex.names[0] !== "packed_position") throw new Error("expected a compressed splat PLY");
  const count = vertex.count, bounds = chunk.names.length, rest = sh ? sh.names.length : 0, start = end + 11;
  const size = chunk.count * bounds * 4 + count * 16 + count * rest;
  if (bytes.length - start < size) throw new Error("a compressed splat PLY that is cut short: copy it again");
  const data = bytes.slice(start, start + size).buffer;
  const chunks = new Float32Array(data, 0, chunk.count * bounds), packed = new Uint32Array(data, chunks.byteLength, count * 4);
  const harmonics = new Uint8Array(data, chunks.byteLength + packed.byteLength, count * rest);
  const at = Object.fromEntries(chunk.names.map((name, i) => [name, i]));
  const stretch = (n, axis, share) => {
    const base = (n >> 8) * bounds, low = chunks[base + at[`min_${axis}`]];
    return low + (chunks[base + at[`max_${axis}`]] - low) * share;
  };
  const colored = "min_r" in at;
  let held = null;
  // Positions and colours of all, once something asks for them.
  const all = () => {
    if (held) return held;
    const means = new Float32Array(count * 3), colors = new Uint8Array(count * 3);
    for (let first = 0; first < count; first += 256) {
      const base = (first >> 8) * bounds, end = Math.min(first + 256, count), range = (axis, most) => [chunks[base + at[`min_${axis}`]], (chunks[base + at[`max_${axis}`]] - chunks[base + at[`min_${axis}`]]) / most];
      const [x, wide] = range("x", 2047), [y, high] = range("y", 1023), [z, deep] = range("z", 2047);
      for (let n = first, i = 3 * first; n < end; n++, i += 3) {
        const position = packed[4 * n];
        means[i] = x + wide * (position >>> 21);
        means[i + 1] = y + high * (position >>> 11 & 1023);
        means[i + 2] = z + deep * (position & 2047);
      }
      for (let k = 0; k < 3; k++) {
        const [low, step] = colored ? range("rgb"[k], 1) : [0, 1], shift = 24 - 8 * k;
        for (let n = first, i = 3 * first + k; n < end; n++, i += 3) {
          const shown = Math.round(255 * (low + step * ((packed[4 * n + 3] >>> shift & 255) / 255)));
          colors[i] = shown < 0 ? 0 : shown > 255 ? 255 : shown;
        }
      }
    }
    return held = { means, colors };
  };
  // One splat in full: as in an INRIA PLY, except for its colour, which is a display value.
  const row = (n) => {
    const scale = packed[4 * n + 2], turn = packed[4 * n + 1], color = packed[4 * n + 3];
    const small = [turn >>> 20 & 1023, turn >>> 10 & 1023, turn & 1023].map((value) => (value / 1023 - 0.5) * Math.SQRT2);
    const quat = [...small];
    quat.splice(turn >>> 30, 0, Math.sqrt(Math.max(0, 1 - small.reduce((sum, value) => sum + value * value, 0))));
    const opacity = Math.min(Math.max((color & 255) / 255, 1e-6), 1 - 1e-6);
    const shares = [0, 1, 2].map((k) => (color >>> 24 - 8 * k & 255) / 255);
    return {
      mean: all().means.subarray(3 * n, 3 * n + 3), quat, opacity: Math.log(opacity / (1 - opacity)),
      scale: [stretch(n, "scale_x", (scale >>> 21) / 2047), stretch(n, "scale_y", (scale >>> 11 & 1023) / 1023), stretch(n, "scale_z", (scale & 2047) / 2047)],
      color: colored ? shares.map((share, k) => stretch(n, "rgb"[k], share)) : shares,
      rest: Array.from(harmonics.subarray(n * rest, (n + 1) * rest), (cell) => cell === 0 ? -4 : cell === 255 ? 4 : (cell + 0.5) / 32 - 4),
    };
  };
  return { count, rest, row, get opacities() { return Uint8Array.from({ length: count }, (_, n) => packed[4 * n + 3] & 255); }, get means() { return all().means; }, get colors() { return all().colors; } };
}

// The splats in the light of `gains` (N, 4), as `live.gains` leaves them: the bytes of an INRIA PLY.
export function relitPly(splats, gains, unit, most) {
  const names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
  for (let i = 0; i < splats.rest; i++) names.push(`f_rest_${i}`);
  names.push("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3");
  const header = new TextEncoder().encode(`ply\nformat binary_little_endian 1.0\nelement vertex ${splats.count}\n${names.map((name) => `property float ${name}\n`).join("")}end_header\n`);
  const body = new Float32Array(splats.count * names.length), channel = splats.rest / 3;
  for (let n = 0, to = 0; n < splats.count; n++) {
    const { mean, color, rest, opacity, scale, quat } = splats.row(n);
    const gain = [0, 1, 2].map((k) => gains[4 * n + k] / unit), shown = gains[4 * n + 3] === 1;
    body.set(mean, to);
    to += 6;
    for (let k = 0; k < 3; k++) body[to++] = ((shown ? gain[k] : gain[k] * (color[k] + 0.055) - 0.055) - 0.5) / SH_C0;
    for (let i = 0; i < splats.rest; i++) {
      const k = Math.floor(i / channel);
      body[to++] = shown ? 0 : rest[i] * Math.min(gain[k], most[k]);
    }
    for (const value of [opacity, ...scale, ...quat]) body[to++] = value;
  }
  const bytes = new Uint8Array(header.length + body.byteLength);
  bytes.set(header);
  bytes.set(new Uint8Array(body.buffer), header.length);
  return bytes;
}

// Positions (V, 3) and indices (F, 3) of proxy.glb, as written by this project.
export function readProxy(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length), length = view.getUint32(12, true);
  const document = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + length)));
  const { attributes, indices } = document.meshes[0].primitives[0];
  const read = (accessor, Type, width) => {
    const { bufferView, count } = document.accessors[accessor], offset = 28 + length + (document.bufferViews[bufferView].byteOffset ?? 0);
    return new Type(bytes.slice(offset, offset + count * width * 4).buffer);
  };
  return { positions: read(attributes.POSITION, Float32Array, 3), indices: read(indices, Uint32Array, 1) };
}

function find(bytes, text) {
  const wanted = new TextEncoder().encode(text), most = Math.min(bytes.length, 1 << 16) - wanted.length;
  for (let i = 0; i <= most; i++) {
    let k = 0;
    while (k < wanted.length && bytes[i + k] === wanted[k]) k++;
    if (k === wanted.length) return i;
  }
  return -1;
}
