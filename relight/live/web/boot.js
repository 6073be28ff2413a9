// Files in a page: each is unpacked as soon as the parser has passed it. The first, the viewer, runs once the page is read.
const unpacked = {}; // promises of bytes, by name

// Unpack the file of the script before this one.
function unpack() {
  const node = document.currentScript.previousElementSibling, { file, gzip, planes, steps } = node.dataset;
  unpacked[file] = bytesOf(node.textContent, gzip !== undefined).then((bytes) => planes ? inRows(bytes, +planes, steps !== undefined) : bytes);
  node.remove();
  unpacked[file].catch(() => {}); // whoever awaits it says so
}

async function bytesOf(text, gzip) {
  const bytes = fromBase64(text);
  return gzip ? new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer()) : bytes;
}

function fromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const bytes = new Uint8Array(3 * text.length / 4 - (/=*$/.exec(text.slice(-2))[0].length));
  for (let at = 0, to = 0; at < text.length; at += 1 << 22) {
    const binary = atob(text.slice(at, at + (1 << 22)));
    for (let i = 0; i < binary.length; i++) bytes[to++] = binary.charCodeAt(i);
  }
  return bytes;
}

// Rows of `width` bytes that are stored byte by byte of all rows; steps: as differences from the row before.
function inRows(bytes, width, steps) {
  const rows = new Uint8Array(bytes.length);
  for (let column = 0, from = 0; column < width; column++) {
    for (let at = column, value = 0; at < rows.length; at += width) rows[at] = value = steps ? value + bytes[from++] & 255 : bytes[from++];
  }
  return rows;
}

document.addEventListener("DOMContentLoaded", async () => {
  const code = new TextDecoder().decode(await unpacked.viewer);
  document.body.append(Object.assign(document.createElement("script"), { type: "module", textContent: code }));
});
