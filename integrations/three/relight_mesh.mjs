// Live light on a mesh in three.js: reads live.glb of `relight SCENE --format glb --live`.
//
//   const gltf = await new GLTFLoader().loadAsync("live.glb");
//   const light = new RelightMesh(THREE, gltf);
//   scene.add(gltf.scene);
//   light.angle = 45;                       // degrees about +y, counter-clockwise from above
//   light.sh = fromLatLong(pixels, w, h);   // another environment
//
// Everything above the class is plain JavaScript without three.js; the tests compare it with relight itself.

export const KEY = "relight_live";
export const VERSION = 1;

// What live.glb says of itself: { exposure, light: { name, angle_deg, sh } }. Throws, in one line, for another file.
export function described(extras) {
    const live = extras?.[KEY];
    if (!live) throw new Error("this glTF has no live light: write it with relight SCENE --format glb --live");
    if (live.version > VERSION) throw new Error(`live light of version ${live.version}, this loader reads ${VERSION}`);
    if (live.coefficients !== 9 || live.light?.sh?.length !== 9) throw new Error("live light must have 9 coefficients");
    return live;
}

// Nine radiance coefficients [[r, g, b] x 9] of light turned about +y, +z towards +x, as --rotate turns it.
// The basis is y; z; x; xy, yz, 3 z^2 - 1, xz, x^2 - y^2 after the constant: the polar axis is z, so band 2 is
// rewritten about y first.
export function turned(sh, degrees) {
    const a = degrees * Math.PI / 180;
    const c = Math.cos(a), s = Math.sin(a), c2 = Math.cos(2 * a), s2 = Math.sin(2 * a), h = Math.sqrt(3) / 2;
    const result = sh.map((row) => [...row]);
    for (let i = 0; i < 3; i++) {
        const [, , z, x, xy, yz, zz, xz, xx] = sh.map((row) => row[i]);
        const around = h * zz - 0.5 * xx, along = -0.5 * zz - h * xx;  // z^2 - x^2, and 3 y^2 - 1
        const turnedAround = around * c2 - xz * s2;
        result[2][i] = z * c - x * s;
        result[3][i] = x * c + z * s;
        result[4][i] = xy * c + yz * s;
        result[5][i] = yz * c - xy * s;
        result[6][i] = h * turnedAround - 0.5 * along;
        result[7][i] = xz * c2 + around * s2;
        result[8][i] = -0.5 * turnedAround - h * along;
    }
    return result;
}

// Nine radiance coefficients of a lat-long image: linear pixels, rows from the top (+y), the centre looks at +z, +x is a
// quarter from the left. channels: 3 or 4 numbers a pixel.
export function fromLatLong(pixels, width, height, channels = 4) {
    const sh = Array.from({ length: 9 }, () => [0, 0, 0]);
    for (let row = 0; row < height; row++) {
        const area = (Math.cos(Math.PI * row / height) - Math.cos(Math.PI * (row + 1) / height)) * 2 * Math.PI / width;
        const latitude = Math.PI * (0.5 - (row + 0.5) / height);
        for (let column = 0; column < width; column++) {
            const longitude = Math.PI * (1 - 2 * (column + 0.5) / width);
            const x = Math.cos(latitude) * Math.sin(longitude), y = Math.sin(latitude);
            const z = Math.cos(latitude) * Math.cos(longitude);
            const basis = [
                0.28209479, 0.48860251 * y, 0.48860251 * z, 0.48860251 * x, 1.09254843 * x * y, 1.09254843 * y * z,
                0.31539157 * (3 * z * z - 1), 1.09254843 * x * z, 0.54627422 * (x * x - y * y),
            ];
            const at = (row * width + column) * channels;
            for (let j = 0; j < 9; j++) for (let i = 0; i < 3; i++) sh[j][i] += area * basis[j] * pixels[at + i];
        }
    }
    return sh;
}

// What a vertex sends out, [r, g, b] linear, not exposed. transfer: its twelve numbers, normalised. The shader below says
// the same.
export function radiance(albedo, transfer, sh) {
    return [0, 1, 2].map((i) => {
        let light = 0;
        for (let j = 0; j < 9; j++) light += transfer[j] * sh[j][i];
        return albedo[i] * transfer[9 + i] * Math.max(light, 0);
    });
}

const VERTEX = `
attribute vec4 _transfer_0;
attribute vec4 _transfer_1;
attribute vec4 _transfer_2;
uniform vec3 relightSh[9];
varying vec3 relightRadiance;
void main() {
    vec3 light = _transfer_0.x * relightSh[0] + _transfer_0.y * relightSh[1] + _transfer_0.z * relightSh[2]
        + _transfer_0.w * relightSh[3] + _transfer_1.x * relightSh[4] + _transfer_1.y * relightSh[5]
        + _transfer_1.z * relightSh[6] + _transfer_1.w * relightSh[7] + _transfer_2.x * relightSh[8];
    relightRadiance = color.rgb * _transfer_2.yzw * max(light, vec3(0.0));
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

// Highlights are compressed as in preview.png: Khronos PBR Neutral without its mirror reflection.
export const FRAGMENT = `
uniform float relightExposure;
varying vec3 relightRadiance;
void main() {
    vec3 shown = relightRadiance * relightExposure;
    float peak = max(shown.r, max(shown.g, shown.b));
    if (peak > 0.8) {
        float top = 1.0 - 0.04 / (peak - 0.6);
        shown = mix(vec3(top), shown * top / peak, 1.0 / (0.15 * (peak - top) + 1.0));
    }
    gl_FragColor = vec4(shown, 1.0);
    #include <colorspace_fragment>
}`;

export class RelightMesh {
    // THREE: the module. gltf: what GLTFLoader gave; every mesh of it gets the material of live light.
    constructor(THREE, gltf) {
        const live = described(gltf.scene.userData);
        this._THREE = THREE;
        this._sh = live.light.sh;
        this._angle = live.light.angle_deg;
        this.material = new THREE.ShaderMaterial({
            uniforms: { relightSh: { value: [] }, relightExposure: { value: live.exposure } },
            vertexShader: VERTEX,
            fragmentShader: FRAGMENT,
            vertexColors: true,
            side: THREE.DoubleSide,
            toneMapped: false,
        });
        gltf.scene.traverse((node) => {
            if (!node.isMesh) return;
            for (const name of ["color", "_transfer_0", "_transfer_1", "_transfer_2"]) {
                if (!node.geometry.getAttribute(name)) throw new Error(`${node.name} of this glTF has no ${name}`);
            }
            node.material = this.material;
        });
        this._update();
    }

    get angle() { return this._angle; }
    set angle(degrees) { this._angle = degrees; this._update(); }

    get sh() { return this._sh; }
    set sh(coefficients) { this._sh = coefficients; this._update(); }

    get exposure() { return this.material.uniforms.relightExposure.value; }
    set exposure(value) { this.material.uniforms.relightExposure.value = value; }

    _update() {
        const rows = turned(this._sh, this._angle);
        this.material.uniforms.relightSh.value = rows.map((row) => new this._THREE.Vector3(...row));
    }
}
