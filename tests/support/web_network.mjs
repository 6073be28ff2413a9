// Prints what integrations/web/relight_gash.mjs computes, as JSON. Arguments: folder of integrations, neural-gash.bin, and a JSON file
// of points, normals, sh, axis, angle. With "time" and numbers of vertices in place of the file: processor ms of a frame each.
import { readFile } from "node:fs/promises";
import { pathToFileURL } from "node:url";

const [root, file, what, ...counts] = process.argv.slice(2);
const gash = await import(pathToFileURL(`${root}/web/relight_gash.mjs`).href);
const bytes = new Uint8Array(await readFile(file)).buffer;
let network;
try { network = gash.readNetwork(bytes); } catch (error) { console.error(error.message); process.exit(2); }
const run = await gash.onProcessor(network);

if (what === "time") {
    for (const count of counts.map(Number)) {
        const [points, normals] = [0, 1].map(() => Float32Array.from({ length: 3 * count }, () => Math.random() - 0.5));
        const frame = gash.frameOf(points), sh = Array.from({ length: 9 }, () => [1, 1, 1]);
        const times = Array.from({ length: 5 }, () => {
            const before = process.cpuUsage();
            gash.radiance(run(gash.motors(points, normals, frame)), gash.turned(sh, gash.about([0, 1, 0], 30)));
            const { user, system } = process.cpuUsage(before);
            return (user + system) / 1000;
        });
        console.log(count, Math.min(...times));
    }
} else {
    const given = JSON.parse(await readFile(what));
    const [points, normals] = [given.points, given.normals].map((rows) => Float32Array.from(rows.flat()));
    const motors = gash.motors(points, normals, gash.frameOf(points)), outputs = run(motors), sh = gash.turned(given.sh, gash.about(given.axis, given.angle));
    console.log(JSON.stringify({ motors: [...motors], outputs: [...outputs], sh, radiance: [...gash.radiance(outputs, sh)] }));
}
