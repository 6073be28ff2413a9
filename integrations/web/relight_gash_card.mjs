// The network of relight_gash.mjs on the graphics card: WebGL 2, a pass of fragments for each layer, each fragment four outputs of
// a vertex. The last pass is the product with the light, so that one pixel a vertex is read back.

import { NUMBERS } from "./relight_gash.mjs";

const ROWS = 2048;  // vertices at once, the least size of a texture that WebGL 2 grants

const WHOLE = `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;

const LAYER = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D values, weights, biases;
uniform int quads;  // of inputs
uniform bool bends;
out vec4 result;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 sum = texelFetch(biases, ivec2(at.x, 0), 0);
    for (int i = 0; i < quads; i++) {
        vec4 x = texelFetch(values, ivec2(i, at.y), 0);
        sum += x.x * texelFetch(weights, ivec2(4 * i, at.x), 0) + x.y * texelFetch(weights, ivec2(4 * i + 1, at.x), 0)
            + x.z * texelFetch(weights, ivec2(4 * i + 2, at.x), 0) + x.w * texelFetch(weights, ivec2(4 * i + 3, at.x), 0);
    }
    result = bends ? sum / (1.0 + exp(clamp(-sum, -80.0, 80.0))) : sum;
}`;

const LIGHT = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D values;
uniform vec3 sh[9];
out vec4 result;
void main() {
    float outputs[28];
    for (int i = 0; i < 7; i++) {
        vec4 four = texelFetch(values, ivec2(i, int(gl_FragCoord.y)), 0);
        for (int k = 0; k < 4; k++) outputs[4 * i + k] = four[k];
    }
    vec3 sum = vec3(0.0);
    for (int j = 0; j < 9; j++) {
        float transfer = (outputs[3 * j] + outputs[3 * j + 1] + outputs[3 * j + 2]) / 3.0;
        sum += (j == 0 ? clamp(transfer, 0.0, 0.28209479) : transfer) * sh[j];
    }
    result = vec4(max(sum, vec3(0.0)), 1.0);
}`;

// A function from motors and nine coefficients of light to linear radiance, three numbers a vertex. gl: a context of its own.
// Returns null where the card cannot draw into textures of floats; inWorker does the same then.
export function onCard(network, gl = new OffscreenCanvas(1, 1).getContext("webgl2")) {
    if (!gl?.getExtension("EXT_color_buffer_float")) return null;
    const program = (source, ...names) => {
        const made = gl.createProgram();
        for (const [kind, text] of [[gl.VERTEX_SHADER, WHOLE], [gl.FRAGMENT_SHADER, source]]) {
            const shader = gl.createShader(kind);
            gl.shaderSource(shader, text);
            gl.compileShader(shader);
            gl.attachShader(made, shader);
        }
        gl.linkProgram(made);
        if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(`the network does not compile: ${gl.getProgramInfoLog(made)}`);
        return { program: made, ...Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(made, name)])) };
    };
    const layer = program(LAYER, "values", "weights", "biases", "quads", "bends"), light = program(LIGHT, "values", "sh");
    const texture = (width, height, data = null) => {
        const made = gl.createTexture();
        gl.bindTexture(gl.TEXTURE_2D, made);
        gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, width, height);
        if (data) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.FLOAT, data);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
        return made;
    };
    const target = (made) => {
        const frame = gl.createFramebuffer();
        gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
        gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, made, 0);
        return frame;
    };
    const bind = (unit, made, where) => {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, made);
        gl.uniform1i(where, unit);
    };
    const layers = network.map(({ inputs, quads, weights, biases }) => {
        const result = texture(quads, ROWS);
        return { inputs, quads, weights: texture(inputs, quads, weights), biases: texture(quads, 1, biases), result, target: target(result) };
    });
    const given = texture(NUMBERS / 4, ROWS);
    let columns = 0, shown, shownTarget, read;

    return (motors, sh) => {
        const count = motors.length / NUMBERS, needed = Math.max(Math.ceil(count / ROWS), 1);
        if (needed !== columns) {
            if (columns) { gl.deleteTexture(shown); gl.deleteFramebuffer(shownTarget); }
            [columns, shown] = [needed, texture(needed, ROWS)];
            [shownTarget, read] = [target(shown), new Float32Array(4 * needed * ROWS)];
        }
        for (let column = 0; column < columns; column++) {
            const start = column * ROWS, rows = Math.min(ROWS, count - start);
            gl.bindTexture(gl.TEXTURE_2D, given);
            gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, NUMBERS / 4, rows, gl.RGBA, gl.FLOAT, motors.subarray(start * NUMBERS, (start + rows) * NUMBERS));
            gl.useProgram(layer.program);
            let values = given;
            layers.forEach((each, k) => {
                bind(0, values, layer.values);
                bind(1, each.weights, layer.weights);
                bind(2, each.biases, layer.biases);
                gl.uniform1i(layer.quads, each.inputs / 4);
                gl.uniform1i(layer.bends, k + 1 < layers.length);
                gl.bindFramebuffer(gl.FRAMEBUFFER, each.target);
                gl.viewport(0, 0, each.quads, rows);
                gl.drawArrays(gl.TRIANGLES, 0, 3);
                values = each.result;
            });
            gl.useProgram(light.program);
            bind(0, values, light.values);
            gl.uniform3fv(light.sh, sh.flat());
            gl.bindFramebuffer(gl.FRAMEBUFFER, shownTarget);
            gl.viewport(column, 0, 1, rows);
            gl.drawArrays(gl.TRIANGLES, 0, 3);
        }
        gl.bindFramebuffer(gl.FRAMEBUFFER, shownTarget);
        gl.readPixels(0, 0, columns, ROWS, gl.RGBA, gl.FLOAT, read);
        const result = new Float32Array(3 * count);
        for (let v = 0, at = 0; v < count; v++) {
            const from = 4 * (v % ROWS * columns + Math.floor(v / ROWS));
            for (let c = 0; c < 3; c++) result[at++] = read[from + c];
        }
        return result;
    };
}
