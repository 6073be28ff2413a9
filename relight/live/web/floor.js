// The ground under an object in the viewer: below its splats and above the sky, seen from above alone.

const FLOOR = {
  attributes: { aPosition: "POSITION", aUv0: "TEXCOORD0" },
  vertexGLSL: `
attribute vec3 aPosition;
attribute vec2 aUv0;
uniform mat4 matrix_viewProjection;
varying vec2 uv;
void main(void) {
  uv = aUv0;
  gl_Position = matrix_viewProjection * vec4(aPosition, 1.0);
  gl_Position.z = min(gl_Position.z, 0.99999 * gl_Position.w); // the viewer's far plane is behind the splats alone
}`,
  fragmentGLSL: `
uniform sampler2D uFloorShadow;
uniform vec4 uFloor;
varying vec2 uv;
void main(void) {
  vec4 dark = texture2D(uFloorShadow, uv);
  gl_FragColor = uFloor.a > 0.0 ? vec4(uFloor.rgb - dark.rgb * (uFloor.rgb + 0.055), dark.a) : vec4(dark.rgb, 0.055);
}`,
  vertexWGSL: `
attribute aPosition: vec3f;
attribute aUv0: vec2f;
uniform matrix_viewProjection: mat4x4f;
varying uv: vec2f;
@vertex
fn vertexMain(input: VertexInput) -> VertexOutput {
  var output: VertexOutput;
  output.uv = input.aUv0;
  output.position = uniform.matrix_viewProjection * vec4f(input.aPosition, 1.0);
  output.position.z = min(output.position.z, 0.99999 * output.position.w);
  return output;
}`,
  fragmentWGSL: `
var uFloorShadow: texture_2d<f32>;
var uFloorShadowSampler: sampler;
uniform uFloor: vec4f;
varying uv: vec2f;
@fragment
fn fragmentMain(input: FragmentInput) -> FragmentOutput {
  var output: FragmentOutput;
  let dark = textureSample(uFloorShadow, uFloorShadowSampler, input.uv);
  output.color = select(vec4f(dark.rgb, 0.055), vec4f(uniform.uFloor.rgb - dark.rgb * (uniform.uFloor.rgb + 0.055), dark.a), uniform.uFloor.a > 0.0);
  return output;
}`,
};

const ONE_MINUS_SOURCE = 3; // PlayCanvas' BLENDMODE_ONE_MINUS_SRC_COLOR, which the viewer leaves out
const CELL = 4; // points along the side of a cell of the mesh, whose texture is denser about the middle

// The ground: set(bytes, color) takes those of `groundShade`, on the sky where `color` is null, else on a disc of that
// display colour; show(on) shows or hides it.
function floorIn(app, ground) {
  const { side, height, reach, middle: [mx, mz], steps } = ground, device = app.graphicsDevice, world = app.scene.layers.getLayerById(LAYERID_WORLD);
  const texture = new Texture(device, {
    name: "floor", width: side, height: side, format: PIXELFORMAT_RGBA8, mipmaps: false,
    addressU: ADDRESS_CLAMP_TO_EDGE, addressV: ADDRESS_CLAMP_TO_EDGE, minFilter: FILTER_LINEAR, magFilter: FILTER_LINEAR,
  });
  const material = new ShaderMaterial({ uniqueName: "Floor", ...FLOOR });
  material.cull = CULLFACE_BACK;
  material.depthWrite = false;
  material.setParameter("uFloorShadow", texture);
  const cuts = Array.from({ length: Math.ceil((side - 1) / CELL) + 1 }, (_, i) => Math.min(i * CELL, side - 1)), across = cuts.length;
  const positions = [], uvs = [], indices = [];
  for (const row of cuts) for (const column of cuts) {
    positions.push(mx + reach * steps[column], height, mz + reach * steps[row]);
    uvs.push((column + 0.5) / side, (row + 0.5) / side);
  }
  for (let row = 0; row + 1 < across; row++) for (let column = 0; column + 1 < across; column++) {
    const a = row * across + column, b = a + 1, c = a + across, d = c + 1;
    indices.push(a, c, b, b, c, d);
  }
  const mesh = new Mesh(device);
  mesh.setPositions(new Float32Array(positions), 3);
  mesh.setUvs(0, new Float32Array(uvs), 2);
  mesh.setIndices(new Uint16Array(indices));
  mesh.update(PRIMITIVE_TRIANGLES);
  const instance = new MeshInstance(mesh, material), entity = new Entity("floor"), layer = new Layer({ name: "Floor" });
  instance.cull = instance.pick = false;
  app.scene.layers.insertTransparent(layer, app.scene.layers.getTransparentIndex(world));
  const camera = app.root.findComponent("camera");
  camera.layers = [...camera.layers, layer.id];
  entity.addComponent("render", { meshInstances: [instance], layers: [layer.id], castShadows: false });
  app.root.addChild(entity);
  return {
    show(on) {
      entity.enabled = on;
      app.renderNextFrame = true;
    },
    set(bytes, color) {
      texture.lock().set(bytes);
      texture.unlock();
      material.setParameter("uFloor", color ? [...color, 1] : [0, 0, 0, 0]);
      // On the sky its display colour c becomes (1 - dark) (c + .055) - .055.
      const over = color ? [BLENDEQUATION_ADD, BLENDMODE_SRC_ALPHA, BLENDMODE_ONE_MINUS_SRC_ALPHA] : [BLENDEQUATION_REVERSE_SUBTRACT, BLENDMODE_SRC_ALPHA, ONE_MINUS_SOURCE];
      material.blendState = new BlendState(true, ...over, BLENDEQUATION_ADD, BLENDMODE_ZERO, BLENDMODE_ONE);
      material.update();
    },
  };
}
