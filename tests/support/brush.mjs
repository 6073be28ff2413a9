// The brush of the page without a page. node brush.mjs WEB_FOLDER BUNDLE '{"matrix": [16], "size": [w, h], "paint": [[x, y, radius, to_x, to_y]], "erase": [...], "light": {"exposure": 1, "tint": [r, g, b]}, "out": FOLDER}'
// Its splats are those of the bundle; opacities: other ones. It prints the rows that are painted.
import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [web, folder, text] = process.argv.slice(2), wish = JSON.parse(text);
const [Brush, Splats, Parts] = await Promise.all(["brush", "splats", "parts"].map((name) => import(pathToFileURL(`${web}/${name}.js`))));
const read = (name) => new Uint8Array(readFileSync(`${folder}/${name}`)), meta = JSON.parse(readFileSync(`${folder}/live.json`, "utf8")), { count } = meta;
const parts = Parts.partsOf(meta.parts, meta.parts && read("parts.bin"), read("rows.bin"), count), splats = Splats.readCompressed(read("splat.compressed.ply"));
const seen = Brush.seen(Brush.placed({ count, splats, meta }), wish.matrix, ...wish.size), number = Brush.newPart(parts);
for (const [strokes, erase] of [[wish.paint, false], [wish.erase ?? [], true]]) for (const [x, y, radius, u = x, v = y] of strokes) Brush.paint(parts, seen.under({ x, y }, { x: u, y: v }, radius), number, erase);
const lights = parts.entries.map(() => ({ exposure: 0, tint: [1, 1, 1] }));
if (wish.light) lights[number - 1] = wish.light;
if (wish.out) Object.entries(Brush.partFiles(parts, lights)).forEach(([name, bytes]) => writeFileSync(`${wish.out}/${name}`, bytes));
console.log(JSON.stringify({ rows: Array.from({ length: count }, (_, n) => n).filter((n) => parts.members[2 * n] === number), members: Array.from(parts.members) }));
