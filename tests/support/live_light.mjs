// The page's own code without a page: light a bundle, write what is asked for.
// node live_light.mjs WEB_FOLDER BUNDLE '{"light": 0, "angle": 0.5, "sun": 1, "change": "k.f32", "gains": "g.u16", "ply": "x.ply", "hdr": "in.hdr"}'
import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [web, folder, text] = process.argv.slice(2), wish = JSON.parse(text);
const part = (name) => import(pathToFileURL(`${web}/${name}.js`));
const [Light, Live, Splats, { Shadow }, Parts] = await Promise.all(["light", "live", "splats", "shadow", "parts"].map(part));
const read = (name) => new Uint8Array(readFileSync(`${folder}/${name}`));

try {
  const meta = JSON.parse(readFileSync(`${folder}/live.json`, "utf8")), [entry] = meta.splats, files = {};
  for (const name of [entry.file, "transfer.bin", "surface.bin", "basis.bin", ...(meta.terms ? ["terms.bin"] : []), ...(meta.ground ? ["ground.bin"] : []), ...(meta.parts ? ["parts.bin"] : [])]) files[name] = read(name);
  await Live.checkSplat(files[entry.file], entry);
  const bundle = Live.readBundle(meta, files, entry.file), surface = Live.surfaceOf(bundle), ratio = new Float32Array(bundle.count * 3);
  const own = meta.lights[wish.light ?? 0];
  const light = wish.hdr ? Light.lightFrom("hdr", Light.reduced(Light.readHdr(new Uint8Array(readFileSync(wish.hdr))))) : Light.lightOf(own, read(own.file));
  const angle = wish.angle ?? 0, suns = light.suns.map(({ direction, weight }) => ({ weight, direction: Light.turnedDirection(direction, angle) }));
  Live.changes(bundle, Live.lightTable(bundle, light, angle, light.exposure), ratio);
  if (wish.sun ?? 1) {
    const proxy = Splats.readProxy(read("proxy.glb")), shadows = suns.map(({ direction }) => new Shadow(proxy, direction));
    Live.addSuns(bundle, surface, suns, shadows, light.exposure, ratio);
  }
  const factors = wish.factors ?? Live.factorsOf(bundle, light);
  Live.addTerms(bundle, factors, ratio);
  if (wish.apart) Parts.apart(bundle.parts, wish.apart, ratio);
  if (wish.change) writeFileSync(wish.change, ratio);
  const out = new Uint16Array(bundle.count * 4);
  Live.gains(bundle, ratio, out);
  Live.showSky(bundle, light, angle, light.exposure, out, factors[0]);
  if (wish.gains) writeFileSync(wish.gains, out);
  if (wish.ply) writeFileSync(wish.ply, Splats.relitPly(bundle.splats, out, Live.GAIN_UNIT, Live.usualGain(bundle, light, angle, light.exposure)));
  console.log(JSON.stringify({ rest: Array.from(light.rest), whole: Array.from(light.whole), mean: light.mean, suns: light.suns, exposure: Live.exposureOf(bundle, light, ratio) }));
} catch (error) {
  console.log(JSON.stringify({ error: error.message }));
}
