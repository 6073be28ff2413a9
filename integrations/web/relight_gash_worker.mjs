// The network of relight_gash.mjs in a worker, so that the page does not wait for it. This file is both sides of it.

import { onProcessor, radiance, readNetwork } from "./relight_gash.mjs";

// A function from motors and nine coefficients of light to a promise of linear radiance, three numbers a vertex. bytes: of
// neural-gash.bin. One call at a time.
export function inWorker(bytes) {
    const worker = new Worker(import.meta.url, { type: "module", name: "relight-gash" });
    worker.postMessage({ bytes });
    return (motors, sh) => new Promise((done, failed) => {
        worker.onmessage = ({ data }) => done(data);
        worker.onerror = ({ message }) => failed(new Error(message));
        worker.postMessage({ motors, sh });
    });
}

if (typeof document === "undefined" && globalThis.name === "relight-gash") {
    let run;
    globalThis.onmessage = async ({ data }) => {
        if (data.bytes) run = onProcessor(readNetwork(data.bytes));
        else {
            const result = radiance((await run)(data.motors), data.sh);
            globalThis.postMessage(result, [result.buffer]);
        }
    };
}
