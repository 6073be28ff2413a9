// Live light on splats in Spark (three.js): reads the bundle of `relight SCENE --format live`.
//
//   const light = await RelightSplat.load(THREE, spark, "garden_live");   // spark: import * as spark from "@sparkjsdev/spark"
//   scene.add(light.mesh);
//   light.angle = 45;                   // degrees about the scene's vertical, counter-clockwise from above
//   light.choose(1);                    // another light of the bundle
//   light.beside.lamps[0].ev = 1;       // a placed lamp, brighter by a stop
//   light.show();
//
// The light is an object modifier: a dyno that reads the row of each splat by gsplat.index. Level of detail stays off, as
// it would renumber the splats.

import { Beside, GLSL, lightTable, lightVector, readBundle, skyOf } from "./relight_live.mjs";

const WIDTH = 2048;  // of the texture of rows

export class RelightSplat {
    // Reads a bundle and its splat. splat: which of its files; the compressed one is a fourth of the other's size.
    static async load(THREE, spark, folder, splat = "splat.compressed.ply") {
        const bundle = await readBundle(folder, splat);
        const light = new RelightSplat(THREE, spark, bundle);
        await light.mesh.initialized;
        if (light.mesh.numSplats !== bundle.count) {
            throw new Error(`${splat}: Spark read ${light.mesh.numSplats} splats, the bundle has ${bundle.count}`);
        }
        await light.choose(0);
        return light;
    }

    constructor(THREE, spark, bundle) {
        const { dyno } = spark, { frame } = bundle.meta;
        this.bundle = bundle;
        this.lights = bundle.meta.lights;
        this._angle = 0;
        this.beside = new Beside(bundle);
        this._beside = rowTexture(THREE, bundle.count, 1, new Uint32Array(bundle.count));
        this._table = texture(THREE, new Float32Array(4 * bundle.clusters * (1 + bundle.weights)), 1 + bundle.weights);
        this._sky = texture(THREE, new Float32Array(4 * 128 * 64), 128);
        const scene = new THREE.Matrix3().setFromMatrix4(new THREE.Matrix4().set(...frame.scene_from_splat.flat()));
        this._on = new dyno.DynoBool({ value: true });
        this._turn = new dyno.DynoFloat({ value: 0 });
        this._exposure = new dyno.DynoFloat({ value: 1 });
        const given = {
            rows: new dyno.DynoUsampler2D({ value: rowTexture(THREE, bundle.count, bundle.words, bundle.rows) }),
            besides: new dyno.DynoUsampler2D({ value: this._beside }),
            relightTable: new dyno.DynoSampler2D({ value: this._table }),
            relightSky: new dyno.DynoSampler2D({ value: this._sky }),
            relightFrame: new dyno.DynoMat3({ value: scene }),
            relightMiddle: new dyno.DynoVec3({ value: new THREE.Vector3(...frame.middle) }),
            relightOn: this._on,
            relightTurn: this._turn,
            relightExposure: this._exposure,
        };
        const inTypes = { gsplat: dyno.Gsplat };
        for (const name in given) inTypes[name] = given[name].type;
        const modifier = dyno.dynoBlock({ gsplat: dyno.Gsplat }, { gsplat: dyno.Gsplat }, ({ gsplat }) => {
            const relight = new dyno.Dyno({
                inTypes,
                outTypes: { gsplat: dyno.Gsplat },
                globals: ({ inputs }) => [
                    dyno.defineGsplat,
                    // Spark names the uniforms; the shared code knows them by names of its own.
                    Object.keys(given).map((name) => `#define ${name} ${inputs[name]}`).join("\n").replace(
                        /^#define (rows|besides) .*\n/gm, "") + GLSL(bundle.weights),
                ],
                statements: ({ inputs, outputs }) => [
                    `${outputs.gsplat} = ${inputs.gsplat};`,
                    `uvec4 relightRow = texelFetch(${inputs.rows}, ` +
                    `ivec2(${inputs.gsplat}.index % ${WIDTH}, ${inputs.gsplat}.index / ${WIDTH}), 0);`,
                    `uint relightBeside = texelFetch(${inputs.besides}, ` +
                    `ivec2(${inputs.gsplat}.index % ${WIDTH}, ${inputs.gsplat}.index / ${WIDTH}), 0).r;`,
                    `${outputs.gsplat}.rgba.rgb = ` +
                    `relightColor(${inputs.gsplat}.rgba.rgb, relightRow, relightBeside, ${inputs.gsplat}.center);`,
                ],
            });
            return relight.apply({ gsplat, ...given });
        });
        this.mesh = new spark.SplatMesh({
            fileBytes: bundle.splat.bytes, fileName: bundle.splat.file, lod: false, enableLod: false, objectModifiers: [modifier],
        });
        bundle.splat.bytes = null;
    }

    // Show a light of the bundle, by its number.
    async choose(number) {
        this.light = this.lights[number];
        this._sky.image.data.set(await skyOf(this.bundle, this.light));
        this._sky.needsUpdate = true;
        this._exposure.value = this.light.exposure;
        this.beside.choose(this.light);
        this.show();
    }

    get angle() { return this._angle; }
    set angle(degrees) { this._angle = degrees; this._update(); }

    get exposure() { return this._exposure.value; }
    set exposure(value) { this._exposure.value = value; this.show(); }

    // Show what was changed of `beside`: its `captured`, and `ev`, `on` and `color` of its `lamps`.
    show() {
        this._beside.image.data.set(this.beside.packed(this.light, this.exposure));
        this._beside.needsUpdate = true;
        this._update();
    }

    // Off, the splat looks as it was captured.
    get on() { return this._on.value; }
    set on(value) { this._on.value = value; this._update(); }

    _update() {
        this._turn.value = this._angle * Math.PI / 180;
        this._table.image.data.set(lightTable(this.bundle, lightVector(this.bundle, this.light, this._angle, this.exposure)));
        this._table.needsUpdate = true;
        this.mesh.updateVersion();
    }
}

function texture(THREE, data, width) {
    const made = new THREE.DataTexture(data, width, data.length / 4 / width, THREE.RGBAFormat, THREE.FloatType);
    made.needsUpdate = true;
    return made;
}

// One texel a splat, of one, two or four 32-bit words.
function rowTexture(THREE, count, words, rows) {
    const formats = { 1: THREE.RedIntegerFormat, 2: THREE.RGIntegerFormat, 4: THREE.RGBAIntegerFormat };
    const internal = { 1: "R32UI", 2: "RG32UI", 4: "RGBA32UI" };
    const height = Math.ceil(count / WIDTH), data = new Uint32Array(WIDTH * height * words);
    data.set(rows);
    const made = new THREE.DataTexture(data, WIDTH, height, formats[words], THREE.UnsignedIntType);
    made.internalFormat = internal[words];
    made.needsUpdate = true;
    return made;
}
