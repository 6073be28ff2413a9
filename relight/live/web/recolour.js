// The light of all splats on the graphics card: a pass that writes their gains into the stream that the viewer reads. It
// does what `changes`, `addSuns`, `addTerms`, `gains` and `showSky` of live.js do, which stay for what needs numbers.

const MOST_SUNS = 4, SUN_PARTS = 9, PARTS = SUN_PARTS + 4 * MOST_SUNS; // texels of uLiveParts, as `light` fills them
const BESIDE_BITS = 15; // lowest bits of a number that the terms' texture leaves out: 1/512 of its size at most

// A pass of the card: `draw` draws into a target, cleared before to a color where there is one.
class LivePass extends RenderPass {
  constructor(device, target, draw, color = null) {
    super(device);
    this.draw = draw;
    this.init(target);
    this.setClearColor(color ?? undefined);
    this.setClearDepth(color ? 1 : undefined);
  }

  execute() {
    this.draw(this.device);
  }
}

// The recolouring of a bundle's splats: light({view, light, turn, exposure, table, suns, balance, factors, apart}) brings their
// gains into `stream`; regroup() takes up which splats are in parts. proxy: the mesh that casts shadows.
function recolouring(app, resource, stream, bundle, proxy) {
  const device = app.graphicsDevice, { width, height } = stream, { weights, clusters, count, meta } = bundle;
  const near = { mipmaps: false, minFilter: FILTER_NEAREST, magFilter: FILTER_NEAREST, addressU: ADDRESS_CLAMP_TO_EDGE, addressV: ADDRESS_CLAMP_TO_EDGE };
  const texture = (name, wide, high, format = PIXELFORMAT_RGBA32F) => new Texture(device, { name, width: wide, height: high, format, ...near });
  const filled = (name, bytes, size, format) => {
    const made = texture(name, width, height, format), held = made.lock();
    new Uint8Array(held.buffer, held.byteOffset, held.byteLength).set(bytes.subarray(0, size * count));
    made.unlock();
    return made;
  };
  const size = 2 + weights, step = 1 + weights, lamps = bundle.terms.some(({ runs }) => runs), members = bundle.parts?.members, wide = PARTS + (members ? 256 : 1);
  const textures = {
    packedTexture: resource.getTexture("packedTexture"), chunkTexture: resource.streams.textures.get("chunkTexture"),
    uLiveRows: filled("rows", bundle.transfer, size, { 4: PIXELFORMAT_R32U, 8: PIXELFORMAT_RG32U, 16: PIXELFORMAT_RGBA32U }[size]),
    uLiveSurface: filled("surface", bundle.surface, 8, PIXELFORMAT_RG32U),
    uLiveParts: texture("parts", wide, 1), uLiveTable: texture("table", step, clusters), uLiveLeaves: texture("leaves", step * MOST_SUNS, clusters), uLiveImage: texture("image", 128, 64),
  };
  textures.uLiveBeside = lamps ? texture("beside", width, height, PIXELFORMAT_RGBA16U) : textures.uLiveSurface;
  textures.uLiveMembers = members ? texture("members", width, height, PIXELFORMAT_R32U) : textures.uLiveSurface;
  const regroup = () => {
    const held = textures.uLiveMembers.lock();
    for (let n = 0; n < count; n++) held[n] = members[2 * n] | members[2 * n + 1] << 8;
    textures.uLiveMembers.unlock();
  };
  if (members) regroup();
  for (let sun = 0; sun < MOST_SUNS; sun++) textures[`uLiveSun${sun}`] = textures.uLiveImage;
  const code = (text) => text.replaceAll("WEIGHTS", weights).replaceAll("APART", PARTS);
  const quad = new QuadRender(ShaderUtils.createShader(device, {
    uniqueName: `Recolour${weights}`, attributes: { vertex_position: "POSITION" }, vertexChunk: "fullscreenQuadVS",
    fragmentGLSL: code(RECOLOUR.glsl), fragmentWGSL: code(RECOLOUR.wgsl), fragmentOutputTypes: ["uvec4"],
  }));
  const pass = new LivePass(device, new RenderTarget({ colorBuffer: stream, depth: false }), () => {
    device.setDrawStates();
    for (const [name, each] of Object.entries(textures)) device.scope.resolve(name).setValue(each);
    quad.render();
  });
  const write = (into, values) => {
    into.lock().set(values);
    into.unlock();
  };
  const suns = [], frame = meta.frame.scene_from_splat, middle = frame.slice(0, 3).map((row) => row[3] + row.slice(0, 3).reduce((sum, value, k) => sum + value * meta.frame.middle[k], 0));
  const leafy = leavesIn(bundle), parts = new Float32Array(4 * wide);
  let tabled = null, pictured = null, besideText = null, leaves = null;
  return {
    regroup,
    read: () => stream.read(0, 0, width, height, { renderTarget: pass.renderTarget, immediate: true }),
    light({ view, light, turn, exposure, table, suns: shining, balance, factors, apart = null }) {
      const captured = light.sky === "captured", lit = view === "relit", set = (at, ...values) => parts.set(values, 4 * at);
      set(0, ["captured", "albedo", "relit"].indexOf(view), lit ? shining.length : 0, turn, exposure);
      for (let k = 0; k < 3; k++) set(1 + k, ...frame[k]);
      set(4, captured ? 1 : 0, ...middle);
      set(5, ...meta.surface.own, meta.surface.own_steps);
      set(6, ...balance, meta.surface.lift);
      if (lit) {
        const even = [0, 0, 0], placed = bundle.terms.map(({ runs }, index) => runs ? factors[index] : (factors[index].forEach((value, k) => { even[k] += Math.max(value, 0); }), null));
        set(7, ...even, apart ? 1 : 0);
        apart?.forEach(({ on, factor }, index) => set(PARTS + index, ...factor, on ? 1 : 0));
        set(8, ...Live.gainsOf(factors[0] ?? [1, 1, 1]), lamps && placed.some((factor) => factor?.some((value) => value > 0)) ? 1 : 0);
        if (parts[35]) putBeside(placed);
        if (table !== tabled) write(textures.uLiveTable, rgba(tabled = table, step, step));
        if (!captured && light.image !== pictured) write(textures.uLiveImage, rgba(pictured = light.image, 128, 128));
        if (leafy && shining.length) {
          leaves ??= new Float32Array(4 * step * MOST_SUNS * clusters);
          shining.forEach(({ direction, weight }, sun) => rgba(Live.sunTable(bundle, direction, weight, exposure), step, step * MOST_SUNS, step * sun, leaves));
          write(textures.uLiveLeaves, leaves);
        }
        shining.forEach(({ direction, weight }, sun) => {
          const { map, off, scale, u, v, lowU, lowV, size: side } = (suns[sun] ??= sunMap(device, proxy)).seen(direction), at = SUN_PARTS + 4 * sun;
          textures[`uLiveSun${sun}`] = map;
          set(at, ...direction, off);
          set(at + 1, ...weight.map((value) => value * exposure / Math.PI), side - 2);
          set(at + 2, ...u.map((value) => value * scale), lowU);
          set(at + 3, ...v.map((value) => value * scale), lowV);
        });
      }
      write(textures.uLiveParts, parts);
      pass.render();
    },
  };

  // What lamps add to every splat, where it differs from before.
  function putBeside(placed) {
    const text = JSON.stringify(placed);
    if (text === besideText) return;
    besideText = text;
    const sum = new Float32Array(3 * count), bits = new Uint32Array(sum.buffer), held = textures.uLiveBeside.lock();
    Live.addTerms(bundle, placed.map((factor) => factor ?? [0, 0, 0]), sum);
    for (let i = 0, to = 0; i < bits.length; i += 3, to += 4) {
      held[to] = bits[i] + 16384 >>> BESIDE_BITS;
      held[to + 1] = bits[i + 1] + 16384 >>> BESIDE_BITS;
      held[to + 2] = bits[i + 2] + 16384 >>> BESIDE_BITS;
    }
    textures.uLiveBeside.unlock();
  }
}

// Colours (N, 3), `wide` a row, as RGBA rows of `stride`, from a column on.
function rgba(colors, wide, stride, first = 0, out = new Float32Array(4 * stride * colors.length / (3 * wide))) {
  for (let i = 0, row = 0; i < colors.length; row++) {
    for (let column = 0, to = 4 * (row * stride + first); column < wide; column++, i += 3, to += 4) {
      out[to] = colors[i];
      out[to + 1] = colors[i + 1];
      out[to + 2] = colors[i + 2];
    }
  }
  return out;
}

function leavesIn({ surface, count }) {
  for (let n = 0, at = 7; n < count; n++, at += 8) if (surface[at] > 3) return true;
  return false;
}

// The map of a sun over a mesh: seen(direction) is `Shadow.map` of that direction with a texture for `map`. The card draws it, or
// the processor where the card does not write floats.
function sunMap(device, { positions, indices }) {
  const size = Live.SIZE, map = new Texture(device, {
    name: "sun", width: size, height: size, format: PIXELFORMAT_R32F, mipmaps: false,
    minFilter: FILTER_NEAREST, magFilter: FILTER_NEAREST, addressU: ADDRESS_CLAMP_TO_EDGE, addressV: ADDRESS_CLAMP_TO_EDGE,
  });
  let last = null, found = null, draw = null;
  const onCard = () => {
    const parts = new Texture(device, { name: "sun parts", width: 4, height: 1, format: PIXELFORMAT_RGBA32F, mipmaps: false, minFilter: FILTER_NEAREST, magFilter: FILTER_NEAREST });
    const mesh = new Mesh(device);
    mesh.setPositions(positions, 3);
    mesh.setIndices(indices);
    mesh.update(PRIMITIVE_TRIANGLES);
    const render = new QuadRender(ShaderUtils.createShader(device, { uniqueName: "Nearest", ...NEAREST }));
    const pass = new LivePass(device, new RenderTarget({ colorBuffer: map, depth: true }), () => {
      device.setDrawStates(BlendState.NOBLEND, DepthState.DEFAULT);
      device.scope.resolve("uSunParts").setValue(parts);
      device.setVertexBuffer(mesh.vertexBuffer);
      device.setShader(render.shader);
      if (device.supportsUniformBuffers) {
        device.setBindGroup(BINDGROUP_VIEW, device.emptyBindGroup);
        render.bindGroup.update();
        device.setBindGroup(BINDGROUP_MESH, render.bindGroup);
        device.setBindGroup(BINDGROUP_MESH_UB, device.emptyBindGroup);
      }
      device.draw(mesh.primitive[0], mesh.indexBuffer[0]);
    }, new Color(-1e30, 0, 0, 1));
    return (direction) => {
      const frame = Live.shadowFrame(positions, direction, size), { u, v, texel, low, near, far } = frame, across = 2 / (texel * size), deep = 2 / Math.max(near - far, 1e-9);
      parts.lock().set([
        ...u.map((value) => value * across), -low[0] * across - 1, ...v.map((value) => value * across), -low[1] * across - 1,
        ...direction.map((value) => -value * deep), near * deep - 1, ...direction, 0,
      ]);
      parts.unlock();
      pass.render();
      return Live.mapOf(frame);
    };
  };
  return {
    seen(direction) {
      const text = direction.join();
      if (text === last) return found;
      last = text;
      draw ??= device.textureFloatRenderable ? onCard() : (toward) => {
        const shadow = new Live.Shadow({ positions, indices }, toward);
        map.lock().set(shadow.depth);
        map.unlock();
        return shadow.map();
      };
      return found = { ...draw(direction), map };
    },
  };
}
