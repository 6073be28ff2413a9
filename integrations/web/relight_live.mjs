// Live light on splats: reads the bundle of `relight SCENE --format live` (docs/live.md) and turns a light into what
// shaders look up. Shared by the loaders of PlayCanvas and Spark; has no dependencies.
//
// Suns are kept in the harmonics here, so that their shadows are soft: 10 bands resolve about 18 degrees.

export const FORMAT = "relight-live";
export const VERSION = 2;
const LEAST = 2 ** -20;  // least change that is passed to shaders: invisible on any display
const SKY = 2;  // kind of far background, which shows the light itself; 1 is lit, 0 stays as captured

// A bundle: { meta, count, clusters, weights, rows (Uint32Array, words a splat), words, basis, terms, splat: { file, bytes } }.
// folder: its address. splat: which of its files is shown. Throws, in one line, for what is not of this bundle.
export async function readBundle(folder, splat = "splat.compressed.ply", get = fetched) {
    const meta = JSON.parse(new TextDecoder().decode(await get(`${folder}/live.json`)));
    if (meta.format !== FORMAT) throw new Error(`${folder}/live.json: not a bundle of live light`);
    if (meta.version > VERSION) throw new Error(`${folder}: version ${meta.version}, this loader reads ${VERSION}`);
    const entry = meta.splats.find((each) => each.file === splat);
    if (!entry) throw new Error(`${splat}: the bundle names ${meta.splats.map((each) => each.file).join(", ")}`);
    const bytes = await get(`${folder}/${splat}`);
    await check(bytes, entry, meta.count);
    const { clusters, weights } = meta.basis, basis = basisOf(await get(`${folder}/basis.bin`), meta.basis);
    const words = (2 + weights) / 4;
    const rows = packed(await get(`${folder}/transfer.bin`), await get(`${folder}/surface.bin`), meta.count, 2 + weights);
    const terms = meta.terms?.length ? termsOf(meta.terms, await get(`${folder}/terms.bin`)) : [];
    return { meta, count: meta.count, clusters, weights, words, rows, basis, terms, folder, splat: { file: splat, bytes } };
}

// Light beside the environment, of terms.bin: runs of rows, and what their bytes are, of each. Without runs it is 1.
function termsOf(entries, bytes) {
    let at = 0;
    const take = (size) => {
        if (at + size > bytes.length) throw new Error("terms.bin is cut short");
        at += size;
        return bytes.slice(at - size, at);
    };
    return entries.map(({ kind, name, color, mean, runs, rows, peak, steps }) => ({
        kind, name, color, mean,
        runs: runs === null ? null : new Uint32Array(take(8 * runs).buffer),
        rows: runs === null ? null : take(3 * rows),
        values: peak.map((most) => Float32Array.from({ length: 256 }, (_, byte) => byte && most * 2 ** ((byte - 255) / steps))),
    }));
}

// What is beside the environment: `captured`, how much of the captured light there is, and `lamps`, of each its name, its
// colour (linear, luminance 1), `ev`, and whether it is on. Without terms there is nothing of either.
export class Beside {
    constructor(bundle) {
        this._bundle = bundle;
        this.captured = 0;
        this.lamps = bundle.terms.filter(({ kind }) => kind === "lamp").map(({ name, color }) => ({ name, color: [...color], ev: 0, on: true }));
    }

    // Begin as the bundle says, under a light of it.
    choose(light) {
        this.captured = light.captured ?? 0;
    }

    // Linear change that it adds to every splat under a light, 3 floats each. Under the light of the capture far background
    // is dimmed with it.
    changes(light, exposure = light.exposure) {
        const { count, terms, rows: words, words: size } = this._bundle, result = new Float32Array(3 * count);
        const unit = (light.unit ?? 1) * exposure / light.exposure;
        let lamp = 0;
        for (const { kind, color, runs, rows, values } of terms) {
            const own = kind === "captured", { on, ev, color: tint } = own ? { on: true, ev: 0, color } : this.lamps[lamp++];
            const factor = tint.map((value) => on ? value * unit * (own ? this.captured : 2 ** ev) : 0);
            if (!runs) for (let i = 0; i < 3 * count; i++) result[i] += factor[i % 3];
            else {
                for (let run = 0, at = 0; run < runs.length; run += 2) {
                    for (let i = 3 * runs[run], end = i + 3 * runs[run + 1]; i < end; i++, at++) result[i] += factor[i % 3] * values[i % 3][rows[at]];
                }
            }
        }
        const dimmed = this.captured * unit;
        for (let i = 0; i < count; i++) {
            if ((words[i * size] >>> 14 & 3) === SKY) result.fill(light.sky === "captured" ? Math.max(dimmed, LEAST) : 0, 3 * i, 3 * i + 3);
        }
        return result;
    }

    // The same as shaders take it: a word a splat, three mantissas of 9 bits and an exponent, as RGB9E5.
    packed(light, exposure) {
        const changes = this.changes(light, exposure), result = new Uint32Array(changes.length / 3);
        for (let i = 0; i < result.length; i++) {
            const most = Math.min(Math.max(changes[3 * i], changes[3 * i + 1], changes[3 * i + 2]), 65000);
            if (!(most >= LEAST)) continue;
            const exponent = Math.max(Math.floor(Math.log2(most)) + 1, -15), step = 2 ** (exponent - 9);
            let word = exponent + 15 << 27;
            for (let k = 0; k < 3; k++) word |= Math.min(Math.round(Math.min(changes[3 * i + k], most) / step), 511) << 9 * k;
            result[i] = word;
        }
        return result;
    }
}


// basis.bin: the directions in which responses differ, of which clusters have means and components.
function basisOf(bytes, { clusters, weights, directions, direct, spread, lamps }) {
    let at = 0;
    const take = (Type, count) => {
        const part = new Type(bytes.slice(at, at + count * Type.BYTES_PER_ELEMENT).buffer);
        if (part.length !== count) throw new Error("basis.bin is cut short");
        at += part.byteLength;
        return part;
    };
    return {
        directions, numbers: 3 * (direct + spread + lamps),
        directionScales: take(Float32Array, 1 + directions),
        coefficients: take(Int16Array, (1 + directions) * 3 * (direct + spread + lamps)),
        scales: take(Float32Array, clusters * (1 + weights)),
        means: take(Int16Array, clusters * directions),
        components: take(Int8Array, clusters * weights * directions),
    };
}

// Refuses a splat that is not the bundle's: its SHA-256 or its count differs.
export async function check(bytes, entry, count) {
    if (!globalThis.crypto?.subtle) throw new Error("the SHA-256 of a splat can only be checked over https or localhost");
    const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
    const found = Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
    const header = new TextDecoder().decode(bytes.subarray(0, 4096));
    const rows = Number(/^element vertex (\d+)/m.exec(header)?.[1]);
    if (found !== entry.sha256 || rows !== count || entry.count !== count) {
        throw new Error(`${entry.file} is not the splat of this bundle (its SHA-256 or count differs): export it again`);
    }
}

// The rows of the transfer as 32-bit words, with the kind of each splat in the two highest bits of its cluster.
function packed(transfer, surface, count, size) {
    if (transfer.length !== count * size || surface.length !== 8 * count) throw new Error("the bundle is cut short");
    const bytes = transfer.slice();
    for (let i = 0; i < count; i++) bytes[i * size + 1] |= (surface[8 * i + 7] & 3) << 6;
    return new Uint32Array(bytes.buffer);
}

// Harmonics about +y up to a band, in a direction [x, y, z] of the scene frame: K numbers.
export function harmonics([x, y, z], bands) {
    const values = new Float64Array(bands * bands), length = Math.hypot(x, y, z);
    const longitude = Math.atan2(x, z), up = y / length, flat = Math.sqrt(Math.max(0, 1 - up * up));
    let diagonal = 1;
    for (let m = 0; m < bands; m++) {
        if (m) diagonal *= (2 * m - 1) * flat;
        let before = 0, now = diagonal;
        for (let l = m; l < bands; l++) {
            if (l > m) [before, now] = [now, ((2 * l - 1) * up * now - (l + m - 1) * before) / (l - m)];
            let ratio = (2 * l + 1) / (4 * Math.PI);
            for (let k = l - m + 1; k <= l + m; k++) ratio /= k;
            const value = Math.sqrt(m ? 2 * ratio : ratio) * now;
            values[l * (l + 1) + m] = value * Math.cos(m * longitude);
            if (m) values[l * (l + 1) - m] = value * Math.sin(m * longitude);
        }
    }
    return values;
}

// What a light of live.json is to the basis: direct and spread coefficients end to end, turned and exposed, and what lamps
// are multiplied by; colours last.
export function lightVector(bundle, light, degrees = 0, exposure = light.exposure) {
    const { direct, spread, lamps } = bundle.meta.basis;
    const straight = light.rest.slice(0, direct).map((row) => [...row]);
    for (const sun of light.suns) {
        const values = harmonics(sun.direction, Math.round(Math.sqrt(direct)));
        straight.forEach((row, j) => row.forEach((_, i) => { row[i] += values[j] * sun.weight[i]; }));
    }
    const vector = new Float32Array(3 * (direct + spread + lamps)), angle = degrees * Math.PI / 180;
    [[straight, direct, 0], [light.whole, spread, direct]].forEach(([rows, count, first]) => {
        for (let j = 0; j < count; j++) {
            const l = Math.floor(Math.sqrt(j)), m = j - l * (l + 1);
            const c = Math.cos(m * angle), s = Math.sin(m * angle);
            for (let i = 0; i < 3; i++) vector[3 * (first + j) + i] = (c * rows[j][i] - s * rows[j - 2 * m][i]) * exposure;
        }
    });
    return vector.fill(light.lamps * exposure / light.exposure, 3 * (direct + spread));
}

// The table that every splat looks up: RGBA floats, 1 + weights colours for each cluster.
export function lightTable({ clusters, weights, basis }, vector) {
    const { directions, numbers, coefficients, directionScales, scales, means, components } = basis;
    const colors = new Float32Array(3 * (1 + directions)), table = new Float32Array(4 * clusters * (1 + weights));
    for (let i = 0; i < coefficients.length; i++) {
        const d = Math.floor(i / numbers);
        colors[3 * d + i % 3] += directionScales[d] * coefficients[i] * vector[i % numbers];
    }
    for (let c = 0, part = 0; c < clusters; c++) {
        for (let w = 0; w <= weights; w++, part++) {
            const values = w ? components : means, from = (w ? c * weights + w - 1 : c) * directions;
            const sum = [0, 0, 0];
            for (let d = 0; d < directions; d++) for (let i = 0; i < 3; i++) sum[i] += values[from + d] * colors[3 * (1 + d) + i];
            table.set([...sum.map((value, i) => scales[part] * value + (w ? 0 : colors[i])), 1], 4 * part);
        }
    }
    return table;
}

// The change of light of every splat, linear, 3 floats each. The shaders do the same; this is for engines without one.
// beside: of Beside.changes, added to it.
export function changes(bundle, table, beside = null) {
    const { count, weights, words, rows } = bundle, result = new Float32Array(3 * count);
    const bytes = new Int8Array(rows.buffer);
    for (let i = 0; i < count; i++) {
        const first = 4 * (1 + weights) * (rows[i * words] & 0x3fff), size = 4 * words;
        let red = table[first], green = table[first + 1], blue = table[first + 2];
        for (let w = 0; w < weights; w++) {
            const weight = bytes[i * size + 2 + w], at = first + 4 * (1 + w);
            red += weight * table[at];
            green += weight * table[at + 1];
            blue += weight * table[at + 2];
        }
        result[3 * i] = red;
        result[3 * i + 1] = green;
        result[3 * i + 2] = blue;
    }
    beside?.forEach((value, i) => { result[i] += value; });
    return result;
}

// A display value under a change of light k, channel by channel.
export function relit(color, k) {
    const linear = color <= 0.04045 ? Math.max(color, 0) / 12.92 : ((color + 0.055) / 1.055) ** 2.4;
    const start = Math.max(0.8, linear), room = Math.max(1 - start, 1e-3);
    let shown = k * linear;
    if (shown > start) shown = start + room * (1 - Math.exp(-(shown - start) / room));
    const ratio = linear > 1e-4 ? shown / linear : k;
    return Math.min(Math.max(ratio, 1e-4), 1e4) ** (1 / 2.4) * (color + 0.055) - 0.055;
}

// The sky of a light as RGBA floats, 128 x 64, rows from +y.
export async function skyOf(bundle, light, get = fetched) {
    const bytes = await get(`${bundle.folder}/${light.file}`), sky = new Float32Array(bytes.length);
    for (let i = 0; i < bytes.length; i += 4) {
        const scale = bytes[i + 3] ? 2 ** (bytes[i + 3] - 136) : 0;
        for (let k = 0; k < 3; k++) sky[i + k] = (bytes[i + k] + 0.5) * scale;
        sky[i + 3] = 1;
    }
    return sky;
}

// GLSL ES 3.0 of a splat's colour. WEIGHTS is a literal; the caller declares relightTable and relightSky (sampler2D),
// relightOn (bool), relightFrame (mat3 to the scene frame), relightMiddle, relightTurn (radians) and relightExposure.
export const GLSL = (weights) => `
vec3 relightShown(vec3 c) {
    float peak = max(c.r, max(c.g, c.b));
    if (peak > 0.8) {
        float top = 1.0 - 0.04 / (peak - 0.6);
        c = mix(vec3(top), c * top / peak, 1.0 / (0.15 * (peak - top) + 1.0));
    }
    return mix(1.055 * pow(max(c, vec3(1e-6)), vec3(1.0 / 2.4)) - 0.055, 12.92 * c, lessThanEqual(c, vec3(0.0031308)));
}
vec3 relightColor(vec3 color, uvec4 row, uint beside, vec3 center) {
    uint kind = (row.x >> 14u) & 3u;
    if (!relightOn || kind == 0u) return color;
    vec3 added = vec3(uvec3(beside, beside >> 9u, beside >> 18u) & 511u) * exp2(float(beside >> 27u) - 24.0);
    if (kind == ${SKY}u && beside == 0u) {
        vec3 d = normalize(relightFrame * (center - relightMiddle));
        float u = fract(0.5 - (atan(d.x, d.z) - relightTurn) / 6.28318531);
        ivec2 texel = ivec2(u * 128.0, clamp(0.5 - asin(clamp(d.y, -1.0, 1.0)) / 3.14159265, 0.0, 0.9999) * 64.0);
        return relightShown(texelFetch(relightSky, texel, 0).rgb * relightExposure);
    }
    int cluster = int(row.x & 0x3fffu);
    vec3 k = added + texelFetch(relightTable, ivec2(0, cluster), 0).rgb;
    for (int w = 0; w < ${weights}; w++) {
        int shift = 8 * ((w + 2) % 4);
        int weight = int(row[(w + 2) / 4] << uint(24 - shift)) >> 24;
        k += float(weight) * texelFetch(relightTable, ivec2(1 + w, cluster), 0).rgb;
    }
    vec3 linear = mix(pow((max(color, vec3(0.0)) + 0.055) / 1.055, vec3(2.4)), max(color, vec3(0.0)) / 12.92,
        lessThanEqual(color, vec3(0.04045)));
    vec3 start = max(vec3(0.8), linear), room = max(1.0 - start, vec3(1e-3)), over = max(k * linear - start, vec3(0.0));
    vec3 shown = mix(k * linear, start + room * (1.0 - exp(-over / room)), greaterThan(over, vec3(0.0)));
    vec3 ratio = mix(k, shown / max(linear, vec3(1e-4)), greaterThan(linear, vec3(1e-4)));
    return pow(clamp(ratio, 1e-4, 1e4), vec3(1.0 / 2.4)) * (color + 0.055) - 0.055;
}`;

async function fetched(address) {
    const answer = await fetch(address);
    if (!answer.ok) throw new Error(`${address}: ${answer.status} ${answer.statusText}`);
    return new Uint8Array(await answer.arrayBuffer());
}
