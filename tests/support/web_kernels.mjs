// Prints what the web loaders compute, as JSON. Arguments: folder of integrations, what, and for
// "bundle": folder of a bundle, splat, light, angle. "mesh": a JSON file of sh, angle, albedo, transfer, pixels, width, height.
import { readFile } from "node:fs/promises";
import { pathToFileURL } from "node:url";

const [root, what, ...rest] = process.argv.slice(2);
const get = async (path) => new Uint8Array(await readFile(path));
const load = (path) => import(pathToFileURL(`${root}/${path}`).href);

if (what === "bundle") {
    const live = await load("web/relight_live.mjs");
    const [folder, splat, light, angle] = rest;
    try {
        const bundle = await live.readBundle(folder, splat, get);
        const chosen = bundle.meta.lights[Number(light)];
        const vector = live.lightVector(bundle, chosen, Number(angle));
        const beside = new live.Beside(bundle);
        beside.choose(chosen);
        const changes = live.changes(bundle, live.lightTable(bundle, vector), beside.changes(chosen));
        const packed = [...beside.packed(chosen, 2 * chosen.exposure)], added = [...beside.changes(chosen, 2 * chosen.exposure)];
        if (beside.lamps.length) Object.assign(beside.lamps[0], { ev: 1, color: [0, 1, 0] });
        if (beside.lamps.length) beside.lamps[1].on = false;
        const colors = [-0.1, 0.02, 0.3, 0.7, 0.95, 1.2], ks = [0.01, 0.5, 1, 3];
        console.log(JSON.stringify({
            packed, added, other: [...beside.changes(chosen)], names: beside.lamps.map(({ name }) => name),
            count: bundle.count, vector: [...vector], changes: [...changes],
            kinds: Array.from({ length: bundle.count }, (_, i) => bundle.rows[i * bundle.words] >>> 14 & 3),
            relit: colors.map((c) => ks.map((k) => live.relit(c, k))),
            sky: [...(await live.skyOf(bundle, chosen, get)).slice(0, 400)],
        }));
    } catch (error) {
        console.error(error.message);
        process.exit(2);
    }
} else {
    const mesh = await load("three/relight_mesh.mjs");
    const given = JSON.parse(await readFile(rest[0]));
    console.log(JSON.stringify({
        turned: mesh.turned(given.sh, given.angle),
        radiance: given.albedo.map((albedo, i) => mesh.radiance(albedo, given.transfer[i], given.sh)),
        projected: mesh.fromLatLong(given.pixels.flat(), given.width, given.height, 3),
        refused: [{}, { relight_live: { version: 99 } }, { relight_live: { version: 1, coefficients: 4 } }].map((extras) => {
            try { mesh.described(extras); return null; } catch (error) { return error.message; }
        }),
    }));
}
