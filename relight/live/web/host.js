// Live light in the SuperSplat viewer: a gain for every splat as a stream of its resource, a sky, two pictures side by side.
// It stands in one module with the viewer, whose engine it uses: Texture, Quat, Mat4 and Vec3 are PlayCanvas's.

const MODIFIER = {
  glsl: `
uniform vec3 uLiveMost;
void modifySplatCenter(inout vec3 center) {}
void modifySplatRotationScale(vec3 originalCenter, vec3 modifiedCenter, inout vec4 rotation, inout vec3 scale) {}
void modifySplatColor(vec3 center, inout vec4 color) {
  uvec4 live = loadLive();
  vec3 gain = vec3(live.rgb) / 1024.0;
  vec3 diffuse = getColor().rgb;
  vec3 lit = gain * (diffuse + 0.055) - 0.055 + (color.rgb - diffuse) * min(gain, uLiveMost);
  color.rgb = live.a == 1u ? gain : lit;
}`,
  wgsl: `
uniform uLiveMost: vec3f;
fn modifySplatCenter(center: ptr<function, vec3f>) {}
fn modifySplatRotationScale(originalCenter: vec3f, modifiedCenter: vec3f, rotation: ptr<function, vec4f>, scale: ptr<function, vec3f>) {}
fn modifySplatColor(center: vec3f, color: ptr<function, vec4f>) {
  let live = loadLive();
  let gain = vec3f(live.rgb) / 1024.0;
  let diffuse = vec3f(getColor().rgb);
  let lit = gain * (diffuse + 0.055) - 0.055 + ((*color).rgb - diffuse) * min(gain, uniform.uLiveMost);
  *color = vec4f(select(lit, gain, live.a == 1u), (*color).a);
}`,
};

// The same where something is glossy: `glossChange` of gloss.js, on linear colours, for the eye at uLiveEye.
const GLOSSY = {
  glsl: `
uniform highp sampler2D uLiveMirror;
uniform vec3 uLiveEye;
uniform vec4 uLiveHidden;
vec3 liveMirror(int x0, int row, vec3 r) {
  float across = (0.5 - atan(r.x, r.z) / 6.28318531) * 64.0 - 0.5;
  float down = clamp((0.5 - atan(r.y, length(r.xz)) / 3.14159265) * 32.0 - 0.5, 0.0, 31.0);
  int left = int(floor(across)), top = min(int(down), 30), a = x0 + ((left + 64) & 63), b = x0 + ((left + 65) & 63), y = row + top;
  float right = across - floor(across), low = down - float(top);
  vec3 above = mix(texelFetch(uLiveMirror, ivec2(a, y), 0).rgb, texelFetch(uLiveMirror, ivec2(b, y), 0).rgb, right);
  vec3 below = mix(texelFetch(uLiveMirror, ivec2(a, y + 1), 0).rgb, texelFetch(uLiveMirror, ivec2(b, y + 1), 0).rgb, right);
  return mix(above, below, low);
}
vec3 liveLinear(vec3 c) {
  return mix(c / 12.92, pow((max(c, vec3(0.0)) + 0.055) / 1.055, vec3(2.4)), step(vec3(0.04045), c));
}
float liveByte(uint word, int at) {
  return float(int(word << uint(24 - at)) >> 24);
}
vec3 liveLamps(uvec4 g, int count, int row, float alpha, vec3 center, vec3 n, vec3 toward) {
  vec3 sum = vec3(0.0);
  float seen = dot(n, toward);
  for (int i = 0; i < count; i++) {
    uint word = i < 2 ? g.z >> uint(16 + 8 * i) : g.w >> uint(8 * i - 16);
    vec4 lamp = texelFetch(uLiveMirror, ivec2(64 + 2 * i, row), 0), light = texelFetch(uLiveMirror, ivec2(65 + 2 * i, row), 0);
    vec3 way = lamp.xyz - center;
    float far = max(length(way), 1e-9), lit = dot(n, way) / far;
    if ((word & 255u) == 0u || lit <= 0.0) continue;
    vec3 h = way / far + toward;
    float cosine = dot(h, n) / max(length(h), 1e-9), wide = min(alpha + lamp.w / (2.0 * max(far, lamp.w)), 1.0), square = wide * wide;
    float spread = cosine * cosine * (square - 1.0) + 1.0;
    float arriving = 2.0 * lit / (lit + sqrt(square + (1.0 - square) * lit * lit)), leaving = 2.0 * seen / (seen + sqrt(square + (1.0 - square) * seen * seen));
    sum += square / (3.14159265 * spread * spread) * arriving * leaving / (4.0 * seen) * exp2((float(word & 255u) - 255.0) / light.w) * light.rgb;
  }
  return sum;
}
vec3 liveGloss(vec3 center, vec3 lit, vec3 gain) {
  uvec4 g = loadGloss();
  int material = int(g.x >> 16 & 255u) - 1;
  if (material < 0 || uLiveHidden.w == 0.0) return lit;
  int end = textureSize(uLiveMirror, 0).y - 3;
  vec4 of = texelFetch(uLiveMirror, ivec2(material & 127, end + (material >> 7)), 0);
  vec2 o = vec2(liveByte(g.x, 0), liveByte(g.x, 8)) / 127.0;
  vec3 n = vec3(o, 1.0 - abs(o.x) - abs(o.y));
  float fold = max(-n.z, 0.0);
  n.xy -= vec2(n.x < 0.0 ? -fold : fold, n.y < 0.0 ? -fold : fold);
  n = normalize(n);
  vec3 toward = normalize(uLiveEye - center);
  n = normalize(n + max(0.05 - dot(n, toward), 0.0) * toward);
  float cosine = dot(n, toward);
  vec3 r = 2.0 * cosine * n - toward;
  vec4 coefficients = vec4(liveByte(g.y, 16), liveByte(g.y, 24), liveByte(g.z, 0), liveByte(g.z, 8)), peaks;
  for (int i = 0; i < 4; i++) peaks[i] = texelFetch(uLiveMirror, ivec2(i, end + 2), 0).r;
  float seen = clamp(dot(coefficients * peaks, vec4(0.282095, 0.488603 * r.yzx)), 0.0, 1.0);
  float rise = fract(of.a) > 0.25 ? 1.0 : 1.0 + 24.0 * pow(1.0 - clamp(cosine, 0.0, 1.0), 5.0);
  vec3 strength = min(of.rgb * rise, vec3(1.0));
  vec3 stands = liveLinear(vec3(float(g.x >> 24), float(g.y & 255u), float(g.y >> 8 & 255u)) / 255.0);
  int row = 32 * int(floor(of.a));
  vec3 old = seen * liveMirror(0, row, r) + (1.0 - seen) * stands;
  vec3 now = seen * liveMirror(64, row, r) + (1.0 - seen) * stands * uLiveHidden.rgb;
  now += liveLamps(g, int(uLiveHidden.w) - 1, end + 2, texelFetch(uLiveMirror, ivec2(8 + int(floor(of.a)), end + 2), 0).r, center, n, toward);
  vec3 before = liveLinear(max(lit, vec3(0.0))), ratio = pow(gain, vec3(2.4));
  vec3 change = strength * (now - ratio * old);
  vec3 after = max(before + change, 0.02 * before);
  vec3 shown = mix(12.92 * after, 1.055 * pow(max(after, vec3(1e-9)), vec3(1.0 / 2.4)) - 0.055, step(vec3(0.0031308), after));
  return min(shown, max(lit, vec3(1.0)));
}`,
  wgsl: `
var uLiveMirror: texture_2d<uff>;
uniform uLiveEye: vec3f;
uniform uLiveHidden: vec4f;
fn liveTexel(x: i32, y: i32) -> vec4f {
  return textureLoad(uLiveMirror, vec2i(x, y), 0);
}
fn liveMirror(x0: i32, row: i32, r: vec3f) -> vec3f {
  let across = (0.5 - atan2(r.x, r.z) / 6.28318531) * 64.0 - 0.5;
  let down = clamp((0.5 - atan2(r.y, length(r.xz)) / 3.14159265) * 32.0 - 0.5, 0.0, 31.0);
  let left = i32(floor(across));
  let top = min(i32(down), 30);
  let a = x0 + ((left + 64) & 63);
  let b = x0 + ((left + 65) & 63);
  let y = row + top;
  let right = across - floor(across);
  let above = mix(liveTexel(a, y).rgb, liveTexel(b, y).rgb, right);
  let below = mix(liveTexel(a, y + 1).rgb, liveTexel(b, y + 1).rgb, right);
  return mix(above, below, down - f32(top));
}
fn liveLinear(c: vec3f) -> vec3f {
  return select(c / 12.92, pow((max(c, vec3f(0.0)) + 0.055) / 1.055, vec3f(2.4)), c > vec3f(0.04045));
}
fn liveByte(word: u32, at: u32) -> f32 {
  return f32(bitcast<i32>(word << (24u - at)) >> 24u);
}
fn liveLamps(g: vec4u, count: i32, row: i32, alpha: f32, center: vec3f, n: vec3f, toward: vec3f) -> vec3f {
  var sum = vec3f(0.0);
  let seen = dot(n, toward);
  for (var i = 0; i < count; i++) {
    var word = 0u;
    if (i < 2) { word = (g.z >> u32(16 + 8 * i)) & 255u; } else { word = (g.w >> u32(8 * i - 16)) & 255u; }
    let lamp = liveTexel(64 + 2 * i, row);
    let light = liveTexel(65 + 2 * i, row);
    let way = lamp.xyz - center;
    let far = max(length(way), 1e-9);
    let lit = dot(n, way) / far;
    if (word == 0u || lit <= 0.0) { continue; }
    let h = way / far + toward;
    let cosine = dot(h, n) / max(length(h), 1e-9);
    let wide = min(alpha + lamp.w / (2.0 * max(far, lamp.w)), 1.0);
    let square = wide * wide;
    let spread = cosine * cosine * (square - 1.0) + 1.0;
    let arriving = 2.0 * lit / (lit + sqrt(square + (1.0 - square) * lit * lit));
    let leaving = 2.0 * seen / (seen + sqrt(square + (1.0 - square) * seen * seen));
    sum += square / (3.14159265 * spread * spread) * arriving * leaving / (4.0 * seen) * exp2((f32(word) - 255.0) / light.w) * light.rgb;
  }
  return sum;
}
fn liveGloss(center: vec3f, lit: vec3f, gain: vec3f) -> vec3f {
  let g = loadGloss();
  let material = i32((g.x >> 16u) & 255u) - 1;
  if (material < 0 || uniform.uLiveHidden.w == 0.0) {
    return lit;
  }
  let end = i32(textureDimensions(uLiveMirror).y) - 3;
  let made = liveTexel(material & 127, end + (material >> 7u));
  let o = vec2f(liveByte(g.x, 0u), liveByte(g.x, 8u)) / 127.0;
  var n = vec3f(o, 1.0 - abs(o.x) - abs(o.y));
  let fold = max(-n.z, 0.0);
  n = vec3f(n.x - select(fold, -fold, n.x < 0.0), n.y - select(fold, -fold, n.y < 0.0), n.z);
  n = normalize(n);
  let toward = normalize(uniform.uLiveEye - center);
  n = normalize(n + max(0.05 - dot(n, toward), 0.0) * toward);
  let cosine = dot(n, toward);
  let r = 2.0 * cosine * n - toward;
  let coefficients = vec4f(liveByte(g.y, 16u), liveByte(g.y, 24u), liveByte(g.z, 0u), liveByte(g.z, 8u));
  let peaks = vec4f(liveTexel(0, end + 2).r, liveTexel(1, end + 2).r, liveTexel(2, end + 2).r, liveTexel(3, end + 2).r);
  let seen = clamp(dot(coefficients * peaks, vec4f(0.282095, 0.488603 * r.yzx)), 0.0, 1.0);
  let rise = select(1.0 + 24.0 * pow(1.0 - clamp(cosine, 0.0, 1.0), 5.0), 1.0, fract(made.a) > 0.25);
  let strength = min(made.rgb * rise, vec3f(1.0));
  let stands = liveLinear(vec3f(f32(g.x >> 24u), f32(g.y & 255u), f32((g.y >> 8u) & 255u)) / 255.0);
  let row = 32 * i32(floor(made.a));
  let old = seen * liveMirror(0, row, r) + (1.0 - seen) * stands;
  let hidden = seen * liveMirror(64, row, r) + (1.0 - seen) * stands * uniform.uLiveHidden.rgb;
  let now = hidden + liveLamps(g, i32(uniform.uLiveHidden.w) - 1, end + 2, liveTexel(8 + i32(floor(made.a)), end + 2).r, center, n, toward);
  let before = liveLinear(max(lit, vec3f(0.0)));
  let ratio = pow(gain, vec3f(2.4));
  let change = strength * (now - ratio * old);
  let after = max(before + change, 0.02 * before);
  let shown = select(12.92 * after, 1.055 * pow(max(after, vec3f(1e-9)), vec3f(1.0 / 2.4)) - 0.055, after > vec3f(0.0031308));
  return min(shown, max(lit, vec3f(1.0)));
}`,
};

// The modifier with gloss: declared ahead of it, and called on what it found.
const glossy = (text, code, from, to) => `${code}\n${text.replace(from, to)}`;
const modifierOf = (gloss) => !gloss ? MODIFIER : {
  glsl: glossy(MODIFIER.glsl, GLOSSY.glsl, "? gain : lit;", "? gain : liveGloss(center, lit, gain);"),
  wgsl: glossy(MODIFIER.wgsl, GLOSSY.wgsl, "select(lit, gain", "select(liveGloss(center, lit, gain), gain"),
};

const SKY_HEIGHT = 256;

// Open the viewer on a splat. contents: a promise of the bytes of a compressed PLY. cameraFor: a function of the window's
// aspect, where to begin and what the key F shows. Returns the viewer and the first camera.
async function opening(container, contents, cameraFor, options) {
  const name = "splat.compressed.ply", camera = cameraFor(innerWidth / innerHeight);
  const viewer = await createViewer({
    container, contentUrl: name, contentFilename: name, contents: contents.then((bytes) => new Response(bytes)), exposeGlobals: true,
    settings: settingsFor(camera), renderer: options.renderer, ui: options.ui, noanim: true,
  });
  relightCamera = () => {
    const { position, target, fov } = cameraFor(innerWidth / innerHeight);
    return createCamera(new Vec3(position), new Vec3(target), fov);
  };
  viewer.app.scene.gsplat.dataFormat = "large"; // the compact one has 11 bits in 0..4 for a colour
  return { viewer, camera };
}

// Wait until the viewer shows what it loaded.
async function shownIn(viewer) {
  await new Promise((resolve) => viewer.state.loaded ? resolve() : viewer.events.once("loaded:changed", resolve));
  if (viewer.state.cameraMode === "anim") viewer.state.cameraMode = "orbit"; // else a turn begins with the first key
}

// Show the splat of a bundle in the viewer. opened: a promise of {splat, bundle}, of which splat are the bytes of a compressed
// PLY. frame: scene_from_splat, 4 x 4. cameraFor: as `opening` takes it.
// options.proxy: the mesh that casts shadows. begin(stage, opened): lights the splats before they are first shown.
async function host(container, opened, frame, cameraFor, options, begin) {
  const { viewer, camera } = await opening(container, opened.then(({ splat }) => splat), cameraFor, options);
  const { app } = viewer;
  const { bundle } = await opened, objects = bundle.objects ? await objectsIn(app, bundle.objects, frame) : { show() {}, move() {} };
  const entity = await arrival(app, frame), { gsplat } = entity, { resource } = gsplat;
  resource.format.addExtraStreams([{ name: "live", format: PIXELFORMAT_RGBA16U }]);
  const stream = resource.getTexture("live");
  const shine = bundle.gloss ? shineOf(app, gsplat, resource, bundle.gloss) : () => {}, recolour = recolouring(app, resource, stream, bundle, options.proxy);
  // gains: of all splats, or what `recolouring` makes them of.
  const show = (gains, most, mirrored = null) => {
    if (ArrayBuffer.isView(gains)) {
      stream.lock().set(gains);
      stream.unlock();
    } else recolour.light(gains);
    gsplat.setParameter("uLiveMost", most);
    shine(mirrored);
    app.renderNextFrame = true;
  };
  gsplat.setWorkBufferModifier(modifierOf(bundle.gloss));
  const floor = bundle.ground ? floorIn(app, bundle.ground) : null;
  await begin({ viewer, app, entity, camera, show, recolour, objects, floor, sky: skyOf(app), canvas: app.graphicsDevice.canvas }, { bundle });
  await shownIn(viewer);
}

// Inserted objects among the splats: show(factor) shows them so many times as bright, or hides them; move(number, pose,
// middle) moves one, turned about the vertical through its middle. mesh: a binary glTF, unlit, or null.
async function objectsIn(app, { mesh, movable }, frame) {
  const root = new Entity("inserted"), shows = [], pivots = movable.map(({ name }) => new Entity(name));
  app.root.addChild(root);
  for (const pivot of pivots) root.addChild(pivot);
  if (mesh) {
    const entity = await meshOf(app, mesh), materials = new Set(entity.findComponents("render").flatMap(({ meshInstances }) => meshInstances.map(({ material }) => material)));
    root.addChild(entity);
    for (const node of entity.find(({ name }) => /^\d+ /.test(name))) pivots[parseInt(node.name) - 1]?.addChild(node);
    shows.push((factor) => {
      for (const material of materials) {
        material.diffuse.set(0, 0, 0); // the viewer's ambient light shines on unlit materials too
        material.emissiveIntensity = factor;
        material.update();
      }
    });
  }
  for (const [number, { splats }] of movable.entries()) if (splats) shows.push(await splatsOf(app, splats, frame, pivots[number]));
  return {
    show(factor) {
      root.enabled = factor > 0;
      if (factor > 0) for (const each of shows) each(factor);
    },
    move(number, { x, y, z, turn }, [mx, , mz]) {
      const c = Math.cos(turn), s = Math.sin(turn);
      pivots[number].setLocalEulerAngles(0, turn * 180 / Math.PI, 0);
      pivots[number].setLocalPosition(x + mx - c * mx - s * mz, y, z + mz - c * mz + s * mx);
      app.renderNextFrame = true;
    },
  };
}

function arrived(app, kind, name, contents) {
  const asset = new Asset(name, kind, { url: name, filename: name, contents });
  return new Promise((resolve, reject) => {
    asset.once("error", (error) => reject(new Error(`${name}: ${error}`)));
    asset.ready(() => resolve(asset));
    app.assets.add(asset);
    app.assets.load(asset);
  });
}

async function meshOf(app, bytes) {
  const asset = await arrived(app, "container", "inserted.glb", bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
  return asset.resource.instantiateRenderEntity();
}

// Inserted splats below an entity: a function that shows them so many times as bright.
async function splatsOf(app, bytes, frame, parent) {
  const asset = await arrived(app, "gsplat", "inserted.compressed.ply", Promise.resolve(new Response(bytes)));
  const entity = placed(new Entity("inserted splats"), frame);
  entity.addComponent("gsplat", { unified: true, asset });
  parent.addChild(entity);
  const { gsplat } = entity;
  gsplat.setParameter("uInsertedGain", 1);
  gsplat.setWorkBufferModifier(INSERTED);
  return (factor) => gsplat.setParameter("uInsertedGain", factor ** (1 / 2.4));
}

// An inserted splat at an exposure: its colour times a gain, by the curve of the others.
const INSERTED = {
  glsl: `
uniform float uInsertedGain;
void modifySplatCenter(inout vec3 center) {}
void modifySplatRotationScale(vec3 originalCenter, vec3 modifiedCenter, inout vec4 rotation, inout vec3 scale) {}
void modifySplatColor(vec3 center, inout vec4 color) {
  color.rgb = uInsertedGain * (color.rgb + 0.055) - 0.055;
}`,
  wgsl: `
uniform uInsertedGain: f32;
fn modifySplatCenter(center: ptr<function, vec3f>) {}
fn modifySplatRotationScale(originalCenter: vec3f, modifiedCenter: vec3f, rotation: ptr<function, vec4f>, scale: ptr<function, vec3f>) {}
fn modifySplatColor(center: vec3f, color: ptr<function, vec4f>) {
  *color = vec4f(uniform.uInsertedGain * ((*color).rgb + 0.055) - 0.055, (*color).a);
}`,
};

// A function that shows what is mirrored: {texture, hidden}, of `mirrorTexture` and how much brighter the scene is, or null
// for none. Splats are coloured anew wherever the eye goes.
function shineOf(app, gsplat, resource, gloss) {
  resource.format.addExtraStreams([{ name: "gloss", format: PIXELFORMAT_RGBA32U }]);
  const stream = resource.getTexture("gloss"), { width, height } = Live.mirrorSize(gloss), near = { minFilter: FILTER_NEAREST, magFilter: FILTER_NEAREST };
  stream.lock().set(gloss.packed);
  stream.unlock();
  const mirror = new Texture(app.graphicsDevice, { name: "mirror", width, height, format: PIXELFORMAT_RGBA32F, mipmaps: false, addressU: ADDRESS_CLAMP_TO_EDGE, addressV: ADDRESS_CLAMP_TO_EDGE, ...near });
  gsplat.setParameter("uLiveMirror", mirror);
  let last = "", on = false;
  const look = () => {
    const eye = app.root.findComponent("camera").entity.getPosition(), text = `${eye.x},${eye.y},${eye.z}`;
    if (text === last) return;
    last = text;
    gsplat.setParameter("uLiveEye", [eye.x, eye.y, eye.z]);
  };
  app.on("prerender", () => on && look());
  look();
  return (mirrored) => {
    on = mirrored !== null;
    gsplat.setParameter("uLiveHidden", on ? [...mirrored.hidden, 1 + gloss.lamps.length] : [1, 1, 1, 0]);
    if (!on) return;
    mirror.lock().set(mirrored.texture);
    mirror.unlock();
  };
}

// The splats' entity, as it arrives, turned so that the world is the scene.
function arrival(app, frame) {
  const found = app.root.findByName("gsplat");
  if (found) return Promise.resolve(placed(found, frame));
  return new Promise((resolve) => {
    const add = app.root.addChild;
    app.root.addChild = function (child) {
      if (child.name === "gsplat") {
        app.root.addChild = add;
        resolve(placed(child, frame));
      }
      return add.call(this, child);
    };
  });
}

function placed(entity, frame) {
  const matrix = new Mat4().set([0, 1, 2, 3].flatMap((column) => frame.map((row) => row[column])));
  entity.setLocalPosition(matrix.getTranslation());
  entity.setLocalRotation(new Quat().setFromMat4(matrix));
  entity.setLocalScale(matrix.getScale());
  return entity;
}

function settingsFor({ position, target, fov }) {
  const off = { enabled: false };
  return {
    version: 2, tonemapping: "none", highPrecisionRendering: false, background: { color: [0.13, 0.13, 0.14] },
    postEffectSettings: {
      sharpness: { ...off, amount: 0 }, bloom: { ...off, intensity: 0.1, blurLevel: 2 },
      grading: { ...off, brightness: 1, contrast: 1, saturation: 1, tint: [1, 1, 1] },
      vignette: { ...off, intensity: 0.5, inner: 0.3, outer: 0.75, curvature: 1 }, fringing: { ...off, intensity: 0.5 },
    },
    animTracks: [], cameras: [{ initial: { position, target, fov } }], annotations: [], startMode: "default",
  };
}

// A function that draws a sky: radiance 64 x 128, turned, or null for none.
function skyOf(app) {
  const texture = new Texture(app.graphicsDevice, {
    name: "sky", width: 2 * SKY_HEIGHT, height: SKY_HEIGHT, format: PIXELFORMAT_RGBA8, mipmaps: false,
    addressU: ADDRESS_REPEAT, addressV: ADDRESS_CLAMP_TO_EDGE, minFilter: FILTER_LINEAR, magFilter: FILTER_LINEAR,
  });
  let last = null;
  return (image, angle, exposure) => {
    const same = last && image === last.image && angle === last.angle && exposure === last.exposure;
    if (image && !same) {
      Live.paintSky(image, angle, exposure, SKY_HEIGHT, 2 * SKY_HEIGHT, texture.lock());
      texture.unlock();
      last = { image, angle, exposure };
    }
    app.scene.envAtlas = image ? texture : null;
    app.renderNextFrame = true;
  };
}

// Before and after: pictures of both, drawn in turn, on a canvas above the viewer's. draw(captured): show that side next.
function comparison(app, canvas, draw) {
  const above = document.createElement("canvas"), context = above.getContext("2d");
  above.id = "relight-compare";
  canvas.after(above);
  let line = 0.5, on = false, captured = false;
  app.on("frameend", () => {
    if (!on || !canvas.width) return;
    if (above.width !== canvas.width || above.height !== canvas.height) [above.width, above.height] = [canvas.width, canvas.height];
    const edge = Math.round(line * canvas.width), left = captured ? 0 : edge, width = captured ? edge : canvas.width - edge;
    if (width > 0) context.drawImage(canvas, left, 0, width, canvas.height, left, 0, width, canvas.height);
    context.fillStyle = "#fff";
    context.fillRect(edge - 1, 0, 2, canvas.height);
    captured = !captured;
    draw(captured);
  });
  return {
    element: above,
    set(enabled, at) {
      on = enabled;
      line = at;
      above.style.display = on ? "block" : "none";
      if (!on) captured = false;
      else draw(captured);
    },
  };
}
