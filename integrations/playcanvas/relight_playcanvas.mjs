// Live light on splats in PlayCanvas: reads the bundle of `relight SCENE --format live`.
//
//   const light = await RelightSplat.load(pc, app, "garden_live");   // pc: import * as pc from "playcanvas"
//   app.root.addChild(light.entity);
//   light.angle = 45;                   // degrees about the scene's vertical, counter-clockwise from above
//   await light.choose(1);              // another light of the bundle
//   light.beside.lamps[0].ev = 1;       // a placed lamp, brighter by a stop
//   light.show();
//
// Colours above 1 need app.scene.gsplat.dataFormat = pc.GSPLATDATA_LARGE before the first splat is loaded.

import { Beside, GLSL, lightTable, lightVector, readBundle, skyOf } from "./relight_live.mjs";

const glsl = (weights) => `
uniform highp sampler2D relightTable;
uniform highp sampler2D relightSky;
uniform float relightIsOn;
uniform mat3 relightFrame;
uniform vec3 relightMiddle;
uniform float relightTurn;
uniform float relightExposure;
#define relightOn (relightIsOn > 0.5)
${GLSL(weights)}
void modifySplatCenter(inout vec3 center) {}
void modifySplatRotationScale(vec3 original, vec3 modified, inout vec4 rotation, inout vec3 scale) {}
void modifySplatColor(vec3 center, inout vec4 color) { color.rgb = relightColor(color.rgb, loadRelightRow(), loadRelightBeside().x, center); }`;

// The same in the language of WebGPU.
const wgsl = (weights) => `
var relightTable: texture_2d<uff>;
var relightSky: texture_2d<uff>;
uniform relightIsOn: f32;
uniform relightFrame: mat3x3f;
uniform relightMiddle: vec3f;
uniform relightTurn: f32;
uniform relightExposure: f32;
fn relightShown(given: vec3f) -> vec3f {
    var c = given;
    let peak = max(c.r, max(c.g, c.b));
    if (peak > 0.8) {
        let top = 1.0 - 0.04 / (peak - 0.6);
        c = mix(vec3f(top), c * top / peak, 1.0 / (0.15 * (peak - top) + 1.0));
    }
    return select(1.055 * pow(max(c, vec3f(1e-6)), vec3f(1.0 / 2.4)) - 0.055, 12.92 * c, c <= vec3f(0.0031308));
}
fn relightColor(color: vec3f, row: vec4u, beside: u32, center: vec3f) -> vec3f {
    let kind = (row.x >> 14u) & 3u;
    if (uniform.relightIsOn < 0.5 || kind == 0u) { return color; }
    let added = vec3f((vec3u(beside) >> vec3u(0u, 9u, 18u)) & vec3u(511u)) * exp2(f32(beside >> 27u) - 24.0);
    if (kind == 2u && beside == 0u) {
        let d = normalize(uniform.relightFrame * (center - uniform.relightMiddle));
        let u = fract(0.5 - (atan2(d.x, d.z) - uniform.relightTurn) / 6.28318531);
        let v = clamp(0.5 - asin(clamp(d.y, -1.0, 1.0)) / 3.14159265, 0.0, 0.9999);
        return relightShown(textureLoad(relightSky, vec2i(i32(u * 128.0), i32(v * 64.0)), 0).rgb * uniform.relightExposure);
    }
    let cluster = i32(row.x & 0x3fffu);
    var k = added + textureLoad(relightTable, vec2i(0, cluster), 0).rgb;
    for (var w: i32 = 0; w < ${weights}; w = w + 1) {
        let weight = bitcast<i32>(row[(w + 2) / 4] << u32(24 - 8 * ((w + 2) % 4))) >> 24u;
        k = k + f32(weight) * textureLoad(relightTable, vec2i(1 + w, cluster), 0).rgb;
    }
    let dark = max(color, vec3f(0.0));
    let linear = select(pow((dark + 0.055) / 1.055, vec3f(2.4)), dark / 12.92, color <= vec3f(0.04045));
    let start = max(vec3f(0.8), linear);
    let room = max(1.0 - start, vec3f(1e-3));
    let over = max(k * linear - start, vec3f(0.0));
    let shown = select(k * linear, start + room * (1.0 - exp(-over / room)), over > vec3f(0.0));
    let ratio = select(k, shown / max(linear, vec3f(1e-4)), linear > vec3f(1e-4));
    return pow(clamp(ratio, vec3f(1e-4), vec3f(1e4)), vec3f(1.0 / 2.4)) * (color + 0.055) - 0.055;
}
fn modifySplatCenter(center: ptr<function, vec3f>) {}
fn modifySplatRotationScale(original: vec3f, modified: vec3f, rotation: ptr<function, vec4f>, scale: ptr<function, vec3f>) {}
fn modifySplatColor(center: vec3f, color: ptr<function, vec4f>) {
    *color = vec4f(relightColor((*color).rgb, loadRelightRow(), loadRelightBeside().x, center), (*color).a);
}`;

export class RelightSplat {
    // Reads a bundle and its compressed splat, whose order the engine keeps; plain ones it sorts.
    static async load(pc, app, folder) {
        const file = "splat.compressed.ply", bundle = await readBundle(folder, file);
        const url = URL.createObjectURL(new Blob([bundle.splat.bytes]));
        const asset = new pc.Asset(file, "gsplat", { url, filename: file });
        bundle.splat.bytes = null;
        await new Promise((done, failed) => {
            asset.once("load", done);
            asset.once("error", (error) => failed(new Error(`${file}: ${error}`)));
            app.assets.add(asset);
            app.assets.load(asset);
        });
        URL.revokeObjectURL(url);
        const light = new RelightSplat(pc, app, bundle, asset);
        await light.choose(0);
        return light;
    }

    constructor(pc, app, bundle, asset) {
        const { words, weights, rows, meta } = bundle, { resource } = asset;
        this.bundle = bundle;
        this.lights = meta.lights;
        this._pc = pc;
        this._angle = 0;
        this.beside = new Beside(bundle);
        const format = { 1: pc.PIXELFORMAT_R32U, 2: pc.PIXELFORMAT_RG32U, 4: pc.PIXELFORMAT_RGBA32U }[words];
        resource.format.addExtraStreams([{ name: "relightRow", format }, { name: "relightBeside", format: pc.PIXELFORMAT_R32U }]);
        this._streamBeside = resource.getTexture("relightBeside");
        const stream = resource.getTexture("relightRow");
        stream.lock().set(rows);
        stream.unlock();
        this.entity = new pc.Entity("relit");
        this.entity.addComponent("gsplat", { asset });
        // Stand the splat up: its file may have any orientation, scene_from_splat says which way is up.
        const [x, y, z, w] = meta.frame.scene_from_splat;
        const matrix = new pc.Mat4().set([0, 1, 2, 3].flatMap((column) => [x[column], y[column], z[column], w[column]]));
        this.entity.setLocalPosition(matrix.getTranslation());
        this.entity.setLocalRotation(new pc.Quat().setFromMat4(matrix));
        this.entity.setLocalScale(matrix.getScale());
        this._component = this.entity.gsplat;
        this._component.setWorkBufferModifier({ glsl: glsl(weights), wgsl: wgsl(weights) });
        this._table = this._texture(app, 1 + weights, bundle.clusters);
        this._sky = this._texture(app, 128, 64);
        this._component.setParameter("relightIsOn", 1);
        // The colour is asked for in the world: its sky is the scene's, turned with the entity's parents by `stand`.
        this.stand(new pc.Mat4(), matrix.transformPoint(new pc.Vec3(...meta.frame.middle)));
    }

    // Tell which way the scene frame stands in the world, where the entity is moved: scene_from_world and the middle.
    stand(sceneFromWorld, middle) {
        const m = sceneFromWorld.data;
        this._component.setParameter("relightFrame", new Float32Array([m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]));
        this._component.setParameter("relightMiddle", [middle.x, middle.y, middle.z]);
    }

    // Show a light of the bundle, by its number.
    async choose(number) {
        this.light = this.lights[number];
        this._fill(this._sky, await skyOf(this.bundle, this.light));
        this._exposure = this.light.exposure;
        this.beside.choose(this.light);
        this.show();
    }

    get angle() { return this._angle; }
    set angle(degrees) { this._angle = degrees; this._update(); }

    get exposure() { return this._exposure; }
    set exposure(value) { this._exposure = value; this.show(); }

    // Show what was changed of `beside`: its `captured`, and `ev`, `on` and `color` of its `lamps`.
    show() {
        const stream = this._streamBeside;
        stream.lock().set(this.beside.packed(this.light, this._exposure));
        stream.unlock();
        this._update();
    }

    // Off, the splat looks as it was captured.
    set on(value) { this._component.setParameter("relightIsOn", value ? 1 : 0); }

    _update() {
        const vector = lightVector(this.bundle, this.light, this._angle, this._exposure);
        this._fill(this._table, lightTable(this.bundle, vector));
        this._component.setParameter("relightTable", this._table);
        this._component.setParameter("relightSky", this._sky);
        this._component.setParameter("relightTurn", this._angle * Math.PI / 180);
        this._component.setParameter("relightExposure", this._exposure);
        this._component.workBufferUpdate = this._pc.WORKBUFFER_UPDATE_ONCE;
    }

    _texture(app, width, height) {
        return new this._pc.Texture(app.graphicsDevice, {
            name: "relight", width, height, format: this._pc.PIXELFORMAT_RGBA32F, mipmaps: false,
            minFilter: this._pc.FILTER_NEAREST, magFilter: this._pc.FILTER_NEAREST,
        });
    }

    _fill(texture, data) {
        texture.lock().set(data);
        texture.unlock();
    }
}
