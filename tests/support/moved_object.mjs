// Gains of a moved object without a page. Standard input: JSON of a Movable, of level places before and after its move.
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const { Movable } = await import(pathToFileURL(process.argv[2])), wish = JSON.parse(readFileSync(0, "utf8"));
const arrays = Object.fromEntries(["positions", "directions", "light", "sent"].map((name) => [name, Float32Array.from(wish[name])]));
const object = new Movable({ ...arrays, indices: Uint32Array.from(wish.indices), even: wish.even });
const found = wish.places.map((places, index) => {
  if (index) object.move(...wish.move);
  const surface = { places: Float32Array.from(places), normals: Float32Array.from(places, (_, i) => i % 3 === 1 ? 1 : 0) };
  const { rows, gains } = object.changed(surface, () => true), all = new Array(places.length).fill(1);
  rows.forEach((row, i) => all.splice(3 * row, 3, ...gains.slice(3 * i, 3 * i + 3)));
  return all;
});
console.log(JSON.stringify(found));
