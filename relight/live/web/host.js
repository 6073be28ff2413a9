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

const SKY_HEIGHT = 256;

// Show a splat in the viewer. splat: its bytes, a compressed PLY. frame: scene_from_splat, 4 x 4. cameraFor: a function of
// the window's aspect, where to begin and what the key F shows.
async function host(container, splat, frame, cameraFor, options = {}) {
  const name = "splat.compressed.ply", camera = cameraFor(innerWidth / innerHeight);
  const viewer = await createViewer({
    container, contentUrl: name, contentFilename: name, contents: Promise.resolve(new Response(splat)), exposeGlobals: true,
    settings: settingsFor(camera), renderer: options.renderer, ui: options.ui ?? true, noanim: true,
  });
  relightCamera = () => {
    const { position, target, fov } = cameraFor(innerWidth / innerHeight);
    return createCamera(new Vec3(position), new Vec3(target), fov);
  };
  const { app } = viewer;
  app.scene.gsplat.dataFormat = "large"; // the compact one has 11 bits in 0..4 for a colour
  const entity = await arrival(app, frame);
  const { gsplat } = entity, { resource } = gsplat;
  resource.format.addExtraStreams([{ name: "live", format: PIXELFORMAT_RGBA16U }]);
  const stream = resource.getTexture("live");
  const show = (gains, most) => {
    stream.lock().set(gains);
    stream.unlock();
    gsplat.setParameter("uLiveMost", most);
    app.renderNextFrame = true;
  };
  show(new Uint16Array(stream.width * stream.height * 4).fill(1024).map((value, i) => i % 4 === 3 ? 0 : value), [1, 1, 1]);
  gsplat.setWorkBufferModifier(MODIFIER);
  await new Promise((resolve) => viewer.state.loaded ? resolve() : viewer.events.once("loaded:changed", resolve));
  if (viewer.state.cameraMode === "anim") viewer.state.cameraMode = "orbit"; // else a turn begins with the first key
  return { viewer, app, entity, camera, show, sky: skyOf(app), canvas: app.graphicsDevice.canvas };
}

// The splats' entity, as it arrives, turned so that the world is the scene.
function arrival(app, frame) {
  const place = (entity) => {
    const matrix = new Mat4().set([0, 1, 2, 3].flatMap((column) => frame.map((row) => row[column])));
    entity.setLocalPosition(matrix.getTranslation());
    entity.setLocalRotation(new Quat().setFromMat4(matrix));
    entity.setLocalScale(matrix.getScale());
    return entity;
  };
  const found = app.root.findByName("gsplat");
  if (found) return Promise.resolve(place(found));
  return new Promise((resolve) => {
    const add = app.root.addChild;
    app.root.addChild = function (child) {
      if (child.name === "gsplat") {
        app.root.addChild = add;
        resolve(place(child));
      }
      return add.call(this, child);
    };
  });
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
  return (image, angle, exposure) => {
    if (image) {
      const pixels = texture.lock(), color = [0, 0, 0];
      for (let row = 0, to = 0; row < SKY_HEIGHT; row++) {
        for (let column = 0; column < 2 * SKY_HEIGHT; column++, to += 4) {
          Live.lookUp(image, ...Live.texelDirection(row, column, SKY_HEIGHT, 2 * SKY_HEIGHT), angle, exposure, color);
          Live.toneMap(color);
          for (let k = 0; k < 3; k++) pixels[to + k] = 255 * color[k] + 0.5;
          pixels[to + 3] = 255;
        }
      }
      texture.unlock();
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
      draw(captured);
    },
  };
}
