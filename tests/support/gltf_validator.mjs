// Prints the Khronos glTF validator's issues with one file as JSON. Arguments: folder of node modules, GLB file.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { resolve } from "node:path";

const [modules, file] = process.argv.slice(2);
const validator = createRequire(resolve(modules, "_"))("gltf-validator");
const report = await validator.validateBytes(new Uint8Array(readFileSync(file)));
console.log(JSON.stringify(report.issues));
