// Shaders of recolour.js: the gain of every splat, and the map of a sun. Texels of uLiveParts are those that `light` sets.

const RECOLOUR = {
  glsl: `
uniform highp usampler2D packedTexture;
uniform highp usampler2D uLiveRows;
uniform highp usampler2D uLiveSurface;
uniform highp usampler2D uLiveBeside;
uniform highp usampler2D uLiveMembers;
uniform highp sampler2D chunkTexture;
uniform highp sampler2D uLiveParts;
uniform highp sampler2D uLiveTable;
uniform highp sampler2D uLiveLeaves;
uniform highp sampler2D uLiveImage;
uniform highp sampler2D uLiveSun0;
uniform highp sampler2D uLiveSun1;
uniform highp sampler2D uLiveSun2;
uniform highp sampler2D uLiveSun3;
vec4 part(int i) { return texelFetch(uLiveParts, ivec2(i, 0), 0); }
vec3 sum(highp sampler2D table, int first, uvec4 row) {
  int cluster = int(row.x & 65535u);
  vec3 k = texelFetch(table, ivec2(first, cluster), 0).rgb;
  for (int w = 0; w < WEIGHTS; w++) {
    int weight = int(row[(w + 2) / 4] << uint(24 - 8 * ((w + 2) % 4))) >> 24;
    if (weight != 0) k += float(weight) * texelFetch(table, ivec2(first + 1 + w, cluster), 0).rgb;
  }
  return k;
}
float nearest(int sun, ivec2 at) {
  if (sun == 0) return texelFetch(uLiveSun0, at, 0).r;
  if (sun == 1) return texelFetch(uLiveSun1, at, 0).r;
  return sun == 2 ? texelFetch(uLiveSun2, at, 0).r : texelFetch(uLiveSun3, at, 0).r;
}
vec3 sunlight(int sun, vec3 place, vec3 n, float r) {
  vec4 toward = part(9 + 4 * sun), weight = part(10 + 4 * sun), across = part(11 + 4 * sun), down = part(12 + 4 * sun);
  float facing = r * dot(n, toward.xyz), light = 0.5 * (facing + sqrt(facing * facing + 0.25 * (1.0 - r) * (1.0 - r)));
  if (light <= 1e-3) return vec3(0.0);
  vec3 x = place + toward.w * n;
  float column = dot(x, across.xyz) - across.w, row = dot(x, down.xyz) - down.w, last = weight.w;
  if (column >= 0.0 && row >= 0.0 && column <= last && row <= last) {
    ivec2 at = ivec2(column, row);
    vec2 share = vec2(column, row) - vec2(at);
    float t = dot(x, toward.xyz) + 0.5 * toward.w;
    vec2 above = vec2(lessThan(vec2(nearest(sun, at), nearest(sun, at + ivec2(1, 0))), vec2(t)));
    vec2 below = vec2(lessThan(vec2(nearest(sun, at + ivec2(0, 1)), nearest(sun, at + ivec2(1, 1))), vec2(t)));
    vec2 seen = mix(above, below, share.y);
    light *= mix(seen.x, seen.y, share.x);
  }
  return light * weight.rgb;
}
vec3 sky(vec3 d, vec4 how) {
  float column = (0.5 - (atan(d.x, d.z) - how.z) / 6.28318531) * 128.0 - 0.5, row = (0.5 - atan(d.y, length(d.xz)) / 3.14159265) * 64.0 - 0.5;
  vec2 share = vec2(column, row) - floor(vec2(column, row));
  vec3 rows[2];
  for (int j = 0; j < 2; j++) {
    int y = int(floor(row)) + j, x = int(floor(column)) + (y < 0 || y > 63 ? 64 : 0);
    y = clamp(y, 0, 63);
    rows[j] = mix(texelFetch(uLiveImage, ivec2(x & 127, y), 0).rgb, texelFetch(uLiveImage, ivec2((x + 1) & 127, y), 0).rgb, share.x);
  }
  vec3 c = how.w * mix(rows[0], rows[1], share.y);
  float peak = max(c.r, max(c.g, c.b));
  if (peak > 0.8) {
    float shown = 1.0 - 0.04 / (peak - 0.6);
    c = shown * (1.0 + (c / peak - 1.0) / (0.15 * (peak - shown) + 1.0));
  }
  return mix(1.055 * pow(clamp(c, vec3(1e-6), vec3(1.0)), vec3(1.0 / 2.4)) - 0.055, 12.92 * max(c, vec3(0.0)), vec3(lessThanEqual(c, vec3(0.0031308))));
}
void main(void) {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec4 how = part(0), more = part(4);
  uvec2 s = texelFetch(uLiveSurface, at, 0).rg;
  uint kind = (s.y >> 24u) & 3u;
  pcFragColor0 = uvec4(1024u, 1024u, 1024u, 0u);
  if (how.x == 0.0 || kind == 0u || (kind == 2u && how.x == 1.0)) return;
  uvec4 splat = texelFetch(packedTexture, at, 0);
  int across = textureSize(chunkTexture, 0).x / 5, chunk = (at.y * textureSize(packedTexture, 0).x + at.x) >> 8;
  ivec2 c = ivec2(chunk % across * 5, chunk / across);
  vec4 a = texelFetch(chunkTexture, c, 0), b = texelFetch(chunkTexture, c + ivec2(1, 0), 0), d = texelFetch(chunkTexture, c + ivec2(3, 0), 0), e = texelFetch(chunkTexture, c + ivec2(4, 0), 0);
  vec4 place = vec4(mix(a.xyz, vec3(a.w, b.xy), vec3((uvec3(splat.x) >> uvec3(21u, 11u, 0u)) & uvec3(2047u, 1023u, 2047u)) / vec3(2047.0, 1023.0, 2047.0)), 1.0);
  vec3 x = vec3(dot(part(1), place), dot(part(2), place), dot(part(3), place)), k;
  if (kind == 2u) {
    if (part(7).a > 0.0 && part(APART).a == 0.0) return;
    if (more.x == 1.0) pcFragColor0.rgb = uvec3(part(8).rgb);
    else pcFragColor0 = uvec4(uvec3(floor(1024.0 * sky(x - more.yzw, how) + 0.5)), 1u);
    return;
  }
  vec2 o = vec2(int(s.x << 24u) >> 24, int(s.x << 16u) >> 24) / 127.0;
  vec3 n = vec3(o, 1.0 - abs(o.x) - abs(o.y));
  float fold = max(-n.z, 0.0);
  n = normalize(n - vec3(n.x < 0.0 ? -fold : fold, n.y < 0.0 ? -fold : fold, 0.0));
  vec3 q = part(5).rgb * exp2((vec3((uvec3(s.y) >> uvec3(0u, 8u, 16u)) & 255u) - 128.0) / part(5).a);
  if (how.x == 1.0) k = q * part(6).rgb;
  else {
    uvec4 row = texelFetch(uLiveRows, at, 0);
    float leaf = float(s.y >> 26u) / 63.0, r = float((s.x >> 16u) & 255u) / 255.0;
    x += part(6).a * float(int(s.x) >> 24) * n;
    k = sum(uLiveTable, 0, row);
    for (int sun = 0; sun < int(how.y); sun++) {
      if (leaf > 0.0) k += leaf * max(sum(uLiveLeaves, sun * (WEIGHTS + 1), row), vec3(0.0));
      k += (1.0 - leaf) * q * sunlight(sun, x, n, r);
    }
    k = k * part(6).rgb + part(7).rgb;
    if (part(8).a > 0.0) k += uintBitsToFloat(texelFetch(uLiveBeside, at, 0).rgb << 15u);
    if (part(7).a > 0.0) {
      uint member = texelFetch(uLiveMembers, at, 0).r;
      vec4 rest = part(APART), own = part(APART + int(member & 255u));
      k = mix(mix(vec3(1.0), k * rest.rgb, rest.a), mix(vec3(1.0), k * own.rgb, own.a), float(member >> 8u) / 255.0);
    }
  }
  vec3 color = floor(255.0 * mix(d.xyz, vec3(d.w, e.xy), vec3((uvec3(splat.w) >> uvec3(24u, 16u, 8u)) & 255u) / 255.0) + 0.5) / 255.0;
  color = clamp(color, 0.0, 1.0);
  color = max(mix(pow((color + 0.055) / 1.055, vec3(2.4)), color / 12.92, vec3(lessThanEqual(color, vec3(0.04045)))), vec3(1e-4));
  vec3 start = max(vec3(0.8), color), over = max(k * color - start, vec3(0.0)), room = max(1.0 - start, vec3(1e-3));
  k = mix(k, (start + room * (1.0 - exp(-over / room))) / color, vec3(greaterThan(over, vec3(0.0))));
  pcFragColor0.rgb = uvec3(floor(1024.0 * pow(clamp(k, vec3(6.1035e-5), vec3(1e4)), vec3(1.0 / 2.4)) + 0.5));
}`,
  wgsl: `
var packedTexture: texture_2d<u32>;
var uLiveRows: texture_2d<u32>;
var uLiveSurface: texture_2d<u32>;
var uLiveBeside: texture_2d<u32>;
var uLiveMembers: texture_2d<u32>;
var chunkTexture: texture_2d<uff>;
var uLiveParts: texture_2d<uff>;
var uLiveTable: texture_2d<uff>;
var uLiveLeaves: texture_2d<uff>;
var uLiveImage: texture_2d<uff>;
var uLiveSun0: texture_2d<uff>;
var uLiveSun1: texture_2d<uff>;
var uLiveSun2: texture_2d<uff>;
var uLiveSun3: texture_2d<uff>;
fn part(i: i32) -> vec4f { return textureLoad(uLiveParts, vec2i(i, 0), 0); }
fn weighed(row: vec4u, w: i32) -> f32 {
  return f32(bitcast<i32>(row[(w + 2) / 4] << u32(24 - 8 * ((w + 2) % 4))) >> 24u);
}
fn sumTable(row: vec4u) -> vec3f {
  let cluster = i32(row.x & 65535u);
  var k = textureLoad(uLiveTable, vec2i(0, cluster), 0).rgb;
  for (var w = 0; w < WEIGHTS; w++) { k += weighed(row, w) * textureLoad(uLiveTable, vec2i(1 + w, cluster), 0).rgb; }
  return k;
}
fn sumLeaves(first: i32, row: vec4u) -> vec3f {
  let cluster = i32(row.x & 65535u);
  var k = textureLoad(uLiveLeaves, vec2i(first, cluster), 0).rgb;
  for (var w = 0; w < WEIGHTS; w++) { k += weighed(row, w) * textureLoad(uLiveLeaves, vec2i(first + 1 + w, cluster), 0).rgb; }
  return k;
}
fn nearest(sun: i32, at: vec2i) -> f32 {
  if (sun == 0) { return textureLoad(uLiveSun0, at, 0).r; }
  if (sun == 1) { return textureLoad(uLiveSun1, at, 0).r; }
  if (sun == 2) { return textureLoad(uLiveSun2, at, 0).r; }
  return textureLoad(uLiveSun3, at, 0).r;
}
fn sunlight(sun: i32, place: vec3f, n: vec3f, r: f32) -> vec3f {
  let toward = part(9 + 4 * sun);
  let weight = part(10 + 4 * sun);
  let across = part(11 + 4 * sun);
  let down = part(12 + 4 * sun);
  let facing = r * dot(n, toward.xyz);
  var light = 0.5 * (facing + sqrt(facing * facing + 0.25 * (1.0 - r) * (1.0 - r)));
  if (light <= 1e-3) { return vec3f(0.0); }
  let x = place + toward.w * n;
  let column = dot(x, across.xyz) - across.w;
  let row = dot(x, down.xyz) - down.w;
  if (column >= 0.0 && row >= 0.0 && column <= weight.w && row <= weight.w) {
    let at = vec2i(i32(column), i32(row));
    let share = vec2f(column, row) - vec2f(at);
    let t = dot(x, toward.xyz) + 0.5 * toward.w;
    let above = vec2f(vec2f(nearest(sun, at), nearest(sun, at + vec2i(1, 0))) < vec2f(t));
    let below = vec2f(vec2f(nearest(sun, at + vec2i(0, 1)), nearest(sun, at + vec2i(1, 1))) < vec2f(t));
    let seen = mix(above, below, share.y);
    light *= mix(seen.x, seen.y, share.x);
  }
  return light * weight.rgb;
}
fn skyRow(row: i32, column: i32, share: f32) -> vec3f {
  let x = column + select(0, 64, row < 0 || row > 63);
  let y = clamp(row, 0, 63);
  return mix(textureLoad(uLiveImage, vec2i(x & 127, y), 0).rgb, textureLoad(uLiveImage, vec2i((x + 1) & 127, y), 0).rgb, share);
}
fn skyColor(d: vec3f, how: vec4f) -> vec3f {
  let column = (0.5 - (atan2(d.x, d.z) - how.z) / 6.28318531) * 128.0 - 0.5;
  let row = (0.5 - atan2(d.y, length(d.xz)) / 3.14159265) * 64.0 - 0.5;
  let top = i32(floor(row));
  let left = i32(floor(column));
  var c = how.w * mix(skyRow(top, left, fract(column)), skyRow(top + 1, left, fract(column)), fract(row));
  let peak = max(c.r, max(c.g, c.b));
  if (peak > 0.8) {
    let shown = 1.0 - 0.04 / (peak - 0.6);
    c = shown * (1.0 + (c / peak - 1.0) / (0.15 * (peak - shown) + 1.0));
  }
  return select(1.055 * pow(clamp(c, vec3f(1e-6), vec3f(1.0)), vec3f(1.0 / 2.4)) - 0.055, 12.92 * max(c, vec3f(0.0)), c <= vec3f(0.0031308));
}
fn gainOf(at: vec2i) -> vec4u {
  let how = part(0);
  let more = part(4);
  let s = textureLoad(uLiveSurface, at, 0).rg;
  let kind = (s.y >> 24u) & 3u;
  if (how.x == 0.0 || kind == 0u || (kind == 2u && how.x == 1.0)) { return vec4u(1024u, 1024u, 1024u, 0u); }
  let splat = textureLoad(packedTexture, at, 0);
  let across = i32(textureDimensions(chunkTexture).x) / 5;
  let chunk = (at.y * i32(textureDimensions(packedTexture).x) + at.x) >> 8u;
  let c = vec2i(chunk % across * 5, chunk / across);
  let a = textureLoad(chunkTexture, c, 0);
  let b = textureLoad(chunkTexture, c + vec2i(1, 0), 0);
  let d = textureLoad(chunkTexture, c + vec2i(3, 0), 0);
  let e = textureLoad(chunkTexture, c + vec2i(4, 0), 0);
  let share = vec3f((vec3u(splat.x) >> vec3u(21u, 11u, 0u)) & vec3u(2047u, 1023u, 2047u)) / vec3f(2047.0, 1023.0, 2047.0);
  let place = vec4f(mix(a.xyz, vec3f(a.w, b.xy), share), 1.0);
  var x = vec3f(dot(part(1), place), dot(part(2), place), dot(part(3), place));
  if (kind == 2u) {
    if (part(7).a > 0.0 && part(APART).a == 0.0) { return vec4u(1024u, 1024u, 1024u, 0u); }
    if (more.x == 1.0) { return vec4u(vec3u(part(8).rgb), 0u); }
    return vec4u(vec3u(floor(1024.0 * skyColor(x - more.yzw, how) + 0.5)), 1u);
  }
  let o = vec2f(f32(bitcast<i32>(s.x << 24u) >> 24u), f32(bitcast<i32>(s.x << 16u) >> 24u)) / 127.0;
  var n = vec3f(o, 1.0 - abs(o.x) - abs(o.y));
  let fold = max(-n.z, 0.0);
  n = normalize(n - vec3f(select(fold, -fold, n.x < 0.0), select(fold, -fold, n.y < 0.0), 0.0));
  let q = part(5).rgb * exp2((vec3f((vec3u(s.y) >> vec3u(0u, 8u, 16u)) & vec3u(255u)) - 128.0) / part(5).a);
  var k = q * part(6).rgb;
  if (how.x != 1.0) {
    let row = textureLoad(uLiveRows, at, 0);
    let leaf = f32(s.y >> 26u) / 63.0;
    let r = f32((s.x >> 16u) & 255u) / 255.0;
    x += part(6).a * f32(bitcast<i32>(s.x) >> 24u) * n;
    k = sumTable(row);
    for (var sun = 0; sun < i32(how.y); sun++) {
      if (leaf > 0.0) { k += leaf * max(sumLeaves(sun * (WEIGHTS + 1), row), vec3f(0.0)); }
      k += (1.0 - leaf) * q * sunlight(sun, x, n, r);
    }
    k = k * part(6).rgb + part(7).rgb;
    if (part(8).a > 0.0) { k += bitcast<vec3f>(textureLoad(uLiveBeside, at, 0).rgb << vec3u(15u)); }
    if (part(7).a > 0.0) {
      let member = textureLoad(uLiveMembers, at, 0).r;
      let rest = part(APART);
      let own = part(APART + i32(member & 255u));
      k = mix(mix(vec3f(1.0), k * rest.rgb, rest.a), mix(vec3f(1.0), k * own.rgb, own.a), f32(member >> 8u) / 255.0);
    }
  }
  let bytes = vec3f((vec3u(splat.w) >> vec3u(24u, 16u, 8u)) & vec3u(255u)) / 255.0;
  var color = clamp(floor(255.0 * mix(d.xyz, vec3f(d.w, e.xy), bytes) + 0.5) / 255.0, vec3f(0.0), vec3f(1.0));
  color = max(select(pow((color + 0.055) / 1.055, vec3f(2.4)), color / 12.92, color <= vec3f(0.04045)), vec3f(1e-4));
  let start = max(vec3f(0.8), color);
  let over = max(k * color - start, vec3f(0.0));
  let room = max(1.0 - start, vec3f(1e-3));
  k = select(k, (start + room * (1.0 - exp(-over / room))) / color, over > vec3f(0.0));
  return vec4u(vec3u(floor(1024.0 * pow(clamp(k, vec3f(6.1035e-5), vec3f(1e4)), vec3f(1.0 / 2.4)) + 0.5)), 0u);
}
@fragment
fn fragmentMain(input: FragmentInput) -> FragmentOutput {
  var output: FragmentOutput;
  output.color = gainOf(vec2i(input.position.xy));
  return output;
}`,
};

// What is nearest to a sun in every texel of its map, as `Shadow` of shadow.js has it. uSunParts: across, down and towards the
// sun, each as clip space has it; what the map holds.
const NEAREST = {
  attributes: { aPosition: "POSITION" },
  vertexGLSL: `
attribute vec3 aPosition;
uniform highp sampler2D uSunParts;
varying highp float vNearness;
vec4 part(int i) { return texelFetch(uSunParts, ivec2(i, 0), 0); }
void main(void) {
  vec4 place = vec4(aPosition, 1.0);
  vNearness = dot(part(3), place);
  gl_Position = vec4(dot(part(0), place), dot(part(1), place), dot(part(2), place), 1.0);
}`,
  fragmentGLSL: `
varying highp float vNearness;
void main(void) {
  gl_FragColor = vec4(vNearness, 0.0, 0.0, 1.0);
}`,
  vertexWGSL: `
attribute aPosition: vec3f;
var uSunParts: texture_2d<uff>;
varying vNearness: f32;
fn part(i: i32) -> vec4f { return textureLoad(uSunParts, vec2i(i, 0), 0); }
@vertex
fn vertexMain(input: VertexInput) -> VertexOutput {
  var output: VertexOutput;
  let place = vec4f(input.aPosition, 1.0);
  output.vNearness = dot(part(3), place);
  output.position = vec4f(dot(part(0), place), -dot(part(1), place), 0.5 * dot(part(2), place) + 0.5, 1.0);
  return output;
}`,
  fragmentWGSL: `
varying vNearness: f32;
@fragment
fn fragmentMain(input: FragmentInput) -> FragmentOutput {
  var output: FragmentOutput;
  output.color = vec4f(input.vNearness, 0.0, 0.0, 1.0);
  return output;
}`,
};
