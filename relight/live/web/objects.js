// Inserted objects: what they change where they were inserted, and an approximation of it where they are moved to. MIT licence.

import { Shadow } from "./shadow.js";

const MAP = 96, MAP_BIAS = 2; // texels along the side of the map of an object from each direction, and of its bias
const REACH = 5; // radii up to which a moved object changes light, but for that of suns and lamps
const LEAST_RATIO = 0.03; // as in relight: no shadow is black
const MOST_STRENGTH = 2; // by which the approximation is made stronger, at most; weaker by half
const SMALLEST = 0.004; // change of the logarithm of light, from which it counts

// Inserted objects: {light, angle, unit, mesh} with the rows of the splats that they change, their gains (M, 3), and what
// moves; null without. Throws an Error of one line.
export function objectsOf(entry, files) {
  if (!entry) return null;
  const bytes = sized(files, entry.file, entry.rows * 10);
  const rows = new Uint32Array(bytes.slice(0, 4 * entry.rows).buffer), gains = new Uint16Array(bytes.slice(4 * entry.rows).buffer);
  return { light: entry.light, angle: entry.angle_deg, unit: entry.unit, mesh: entry.mesh ? files[entry.mesh] : null, rows, gains, movable: movableOf(entry, files) };
}

function sized(files, name, size) {
  if (files[name]?.length !== size) throw new Error(`${name} holds ${files[name]?.length ?? 0} bytes, live.json says ${size}: export it again`);
  return files[name];
}

function movableOf({ moving, movable = [] }, files) {
  if (!movable.length) return [];
  const bytes = sized(files, moving, movable.reduce((sum, { vertices, faces, directions }) => sum + 12 * (vertices + faces) + 36 * directions, 0));
  let at = 0;
  const take = (Type, rows) => new Type(bytes.slice(at, at += 12 * rows).buffer);
  return movable.map((entry) => {
    const positions = take(Float32Array, entry.vertices), indices = take(Uint32Array, entry.faces);
    const directions = take(Float32Array, entry.directions), light = take(Float32Array, entry.directions), sent = take(Float32Array, entry.directions);
    return new Movable({ ...entry, positions, indices, directions, light, sent, splats: entry.splats ? files[entry.splats] : null });
  });
}

// The gains of splats (N, 4) with what objects do to them where they were inserted, in place.
export function besideObjects({ rows, gains: theirs, unit }, out) {
  for (let i = 0; i < rows.length; i++) times(out, 4 * rows[i], theirs[3 * i] / unit, theirs[3 * i + 1] / unit, theirs[3 * i + 2] / unit);
}

function times(out, at, r, g, b) {
  out[at] = Math.min(Math.round(out[at] * r), 65535);
  out[at + 1] = Math.min(Math.round(out[at + 1] * g), 65535);
  out[at + 2] = Math.min(Math.round(out[at + 2] * b), 65535);
}

// The same where some of them were moved. What a moved object changed is forgotten; the others keep what they change,
// exact where no moved one had a part in it.
export function besideMoved(objects, surface, lit, out) {
  const moved = objects.movable.filter(({ pose }) => pose.away), others = objects.movable.filter(({ pose }) => !pose.away);
  const mixed = new Set(moved.flatMap((each) => Array.from(each.first(surface, lit).rows)));
  const { rows, gains: theirs, unit } = objects;
  for (let i = 0; i < rows.length; i++) {
    if (!mixed.has(rows[i])) times(out, 4 * rows[i], theirs[3 * i] / unit, theirs[3 * i + 1] / unit, theirs[3 * i + 2] / unit);
  }
  const apply = (power, { rows: where, gains }, wanted) => {
    for (let i = 0; i < where.length; i++) if (wanted(where[i])) times(out, 4 * where[i], gains[3 * i] ** power, gains[3 * i + 1] ** power, gains[3 * i + 2] ** power);
  };
  for (const each of others) apply(strengthOf(each, objects, surface, lit), each.first(surface, lit), (row) => mixed.has(row));
  for (const each of moved) apply(strengthOf(each, objects, surface, lit), each.changed(surface, lit), () => true);
}

// The power of the approximated gains of an object that fits the exact ones best where it was inserted: bounces are in
// those alone.
export function strengthOf(object, { rows: known, gains: theirs, unit }, surface, lit) {
  if (object.strength) return object.strength;
  const { rows, gains } = object.first(surface, lit), at = new Map(Array.from(known, (row, i) => [row, i]));
  let both = 0, own = 0;
  for (let i = 0; i < rows.length; i++) {
    const exact = at.get(rows[i]);
    for (let k = 0; k < 3; k++) {
      const found = Math.log(gains[3 * i + k]);
      both += found * (exact === undefined ? 0 : Math.log(Math.max(theirs[3 * exact + k], 1) / unit));
      own += found * found;
    }
  }
  return object.strength = own > 0 ? Math.min(Math.max(both / own, 0.5), MOST_STRENGTH) : 1;
}

// One object that can be moved: pose {x, y, z, turn}, an offset and an angle about the vertical through its middle.
export class Movable {
  constructor(given) {
    Object.assign(this, given);
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity], { positions } = this;
    for (let i = 0; i < positions.length; i++) {
      low[i % 3] = Math.min(low[i % 3], positions[i]);
      high[i % 3] = Math.max(high[i % 3], positions[i]);
    }
    this.middle = low.map((value, k) => (value + high[k]) / 2);
    this.radius = 0;
    for (let i = 0; i < positions.length; i += 3) this.radius = Math.max(this.radius, Math.hypot(...this.middle.map((value, k) => positions[i + k] - value)));
    this.back();
  }

  back() {
    this.pose = { x: 0, y: 0, z: 0, turn: 0, away: false };
  }

  // Move it by an offset and a turn.
  move(x, y, z, turn = 0) {
    const { pose } = this;
    this.pose = { x: pose.x + x, y: pose.y + y, z: pose.z + z, turn: pose.turn + turn, away: true };
  }

  // A point (3) of the scene where the object was inserted, and a direction.
  own([x, y, z]) {
    const { pose, middle: [mx, my, mz] } = this, [ox, , oz] = turn([x - pose.x - mx, 0, z - pose.z - mz], -pose.turn);
    return [ox + mx, y - pose.y, oz + mz];
  }

  ownWay(direction) {
    return turn(direction, -this.pose.turn);
  }

  // Distance along a ray in the scene to where it meets the object, Infinity where it does not.
  met(start, direction) {
    const [ox, oy, oz] = this.own(start), [dx, dy, dz] = this.ownWay(direction), { positions: p, indices } = this;
    let nearest = Infinity;
    for (let f = 0; f < indices.length; f += 3) {
      const a = 3 * indices[f], b = 3 * indices[f + 1], c = 3 * indices[f + 2];
      const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2], vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
      const hx = dy * vz - dz * vy, hy = dz * vx - dx * vz, hz = dx * vy - dy * vx, area = ux * hx + uy * hy + uz * hz;
      if (Math.abs(area) < 1e-14) continue;
      const sx = ox - p[a], sy = oy - p[a + 1], sz = oz - p[a + 2], u = (sx * hx + sy * hy + sz * hz) / area;
      const qx = sy * uz - sz * uy, qy = sz * ux - sx * uz, qz = sx * uy - sy * ux, v = (dx * qx + dy * qy + dz * qz) / area;
      const t = (vx * qx + vy * qy + vz * qz) / area;
      if (u >= 0 && v >= 0 && u + v <= 1 && t > 0 && t < nearest) nearest = t;
    }
    return nearest;
  }

  // What it changes about where it was inserted, once: as `changed`.
  first(surface, lit) {
    if (!this.begun) {
      const { pose } = this;
      this.back();
      this.begun = this.changed(surface, lit);
      this.pose = pose;
    }
    return this.begun;
  }

  // Rows of splats and their gains (M, 3): what arrives from each direction, less what the object hides of it, plus what it
  // sends instead. surface: of `surfaceOf`. lit: a function of a row, whether that splat takes light.
  changed(surface, lit) {
    const rows = this.reached(surface, lit), count = rows.length, maps = this.maps(), { directions, light, even, sent } = this;
    const places = new Float32Array(3 * count), normals = new Float32Array(3 * count), before = new Float32Array(count), share = new Float32Array(count);
    for (let i = 0; i < count; i++) {
      const row = 3 * rows[i];
      places.set(this.own([surface.places[row], surface.places[row + 1], surface.places[row + 2]]), 3 * i);
      normals.set(this.ownWay([surface.normals[row], surface.normals[row + 1], surface.normals[row + 2]]), 3 * i);
    }
    const whole = new Float32Array(3 * count), change = new Float32Array(3 * count), solid = 4 * Math.PI / even;
    for (let k = 0; k < maps.length; k++) {
      const [dx, dy, dz] = maps[k].d, red = light[3 * k], green = light[3 * k + 1], blue = light[3 * k + 2], own = k < even ? solid : 0;
      for (let i = 0, j = 0; i < count; i++, j += 3) before[i] = share[i] = Math.max(normals[j] * dx + normals[j + 1] * dy + normals[j + 2] * dz, 0);
      maps[k].hide(places, normals, share);
      const r = sent[3 * k] * own - red, g = sent[3 * k + 1] * own - green, b = sent[3 * k + 2] * own - blue;
      for (let i = 0, j = 0; i < count; i++, j += 3) {
        const facing = before[i], hidden = facing - share[i];
        whole[j] += facing * red;
        whole[j + 1] += facing * green;
        whole[j + 2] += facing * blue;
        if (hidden === 0) continue;
        change[j] += hidden * r;
        change[j + 1] += hidden * g;
        change[j + 2] += hidden * b;
      }
    }
    const kept = [], gains = [];
    for (let i = 0; i < count; i++) {
      const ratios = [0, 1, 2].map((k) => whole[3 * i + k] > 0 ? Math.max(1 + change[3 * i + k] / whole[3 * i + k], LEAST_RATIO) : 1);
      if (!ratios.some((ratio) => Math.abs(Math.log(ratio)) > SMALLEST)) continue;
      kept.push(rows[i]);
      gains.push(...ratios.map((ratio) => ratio ** (1 / 2.4)));
    }
    return { rows: kept, gains };
  }

  // Rows of the splats near it, and of those that a sun or lamp may throw its shadow on.
  reached({ places }, lit) {
    const { pose, middle, radius, even, directions } = this, [x, y, z] = [middle[0] + pose.x, middle[1] + pose.y, middle[2] + pose.z], rows = [];
    const near = (REACH * radius) ** 2, wide = radius * radius, suns = [];
    for (let k = 3 * even; k < directions.length; k += 3) suns.push([directions[k], directions[k + 1], directions[k + 2]]);
    for (let row = 0, i = 0; i < places.length; row++, i += 3) {
      const tx = x - places[i], ty = y - places[i + 1], tz = z - places[i + 2], square = tx * tx + ty * ty + tz * tz;
      let meets = square < near;
      for (let k = 0; !meets && k < suns.length; k++) {
        const along = tx * suns[k][0] + ty * suns[k][1] + tz * suns[k][2];
        meets = along > 0 && square - along * along < wide;
      }
      if (meets && lit(row)) rows.push(row);
    }
    return rows;
  }

  // A map of it from each direction of the light, in its own frame; drawn anew where it was turned.
  maps() {
    if (this.drawnAt !== this.pose.turn) {
      this.drawn = Array.from({ length: this.directions.length / 3 }, (_, k) => new Shadow(this, this.ownWay(this.directions.subarray(3 * k, 3 * k + 3)), MAP, MAP_BIAS));
      this.drawnAt = this.pose.turn;
    }
    return this.drawn;
  }
}

function turn([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return [c * x + s * z, y, c * z - s * x];
}
