// The page's own readers of light: float32 of each file into OUT, or the line that it says.
// node read_exr.mjs WEB_FOLDER '[["in.exr", "out.f32"], ...]' prints [{"size": [w, h]} or {"error": "..."}, ...]
import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [web, pairs] = process.argv.slice(2), said = [];
const { readExr } = await import(pathToFileURL(`${web}/exr.js`)), { readHdr } = await import(pathToFileURL(`${web}/light.js`));
for (const [from, to] of JSON.parse(pairs)) {
  try {
    const { width, height, image } = await (from.endsWith(".hdr") ? readHdr : readExr)(new Uint8Array(readFileSync(from)));
    writeFileSync(to, image);
    said.push({ size: [width, height] });
  } catch (error) {
    said.push({ error: error.message, kind: error.constructor.name });
  }
}
console.log(JSON.stringify(said));
