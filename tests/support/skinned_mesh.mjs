// Prints the posed points, normals and colours of a DeformedMesh, as JSON. Stands in a folder of three, relight_deformed.mjs and the
// modules that it imports. Argument: a JSON file of points, normals, weights of two bones, their matrices, and of the object's.
import { readFile } from "node:fs/promises";
import * as THREE from "three";
import { DeformedMesh } from "./relight_deformed.mjs";

const given = JSON.parse(await readFile(process.argv[2])), count = given.points.length / 3;
const geometry = new THREE.BufferGeometry();
geometry.setAttribute("position", new THREE.Float32BufferAttribute(given.points, 3));
geometry.setAttribute("normal", new THREE.Float32BufferAttribute(given.normals, 3));
geometry.setAttribute("skinIndex", new THREE.Uint16BufferAttribute(Array.from({ length: count }, () => [0, 1, 0, 0]).flat(), 4));
geometry.setAttribute("skinWeight", new THREE.Float32BufferAttribute(given.weights.flatMap((w) => [w, 1 - w, 0, 0]), 4));
const mesh = new THREE.SkinnedMesh(geometry, new THREE.MeshBasicMaterial({ color: new THREE.Color(0.5, 0.25, 1) }));
const root = new THREE.Group(), bones = [new THREE.Bone(), new THREE.Bone()];
bones.forEach((bone) => root.add(bone));
root.add(mesh);
mesh.bind(new THREE.Skeleton(bones));
const live = { exposure: 1, light: { angle_deg: 0, sh: Array.from({ length: 9 }, () => [1, 2, 3]) } };
const deformed = new DeformedMesh(THREE, root, live, (motors, sh) => new Float32Array(motors.length / 32 * 3).map((_, i) => sh[0][i % 3]));
const place = (node, matrix) => { node.matrixAutoUpdate = false; node.matrix.set(...matrix); };
bones.forEach((bone, k) => place(bone, given.bones[k]));
await deformed.update();
const { position, color } = deformed.shown.geometry.attributes;
console.log(JSON.stringify({ points: [...position.array], normals: [...deformed._normals], colors: [...color.array], frame: deformed.frame }));
