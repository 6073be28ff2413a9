// Shadows of a mesh under a sun: a depth map from the sun, drawn by the processor. MIT licence.

export const SIZE = 1024; // texels along the longer side: a tenth of a percent of the scene, less than its vertices are apart

// positions (V, 3) and indices (F, 3) of the mesh, direction towards the sun, a unit vector.
export class Shadow {
  constructor({ positions, indices }, direction, size = SIZE) {
    const [dx, dy, dz] = direction, steep = Math.abs(dy) > 0.9;
    const ux = steep ? 0 : dz, uy = steep ? -dz : 0, uz = steep ? dy : -dx, length = Math.hypot(ux, uy, uz);
    this.u = [ux / length, uy / length, uz / length];
    this.v = [dy * this.u[2] - dz * this.u[1], dz * this.u[0] - dx * this.u[2], dx * this.u[1] - dy * this.u[0]];
    this.d = direction;
    const count = positions.length / 3, seen = new Float32Array(count * 3), low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (let i = 0; i < count; i++) {
      for (let axis = 0; axis < 3; axis++) {
        const a = axis === 0 ? this.u : axis === 1 ? this.v : this.d;
        const value = a[0] * positions[3 * i] + a[1] * positions[3 * i + 1] + a[2] * positions[3 * i + 2];
        seen[3 * i + axis] = value;
        if (axis < 2) {
          if (value < low[axis]) low[axis] = value;
          if (value > high[axis]) high[axis] = value;
        }
      }
    }
    this.texel = Math.max(high[0] - low[0], high[1] - low[1], 1e-9) / (size - 4);
    this.low = low.map((value) => value - 2 * this.texel);
    this.size = size;
    this.depth = new Float32Array(size * size).fill(-Infinity);
    for (let i = 0; i < count; i++) for (let axis = 0; axis < 2; axis++) seen[3 * i + axis] = (seen[3 * i + axis] - this.low[axis]) / this.texel;
    for (let f = 0; f < indices.length; f += 3) this.draw(seen, 3 * indices[f], 3 * indices[f + 1], 3 * indices[f + 2]);
  }

  // One triangle: the nearest to the sun stays in every texel whose centre it covers.
  draw(seen, a, b, c) {
    const ax = seen[a], ay = seen[a + 1], bx = seen[b] - ax, by = seen[b + 1] - ay, cx = seen[c] - ax, cy = seen[c + 1] - ay;
    const area = bx * cy - by * cx;
    if (Math.abs(area) < 1e-12) return;
    const { depth, size } = this, t = seen[a + 2], tb = (seen[b + 2] - t) / area, tc = (seen[c + 2] - t) / area;
    const left = Math.max(0, Math.ceil(ax + Math.min(0, bx, cx) - 0.5)), right = Math.min(size - 1, Math.floor(ax + Math.max(0, bx, cx) - 0.5));
    const top = Math.max(0, Math.ceil(ay + Math.min(0, by, cy) - 0.5)), bottom = Math.min(size - 1, Math.floor(ay + Math.max(0, by, cy) - 0.5));
    const sign = Math.sign(area), least = -1e-4 * Math.abs(area);
    for (let y = top; y <= bottom; y++) {
      const py = y + 0.5 - ay;
      for (let x = left; x <= right; x++) {
        const px = x + 0.5 - ax, second = px * cy - py * cx, third = bx * py - by * px;
        if (sign * second < least || sign * third < least || sign * (area - second - third) < least) continue;
        const value = t + second * tb + third * tc, at = y * size + x;
        if (value > depth[at]) depth[at] = value;
      }
    }
  }

  // Take from each share (N) what is hidden at its place (N, 3), where surfaces face along normals (N, 3): four texels
  // around the place, blended.
  hide(places, normals, share) {
    const { texel, size, depth } = this, off = BIAS * texel, [ux, uy, uz] = this.u, [vx, vy, vz] = this.v, [dx, dy, dz] = this.d;
    const scale = 1 / texel, lowU = this.low[0] * scale + 0.5, lowV = this.low[1] * scale + 0.5, last = size - 2;
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

const BIAS = 2; // texels along the normal, and half of it towards the sun: more leaks light into contacts, less is acne
