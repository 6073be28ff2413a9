// Stands in the place of the page: the passes that light splats, on a device of their own, beside what the processor makes of
// the same light. META, FILES and KIND come before it. Results: of each light {name, most, share}, steps of gains that
// differ at most, and the share of those that differ by more than two.

const APART = [{ on: false, factor: [1, 1, 1] }, { on: true, factor: [2, 1, 0.5] }, { on: false, factor: [9, 9, 9] }]; // of parts, where there are any

async function alone() {
  const files = Object.fromEntries(Object.entries(FILES).map(([name, text]) => [name, Uint8Array.fromBase64(text)])), splat = "splat.compressed.ply";
  const bundle = Live.readBundle(META, files, splat), proxy = Live.readProxy(files["proxy.glb"]), canvas = document.createElement("canvas"), results = [];
  document.body.append(canvas);
  const device = await createGraphicsDevice(canvas, { deviceTypes: [KIND] });
  ShaderChunks.get(device, SHADERLANGUAGE_GLSL).add(shaderChunksGLSL);
  ShaderChunks.get(device, SHADERLANGUAGE_WGSL).add(shaderChunksWGSL);
  setProgramLibrary(device, new ProgramLibrary(device, new StandardMaterial()));
  const { resource, stream } = resourceOf(device, files[splat], bundle.count), recolour = recolouring({ graphicsDevice: device }, resource, stream, bundle, proxy);
  const surface = Live.surfaceOf(bundle), balance = Live.balanceOf(0.3), ratio = new Float32Array(3 * bundle.count), gains = new Uint16Array(4 * bundle.count);
  const compare = async (name, asked) => {
    recolour.light(asked);
    const found = await recolour.read(), apart = Array.from(gains, (value, i) => Math.abs(value - found[i]));
    results.push({ name: `${device.deviceType} ${name}`, most: apart.reduce((a, b) => Math.max(a, b)), share: apart.filter((value) => value > 2).length / apart.length, spread: new Set(gains).size });
  };
  for (const entry of META.lights) for (const turn of [0, 1.3]) {
    const light = Live.lightOf(entry, files[entry.file]), { exposure } = light, factors = Live.factorsOf(bundle, light), table = Live.lightTable(bundle, light, turn, exposure);
    const suns = light.suns.map(({ direction, weight }) => ({ weight, direction: Live.turnedDirection(direction, turn) })), asked = { view: "relit", light, turn, exposure, table, suns, balance, factors, apart: bundle.parts && APART };
    Live.changes(bundle, table, ratio);
    Live.addSuns(bundle, surface, suns, suns.map(({ direction }) => new Live.Shadow(proxy, direction)), exposure, ratio);
    Live.balanced(ratio, balance);
    Live.addTerms(bundle, factors, ratio);
    if (bundle.parts) Live.apart(bundle.parts, APART, ratio);
    Live.gains(bundle, ratio, gains);
    if (!bundle.parts || APART[0].on) Live.showSky(bundle, light, turn, exposure, gains, factors[0]);
    await compare(`${light.name} ${turn}`, asked);
    if (turn) continue;
    Live.albedoChanges(bundle, surface, ratio);
    Live.balanced(ratio, balance);
    Live.gains(bundle, ratio, gains);
    await compare("albedo", { ...asked, view: "albedo" });
    gains.set(Live.plainGains(bundle.count));
    await compare("captured", { ...asked, view: "captured" });
  }
  return results;
}

// The textures of a compressed splat that the passes read, as the viewer's resource has them, and the stream that they write.
function resourceOf(device, bytes, count) {
  const text = new TextDecoder("latin1").decode(bytes.subarray(0, 4000)), chunks = Math.ceil(count / 256), names = text.split("element vertex")[0].match(/property float/g).length;
  const { buffer } = bytes.slice(text.indexOf("end_header\n") + 11), bounds = new Float32Array(buffer, 0, chunks * names), { x, y } = TextureUtils.calcTextureSize(count, new Vec2());
  const made = (name, wide, high, format, fill) => {
    const texture = Texture.createDataTexture2D(device, name, wide, high, format);
    fill?.(texture.lock());
    texture.unlock();
    return texture;
  };
  const packed = made("packedTexture", x, y, PIXELFORMAT_RGBA32U, (into) => into.set(new Uint32Array(buffer, bounds.byteLength, 4 * count)));
  const chunk = made("chunkTexture", 5 * chunks, 1, PIXELFORMAT_RGBA32F, (into) => {
    for (let i = 0; i < chunks; i++) for (let k = 0; k < 18; k++) into[20 * i + k] = k < names ? bounds[names * i + k] : k < 15 ? 0 : 1;
  });
  return { resource: { getTexture: () => packed, streams: { textures: new Map([["chunkTexture", chunk]]) } }, stream: Texture.createDataTexture2D(device, "live", x, y, PIXELFORMAT_RGBA16U) };
}

alone().then((results) => { window.results = results; }, (error) => { window.results = error.stack; });
