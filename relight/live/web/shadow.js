// Shadows of a mesh under a sun: a depth map from the sun, drawn by the processor. MIT licence.

export const SIZE = 1024; // texels along the longer side: a tenth of a percent of the scene, less than its vertices are apart

// Where a map of a mesh's positions (V, 3) lies, whose sun is in a direction: {size, texel, u, v, d, low, near, far}.
export function shadowFrame(positions, direction, size, seen = null) {
  const [dx, dy, dz] = direction, steep = Math.abs(dy) > 0.9;
  const ux = steep ? 0 : dz, uy = steep ? -dz : 0, uz = steep ? dy : -dx, length = Math.hypot(ux, uy, uz), u = [ux / length, uy / length, uz / length];
  const v = [dy * u[2] - dz * u[1], dz * u[0] - dx * u[2], dx * u[1] - dy * u[0]], [wx, wy, wz] = u, [vx, vy, vz] = v;
  let lowU = Infinity, lowV = Infinity, highU = -Infinity, highV = -Infinity, near = -Infinity, far = Infinity;
  for (let i = 0; i < positions.length; i += 3) {
    const x = positions[i], y = positions[i + 1], z = positions[i + 2], across = wx * x + wy * y + wz * z, down = vx * x + vy * y + vz * z, toward = dx * x + dy * y + dz * z;
    if (seen) {
      seen[i] = across;
      seen[i + 1] = down;
      seen[i + 2] = toward;
    }
    if (across < lowU) lowU = across;
    if (across > highU) highU = across;
    if (down < lowV) lowV = down;
    if (down > highV) highV = down;
    if (toward > near) near = toward;
    if (toward < far) far = toward;
  }
  const texel = Math.max(highU - lowU, highV - lowV, 1e-9) / (size - 4);
  return { size, texel, u, v, d: direction, low: [lowU - 2 * texel, lowV - 2 * texel], near, far };
}

// What a look-up needs: a place moved along its normal, and on by half of that, is hidden where the map is nearer to the sun.
export function mapOf({ size, texel, u, v, low, bias = BIAS }) {
  const scale = 1 / texel;
  return { size, off: bias * texel, scale, u, v, lowU: low[0] * scale + 0.5, lowV: low[1] * scale + 0.5 };
}

// positions (V, 3) and indices (F, 3) of the mesh, direction towards the sun, a unit vector.
export class Shadow {
  constructor({ positions, indices }, direction, size = SIZE, bias = BIAS) {
    const seen = new Float32Array(positions.length);
    Object.assign(this, shadowFrame(positions, direction, size, seen), { bias });
    const { texel, low: [left, top] } = this;
    this.depth = new Float32Array(size * size).fill(-Infinity);
    for (let i = 0; i < seen.length; i += 3) {
      seen[i] = (seen[i] - left) / texel;
      seen[i + 1] = (seen[i + 1] - top) / texel;
    }
    drawTriangles(seen, indices, this.depth, size);
  }

  map() {
    return { ...mapOf(this), depth: this.depth };
  }

  // Take from each share (N) what is hidden at its place (N, 3), where surfaces face along normals (N, 3): four texels
  // around the place, blended.
  hide(places, normals, share) {
    const { depth, size, off, scale, u: [ux, uy, uz], v: [vx, vy, vz], lowU, lowV } = this.map(), [dx, dy, dz] = this.d, last = size - 2;
    for (let n = 0, i = 0; n < share.length; n++, i += 3) {
      if (share[n] === 0) continue;
      const x = places[i] + off * normals[i], y = places[i + 1] + off * normals[i + 1], z = places[i + 2] + off * normals[i + 2];
      const column = (x * ux + y * uy + z * uz) * scale - lowU, row = (x * vx + y * vy + z * vz) * scale - lowV;
      if (!(column >= 0 && row >= 0 && column <= last && row <= last)) continue;
      const left = column | 0, top = row | 0, right = column - left, down = row - top, at = top * size + left;
      const t = x * dx + y * dy + z * dz + 0.5 * off;
      const above = (depth[at] < t ? 1 - right : 0) + (depth[at + 1] < t ? right : 0);
      const below = (depth[at + size] < t ? 1 - right : 0) + (depth[at + size + 1] < t ? right : 0);
      share[n] *= above + (below - above) * down;
    }
  }
}

const BIAS = 3; // texels along the normal, and half of it towards the sun: more leaks light into contacts, less is acne: by a trained garden, a trained room and a generated tabletop

// Triangles, (F, 3) of points (V, 3) in texels: the nearest to the sun stays in every texel whose centre one covers.
function drawTriangles(seen, indices, depth, size) {
  const last = size - 1;
  for (let f = 0; f < indices.length; f += 3) {
    const a = 3 * indices[f], b = 3 * indices[f + 1], c = 3 * indices[f + 2];
    const ax = seen[a], ay = seen[a + 1], bx = seen[b] - ax, by = seen[b + 1] - ay, cx = seen[c] - ax, cy = seen[c + 1] - ay;
    const right = Math.floor(ax + (bx > cx ? bx > 0 ? bx : 0 : cx > 0 ? cx : 0) - 0.5), left = Math.ceil(ax + (bx < cx ? bx < 0 ? bx : 0 : cx < 0 ? cx : 0) - 0.5);
    if (left > right) continue;
    const bottom = Math.floor(ay + (by > cy ? by > 0 ? by : 0 : cy > 0 ? cy : 0) - 0.5), top = Math.ceil(ay + (by < cy ? by < 0 ? by : 0 : cy < 0 ? cy : 0) - 0.5);
    const area = bx * cy - by * cx, whole = area < 0 ? -area : area;
    if (top > bottom || whole < 1e-12) continue;
    const sign = area < 0 ? -1 : 1, t = seen[a + 2], tb = (seen[b + 2] - t) / whole, tc = (seen[c + 2] - t) / whole, least = -1e-4 * whole;
    const first = left < 0 ? 0 : left, end = right > last ? last : right, low = bottom > last ? last : bottom, start = first + 0.5 - ax;
    const sbx = sign * bx, sby = sign * by, scx = sign * cx, scy = sign * cy;
    for (let y = top < 0 ? 0 : top; y <= low; y++) {
      const py = y + 0.5 - ay, down = py * scx, up = sbx * py;
      for (let x = first, at = y * size + first, px = start; x <= end; x++, at++, px++) {
        const second = px * scy - down, third = up - px * sby;
        if (second < least || third < least || whole - second - third < least) continue;
        const value = t + second * tb + third * tc;
        if (value > depth[at]) depth[at] = value;
      }
    }
  }
}
