// The network of the Neural-GASh paper on vertices that move (docs/networks.md): motors, light turned by rotors, and the network
// on the processor, by WebAssembly that is assembled here. relight_gash_card.mjs runs it on the graphics card. No dependencies.
//
//   const network = readNetwork(await (await fetch("neural-gash.bin")).arrayBuffer());
//   const run = await onProcessor(network), frame = frameOf(points);   // the pose at rest
//   const colors = radiance(run(motors(points, normals, frame)), turned(sh, about([0, 1, 0], 45)));
//
// Points and normals are three numbers a vertex, in relight's frame: right-handed, y up, as in glTF and three.js.

export const NUMBERS = 32, COEFFICIENTS = 27;
export const MAGIC = 0x48534147, VERSION = 1;
const DEGENERATE = 1e-6;  // a normal shorter than this has no direction
const BLOCK = 32;  // vertices at once: their activations stay in the second cache

// neural-gash.bin of make_gash.py: layers of { inputs, outputs, quads, weights, biases }. Outputs are padded to whole quads; the
// weights of a quad stand together, four for each input. Throws, in one line, for another file.
export function readNetwork(buffer) {
    const view = new DataView(buffer), layers = [];
    if (buffer.byteLength < 12 || view.getUint32(0, true) !== MAGIC) throw new Error("not neural-gash.bin");
    const version = view.getUint32(4, true), count = view.getUint32(8, true);
    if (version > VERSION) throw new Error(`neural-gash.bin: version ${version}, this loader reads ${VERSION}`);
    let at = 16 + 4 * count;
    if (at > buffer.byteLength) throw new Error("neural-gash.bin is cut short");
    const sizes = Array.from({ length: count + 1 }, (_, i) => view.getUint32(12 + 4 * i, true));
    const length = sizes.slice(1).reduce((sum, outputs, k) => sum + outputs * (8 + 2 * sizes[k]), at);
    if (length !== buffer.byteLength) throw new Error("neural-gash.bin is cut short");
    if (sizes[0] !== NUMBERS || sizes[count] !== COEFFICIENTS) throw new Error("neural-gash.bin is no network of motors");
    for (let k = 0; k < count; k++) {
        const inputs = sizes[k], outputs = sizes[k + 1], quads = Math.ceil(outputs / 4);
        const weights = new Float32Array(4 * quads * inputs), biases = new Float32Array(4 * quads);
        for (let o = 0; o < outputs; o++) {
            const scale = view.getFloat32(at + 4 * o, true), row = at + 8 * outputs + 2 * inputs * o, first = (o >> 2) * inputs * 4 + (o & 3);
            biases[o] = view.getFloat32(at + 4 * (outputs + o), true);
            for (let i = 0; i < inputs; i++) weights[first + 4 * i] = scale * view.getInt16(row + 2 * i, true);
        }
        at += outputs * (8 + 2 * inputs);
        layers.push({ inputs, outputs, quads, weights, biases });
    }
    return layers;
}

// The network's frame: the middle of the box of these points goes to 0, half of its diagonal becomes 1. It is that of the pose at
// rest, so that no motion changes what rests.
export function frameOf(points) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    points.forEach((value, i) => {
        low[i % 3] = Math.min(low[i % 3], value);
        high[i % 3] = Math.max(high[i % 3], value);
    });
    if (!points.length) return { middle: [0, 0, 0], half: 1 };
    return { middle: low.map((value, i) => (value + high[i]) / 2), half: Math.hypot(...low.map((value, i) => (high[i] - value) / 2)) || 1 };
}

// The motors T R of vertices, 32 numbers each: R takes +y to the normal, T the origin to the point (relight/sh/cga.py). Normals may
// have any length, and are +y where they have none.
export function motors(points, normals, { middle, half }, result = new Float32Array(points.length / 3 * NUMBERS)) {
    for (let v = 0, row = 0; v < points.length; v += 3, row += NUMBERS) {
        const x = (points[v] - middle[0]) / half, y = (points[v + 1] - middle[1]) / half, z = (points[v + 2] - middle[2]) / half;
        let nx = normals[v], ny = normals[v + 1], nz = normals[v + 2];
        const length = Math.sqrt(nx * nx + ny * ny + nz * nz);
        if (length > DEGENERATE && length < Infinity) [nx, ny, nz] = [Math.fround(nx / length), Math.fround(ny / length), Math.fround(nz / length)];
        else [nx, ny, nz] = [0, 1, 0];
        const flat = nx * nx + nz * nz, lean = Math.sqrt(flat), unit = Math.sqrt(flat + ny * ny);
        let s = 0, e12 = 0, e23 = -1;
        if (ny >= 0) [s, e12, e23] = [unit + ny, nx, -nz];
        else if (lean > 0) [s, e12, e23] = [lean, nx * (unit - ny) / lean, -nz * (unit - ny) / lean];  // 1 + y cancels there
        const scale = 1 / Math.sqrt(s * s + e12 * e12 + e23 * e23);
        s *= scale; e12 *= scale; e23 *= scale;
        result[row] = s;
        result[row + 6] = e12;
        result[row + 10] = e23;
        result[row + 8] = result[row + 9] = -0.5 * (x * s - y * e12);
        result[row + 11] = result[row + 12] = -0.5 * (y * s + x * e12 - z * e23);
        result[row + 13] = result[row + 14] = -0.5 * (z * s + y * e23);
        result[row + 26] = result[row + 27] = -0.5 * (x * e23 + z * e12);
    }
    return result;
}

// The rotor [1, e12, e13, e23] of a turn about an axis of any length but 0, right-handed, in degrees.
export function about([x, y, z], degrees) {
    const sine = Math.sin(degrees * Math.PI / 360) / Math.hypot(x, y, z);
    return [Math.cos(degrees * Math.PI / 360), -z * sine, y * sine, -x * sine];
}

// Nine radiance coefficients [[r, g, b] x 9] of light turned by a rotor: band 1 is a vector, band 2 a symmetric form.
export function turned(sh, [w, e12, e13, e23]) {
    const x = -e23, y = e13, z = -e12, n = 2 / (w * w + x * x + y * y + z * z), mixed = 1.0925484305920792, zonal = 0.31539156525252005, square = 0.54627421529603959;
    const axes = [
        [1 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y)],
        [n * (x * y + w * z), 1 - n * (x * x + z * z), n * (y * z - w * x)],
        [n * (x * z - w * y), n * (y * z + w * x), 1 - n * (x * x + y * y)],
    ];
    const result = sh.map((row) => [...row]);
    for (let c = 0; c < 3; c++) {
        const l = sh.map((row) => row[c]), even = zonal * l[6], odd = square * l[8], [xy, yz, xz] = [l[4], l[5], l[7]].map((value) => mixed * value / 2);
        const form = [[odd - even, xy, xz], [xy, -odd - even, yz], [xz, yz, 2 * even]];
        const at = (i, j) => form.reduce((sum, row, k) => sum + axes[i][k] * row.reduce((part, value, m) => part + value * axes[j][m], 0), 0);
        [3, 1, 2].forEach((j, i) => { result[j][c] = axes[i][0] * l[3] + axes[i][1] * l[1] + axes[i][2] * l[2]; });
        result[4][c] = 2 * at(0, 1) / mixed;
        result[5][c] = 2 * at(1, 2) / mixed;
        result[6][c] = at(2, 2) / (2 * zonal);
        result[7][c] = 2 * at(0, 2) / mixed;
        result[8][c] = (at(0, 0) - at(1, 1)) / (2 * square);
    }
    return result;
}

// Linear radiance of white vertices, three numbers each, not exposed. outputs: of the network; the transfer is the mean of its
// colours, with the visible fraction of the sky cut to 0 and 1. sh: nine radiance coefficients.
export function radiance(outputs, sh, result = new Float32Array(outputs.length / 9)) {
    const most = Math.sqrt(0.25 / Math.PI);
    for (let row = 0, at = 0; row < outputs.length; row += COEFFICIENTS, at += 3) {
        let red = 0, green = 0, blue = 0;
        for (let j = 0; j < 9; j++) {
            let transfer = (outputs[row + 3 * j] + outputs[row + 3 * j + 1] + outputs[row + 3 * j + 2]) / 3;
            if (j === 0) transfer = Math.max(0, Math.min(most, transfer));
            red += transfer * sh[j][0];
            green += transfer * sh[j][1];
            blue += transfer * sh[j][2];
        }
        result[at] = Math.max(red, 0);
        result[at + 1] = Math.max(green, 0);
        result[at + 2] = Math.max(blue, 0);
    }
    return result;
}

// A function from motors to the 27 coefficients of each vertex, on one core, in blocks of vertices.
export async function onProcessor(network) {
    const widest = Math.max(NUMBERS, ...network.map(({ quads }) => 4 * quads));
    const floats = 2 * widest * BLOCK + network.reduce((sum, { weights, biases }) => sum + weights.length + biases.length, 0);
    const memory = new WebAssembly.Memory({ initial: Math.ceil(4 * floats / 65536) }), numbers = new Float32Array(memory.buffer);
    const { exports } = await WebAssembly.instantiate(await WebAssembly.compile(assembled()), { e: { m: memory } });
    let free = 2 * widest * BLOCK;
    const placed = network.map(({ inputs, quads, weights, biases }) => {
        const [first, second] = [free, free + weights.length];
        numbers.set(weights, first);
        numbers.set(biases, second);
        free = second + biases.length;
        return { inputs, quads, weights: 4 * first, biases: 4 * second };
    });
    return (given, result = new Float32Array(given.length / NUMBERS * COEFFICIENTS)) => {
        const count = given.length / NUMBERS;
        for (let start = 0; start < count; start += BLOCK) {
            const block = Math.min(BLOCK, count - start);
            let from = 0, to = widest * BLOCK;
            for (let i = 0; i < NUMBERS; i++)
                for (let v = 0; v < BLOCK; v++) numbers[i * BLOCK + v] = v < block ? given[(start + v) * NUMBERS + i] : 0;
            placed.forEach(({ inputs, quads, weights, biases }, k) => {
                exports.product(4 * from, weights, biases, 4 * to, inputs, quads);
                if (k + 1 < placed.length) exports.bend(4 * to, 4 * (to + 4 * quads * BLOCK));
                [from, to] = [to, from];
            });
            for (let v = 0; v < block; v++)
                for (let j = 0; j < COEFFICIENTS; j++) result[(start + v) * COEFFICIENTS + j] = numbers[from + j * BLOCK + v];
        }
        return result;
    };
}

// The module: product(values, weights, biases, results, inputs, quads) of one layer, and bend(from, to), x / (1 + exp(-x)). Values
// stand input after input, BLOCK vertices each, so that a vector is four vertices. Addresses are in bytes.
export function assembled() {
    const uint = (n) => n < 128 ? [n] : [n & 127 | 128, ...uint(n >>> 7)];
    const int = (n) => n >= -64 && n < 64 ? [n & 127] : [n & 127 | 128, ...int(n >> 7)];
    const get = (i) => [0x20, i], set = (i) => [0x21, i], tee = (i) => [0x22, i], i32 = (n) => [0x41, ...int(n)];
    const simd = (code) => [0xfd, ...uint(code)], at = (code, offset = 0) => [...simd(code), 2, ...uint(offset)];
    const splat = (value) => [0x43, ...new Uint8Array(new Float32Array([value]).buffer), ...simd(0x13)];
    const add = (i, n) => [...get(i), ...i32(n), 0x6a, ...set(i)];
    const [load, loadSplat, store] = [0x00, 0x09, 0x0b], [plus, minus, times, over, least, most] = [0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9].map(simd);
    const until = (i, end, body) => [0x03, 0x40, ...body, ...get(i), ...get(end), 0x49, 0x0d, 0, 0x0b];  // while i < end, unsigned
    const name = (text) => [text.length, ...[...text].map((letter) => letter.charCodeAt(0))];
    const section = (id, ...parts) => { const body = [...uint(parts.length), ...parts.flat()]; return [id, ...uint(body.length), ...body]; };
    const code = (locals, ...body) => { const all = [...locals, ...body.flat(), 0x0b]; return [...uint(all.length), ...all]; };
    const row = 4 * BLOCK;

    // Parameters 0 to 5, then 6: vertex, 7: value, 8: weight, 9: end of values, 10: end of weights, 11: end of vertices; 12 to 19:
    // sums of 8 vertices and 4 outputs; 20, 21: values.
    const sums = [0, 1, 2, 3].flatMap((k) => [0, 1].map((half) => [k, half, 12 + 2 * k + half]));
    const product = code([2, 6, 0x7f, 10, 0x7b],
        get(5), get(4), 0x6c, i32(16), 0x6c, get(1), 0x6a, set(10),
        until(1, 10, [
            ...i32(0), ...set(6), ...i32(row), ...set(11),
            ...until(6, 11, [
                ...sums.flatMap(([k, , sum]) => [...get(2), ...at(loadSplat, 4 * k), ...set(sum)]),
                ...get(0), ...get(6), 0x6a, ...tee(7), ...get(4), ...i32(row), 0x6c, 0x6a, ...set(9), ...get(1), ...set(8),
                ...until(7, 9, [
                    ...get(7), ...at(load), ...set(20), ...get(7), ...at(load, 16), ...set(21),
                    ...sums.flatMap(([k, half, sum]) => [...get(sum), ...get(20 + half), ...get(8), ...at(loadSplat, 4 * k), ...times, ...plus, ...set(sum)]),
                    ...add(7, row), ...add(8, 16),
                ]),
                ...sums.flatMap(([k, half, sum]) => [...get(3), ...get(6), 0x6a, ...get(sum), ...at(store, k * row + 16 * half)]),
                ...add(6, 32),
            ]),
            ...get(8), ...set(1), ...add(2, 16), ...add(3, 4 * row),
        ]));

    // exp(-x) = 2^n 2^f with n whole: n goes into the exponent, 2^f is its series, whose seventh term is below a rounding. 2: x, 3: t, f, 4: n.
    const series = [6, 5, 4, 3, 2, 1, 0].map((k) => Math.LN2 ** k / [1, 1, 2, 6, 24, 120, 720][k]);
    const bend = code([1, 3, 0x7b],
        until(0, 1, [
            ...get(0), ...get(0), ...at(load), ...tee(2),
            ...get(2), ...splat(-Math.LOG2E), ...times, ...splat(-126), ...most, ...splat(126), ...least, ...tee(3),
            ...get(3), ...simd(0x6a), ...tee(4), ...minus, ...set(3),
            ...splat(series[0]), ...series.slice(1).flatMap((each) => [...get(3), ...times, ...splat(each), ...plus]),
            ...get(4), ...simd(0xf8), ...i32(127), ...simd(0x11), ...simd(0xae), ...i32(23), ...simd(0xab), ...times,
            ...splat(1), ...plus, ...over, ...at(store), ...add(0, 16),
        ]));

    return new Uint8Array([
        0, 0x61, 0x73, 0x6d, 1, 0, 0, 0,
        ...section(1, [0x60, 6, 0x7f, 0x7f, 0x7f, 0x7f, 0x7f, 0x7f, 0], [0x60, 2, 0x7f, 0x7f, 0]),
        ...section(2, [...name("e"), ...name("m"), 2, 0, 1]),
        ...section(3, [0], [1]),
        ...section(7, [...name("product"), 0, 0], [...name("bend"), 0, 1]),
        ...section(10, product, bend),
    ]);
}
