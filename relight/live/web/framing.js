// Position of a camera that sees all of some points. Independent of page and engine: node runs it too. MIT licence.

const MARGIN = 1.08; // free space around the framed points, over their size

// The camera {position, target, fov} that looks like `camera` and holds the points inside its `bounds` in a window.
// points: x, y, z in a row. aspect: width over height. fov: degrees across the longer side, as the viewer has it. A
// camera without bounds is inside a place and stays unchanged.
export function framed(camera, points, aspect) {
  const { position, target, fov, bounds } = camera;
  if (!bounds) return { position, target, fov };
  const away = position.map((value, k) => value - target[k]), distance = Math.hypot(...away), back = away.map((value) => value / distance);
  const level = Math.hypot(back[0], back[2]) || 1, right = [back[2] / level, 0, -back[0] / level];
  const up = [back[1] * right[2], back[2] * right[0] - back[0] * right[2], -back[1] * right[0]];
  const longer = Math.tan(fov * Math.PI / 360) / MARGIN, wide = longer * Math.min(aspect, 1), high = longer / Math.max(aspect, 1);
  let most = [-Infinity, -Infinity, -Infinity, -Infinity], near = -Infinity, far = Infinity;
  const hold = (point) => {
    const x = dot3(point, right), y = dot3(point, up), z = dot3(point, back);
    most = [wide * z + x, wide * z - x, high * z + y, high * z - y].map((value, i) => Math.max(value, most[i]));
    [near, far] = [Math.max(near, z), Math.min(far, z)];
  };
  const [low, top] = bounds;
  for (let i = 0; i + 2 < points.length; i += 3) {
    const point = [points[i], points[i + 1], points[i + 2]];
    if (point.every((value, k) => value >= low[k] && value <= top[k])) hold(point);
  }
  if (near === -Infinity) for (let i = 0; i < 8; i++) hold([0, 1, 2].map((k) => bounds[i >> k & 1][k]));
  const depth = Math.max((most[0] + most[1]) / (2 * wide), (most[2] + most[3]) / (2 * high));
  const x = (most[0] - most[1]) / 2, y = (most[2] - most[3]) / 2;
  const at = (z) => [0, 1, 2].map((k) => x * right[k] + y * up[k] + z * back[k]);
  return { position: at(depth), target: at((near + far) / 2), fov };
}

const dot3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
