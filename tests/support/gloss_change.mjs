// What the page's own code makes of gloss, without a page: node gloss_change.mjs WEB_FOLDER BUNDLE, and on stdin '{"light": 0, "angle": 0.5, "eye": [0, 1, 3], "ratio": [1, 1, 1], "hidden": [1, 1, 1], "factor": [0, 0, 0]}', and "ratios", three numbers of each splat
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [web, folder] = process.argv.slice(2), wish = JSON.parse(readFileSync(0, "utf8"));
const part = (name) => import(pathToFileURL(`${web}/${name}.js`));
const [Light, Live, Gloss] = await Promise.all(["light", "live", "gloss"].map(part));
const read = (name) => new Uint8Array(readFileSync(`${folder}/${name}`));
const meta = JSON.parse(readFileSync(`${folder}/live.json`, "utf8")), files = {};
for (const name of ["splat.compressed.ply", "transfer.bin", "surface.bin", "basis.bin", "gloss.bin", ...(meta.terms ? ["terms.bin"] : []), ...(meta.ground ? ["ground.bin"] : [])]) files[name] = read(name);
const { gloss, ...bundle } = Live.readBundle(meta, files, "splat.compressed.ply"), { normals, places } = Live.surfaceOf(bundle);
const light = Light.lightOf(meta.lights[wish.light], read(meta.lights[wish.light].file)), angle = wish.angle ?? 0;
const suns = light.suns.map(({ direction, weight }) => ({ weight, direction: Light.turnedDirection(direction, angle) }));
const texture = Gloss.mirrorTexture(gloss, Gloss.mirroredLight(gloss, light, angle, light.exposure, suns, wish.factor), wish.factors);
const at = (values, n) => Array.from(values.subarray(3 * n, 3 * n + 3)), ones = [1, 1, 1];
const change = Array.from({ length: bundle.count }, (_, n) => Gloss.glossChange(gloss, texture, n, wish.eye, at(places, n), at(normals, n), wish.ratios?.[n] ?? wish.ratio ?? ones, wish.hidden ?? ones));
console.log(JSON.stringify({ change, places: Array.from(places), normals: Array.from(normals), size: Gloss.mirrorSize(gloss), texture: Array.from(texture) }));
