// A mesh that moves in three.js, lit by the network of the Neural-GASh paper: every frame its vertices as posed become motors, and
// the network's radiance their colours. Skins, morph targets and animations are those of three.js; morph targets leave normals.
//
//   const mesh = new DeformedMesh(THREE, gltf.scene, described(live.scene.userData), onCard(network));
//   scene.add(mesh.shown);
//   mesh.angle = 45; await mesh.update();   // after mixer.update(), every frame

import { FRAGMENT } from "./relight_mesh.mjs";
import { about, frameOf, motors, turned } from "./relight_gash.mjs";

const VERTEX = `
varying vec3 relightRadiance;
void main() {
    relightRadiance = color.rgb;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

export class DeformedMesh {
    // root: meshes, which need not be in the scene. live: of `described`, the light. shade: of onCard or inWorker.
    constructor(THREE, root, live, shade) {
        this._THREE = THREE;
        this._root = root;
        this._shade = shade;
        this.sh = live.light.sh;
        this.angle = live.light.angle_deg;
        this.axis = [0, 1, 0];
        this.deform = null;  // (point, normal), in the frame of the world, which it changes; after skins and morph targets
        this._parts = [];
        root.traverse((node) => { if (node.isMesh) this._parts.push(node); });
        const count = this._parts.reduce((sum, { geometry }) => sum + geometry.attributes.position.count, 0);
        [this._points, this._normals, this._albedo] = [0, 1, 2].map(() => new Float32Array(3 * count));
        const faces = [];
        let first = 0;
        for (const { geometry, material } of this._parts) {
            const { position, color } = geometry.attributes, tint = material.color ?? new THREE.Color(1, 1, 1);
            for (let i = 0; i < position.count; i++)
                this._albedo.set(color ? [tint.r * color.getX(i), tint.g * color.getY(i), tint.b * color.getZ(i)] : tint.toArray(), 3 * (first + i));
            const corners = geometry.index?.array ?? Array.from({ length: position.count }, (_, i) => i);
            for (const corner of corners) faces.push(first + corner);
            first += position.count;
        }
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", new THREE.BufferAttribute(this._points, 3).setUsage(THREE.DynamicDrawUsage));
        geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * count), 3).setUsage(THREE.DynamicDrawUsage));
        geometry.setIndex(faces);
        const material = new THREE.ShaderMaterial({
            uniforms: { relightExposure: { value: live.exposure } }, vertexShader: VERTEX, fragmentShader: FRAGMENT,
            vertexColors: true, side: THREE.DoubleSide, toneMapped: false,
        });
        this.shown = new THREE.Mesh(geometry, material);
        this.shown.frustumCulled = false;
        this._pose();
        this.frame = frameOf(this._points);
    }

    get count() { return this._points.length / 3; }

    get exposure() { return this.shown.material.uniforms.relightExposure.value; }
    set exposure(value) { this.shown.material.uniforms.relightExposure.value = value; }

    // Poses the mesh and lights it. While a worker computes, the mesh moves in the colours that it has.
    async update() {
        this._pose();
        const { position, color } = this.shown.geometry.attributes;
        position.needsUpdate = true;
        if (this._waits) return;
        this._waits = true;
        const light = turned(this.sh, about(this.axis, this.angle)), lit = this._shade(motors(this._points, this._normals, this.frame), light);
        const radiance = lit instanceof Promise ? await lit : lit;
        for (let i = 0; i < radiance.length; i++) color.array[i] = this._albedo[i] * radiance[i];
        color.needsUpdate = true;
        this._waits = false;
    }

    // Points and normals in the frame of the world. With fixed weights skins are affine: they take p + n - p to the turned normal.
    _pose() {
        const { Matrix3, Vector3 } = this._THREE, point = new Vector3(), tip = new Vector3(), normal = new Vector3(), turn = new Matrix3();
        this._root.updateMatrixWorld(true);
        let at = 0;
        for (const part of this._parts) {
            const { position, normal: resting } = part.geometry.attributes;
            turn.getNormalMatrix(part.matrixWorld);
            for (let i = 0; i < position.count; i++, at += 3) {
                part.getVertexPosition(i, point);
                normal.fromBufferAttribute(resting, i);
                if (part.isSkinnedMesh) {
                    tip.fromBufferAttribute(position, i);
                    part.applyBoneTransform(i, normal.add(tip)).sub(part.applyBoneTransform(i, tip));
                }
                point.applyMatrix4(part.matrixWorld);
                normal.applyNormalMatrix(turn);
                this.deform?.(point, normal);
                point.toArray(this._points, at);
                normal.toArray(this._normals, at);
            }
        }
    }
}

// A deformation to look at: a twist about the vertical by so many degrees from the middle to either end of a frame.
export function twisted({ middle, half }, degrees) {
    const rate = degrees * Math.PI / 180 / half;
    return (point, normal) => {
        const x = point.x - middle[0], z = point.z - middle[2], angle = rate * (point.y - middle[1]), c = Math.cos(angle), s = Math.sin(angle);
        normal.y -= rate * (z * normal.x - x * normal.z);  // of a shear along the turn, then turned
        normal.set(c * normal.x + s * normal.z, normal.y, c * normal.z - s * normal.x).normalize();
        point.set(middle[0] + c * x + s * z, point.y, middle[2] + c * z - s * x);
    };
}
