"""The light in a place under an environment and its lamps: suns, sky, windows, lamps and all bounces.

Suns are traced from every requested point, so their shadows are as sharp as the points are dense. All
else varies slowly: it is gathered once, at the vertices (and at the middle of each side of a leaf), and interpolated.
It shares no step with the transfer that it is compared to.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from relight import Environment
from splat2mesh.base.errors import InputError
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import luminance

from .light import distant_lights
from .splat import GOLDEN, PLASTIC

SUN_SHARE = 0.02
"""A texel with more of the environment's light than this is a sun."""

SKY_DIRECTIONS, WINDOW_POINTS, LAMP_POINTS = 192, 64, 32
"""Draws of the sky, shared by all points: steps of 0.5% in soft shadows. Points on each window, on each lamp."""

OPEN_GATHER, CLOSED_GATHER = 32, 144
"""Rays a point that bring bounced light: in the open it is a small part, in rooms it is the light."""

CLEARANCE_M = 1e-3
"""Offset of ray origins from the surface."""

INWARD = 0.08
"""How far a vertex is shaded from its own faces' middle, as a share of the way: off the edge where two walls meet."""

NEAR_WINDOW_M = 0.35
"""Nearer to a window's plane than this the points on it stand too far apart: the sky is drawn instead."""

BOUNCES = 24
"""Bounces through a room; each leaves at most the albedo's share of the remaining light."""

SMOOTHING = 6
"""Rounds of averaging over neighbours that look the same way, against the noise of the gathered light in rooms."""

RAYS_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class Lighting:
    """The light of a place.

    suns_toward, suns_irradiance: (S, 3) float32 unit directions, and the irradiance of each on a surface that faces it.
    ambient: (V, 3) float32, all other irradiance at every vertex over pi: reflected radiance is albedo x ambient.
    emission: factor on the place's lamps.
    """

    place: object
    caster: RayCaster
    environment: Environment
    suns_toward: np.ndarray
    suns_irradiance: np.ndarray
    ambient: np.ndarray
    emission: float

    def sunlight(self, points, normals):
        """Irradiance of the suns over pi at points (N, 3) of surfaces: (N, 3) float32."""
        return _sunlight(self.caster, self.suns_toward, self.suns_irradiance, points, normals)

    def radiance(self):
        """Exit radiance of every vertex: (V, 3) float32, linear, not exposed."""
        place = self.place
        sun = self.sunlight(*_vertex_points(place))
        sun = _two_sided(place, sun)
        return place.albedo_linear * (self.ambient + sun) + np.float32(self.emission) * place.emitted

    def at(self, faces, weights, points=None):
        """Exit radiance at points of the mesh: (N, 3) float32 linear, with the paints' own detail.

        faces: (N,) rows of place.faces. weights: (N, 3) barycentric.
        """
        place = self.place
        corners = place.faces[faces]

        def interpolated(values):
            return np.einsum("nc,nck->nk", weights, values[corners])

        points = interpolated(place.vertices) if points is None else points
        normals = interpolated(place.normals)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        albedo = place.albedo(points, normals, place.part[corners[:, 0]], interpolated(place.albedo_linear))
        sun = self.sunlight(points, normals)
        leafy = corners[:, 0] >= place.leaf_start
        if leafy.any() and place.transmittance:
            behind = self.sunlight(points[leafy], -normals[leafy])
            sun[leafy] += np.float32(place.transmittance) * (behind - sun[leafy])
        emitted = np.float32(self.emission) * interpolated(place.emitted)
        return (albedo * (interpolated(self.ambient) + sun) + emitted).astype(np.float32)


def light(place, environment, lamps=1.0):
    """Compute the light in a place: a Lighting.

    environment: relight.Environment. lamps: factor on what the place's lamps give off. Raises InputError for a
    negative factor.
    """
    if not lamps >= 0:
        raise InputError(f"lamps {lamps}: expected a factor of at least 0")
    caster = RayCaster(place.vertices, place.faces)
    suns_toward, suns_irradiance, sky = _without_suns(environment)
    shaded, of_vertex = _shading_points(place)
    points, normals = shaded
    direct = np.zeros_like(points)
    if luminance(sky.radiance).max() > 0:
        inside = _inside(place, points)
        direct[~inside] = _from_sky(caster, sky, points[~inside], normals[~inside])
        if inside.any() and len(place.openings):
            direct[inside] = _from_windows(caster, sky, place.openings, points[inside], normals[inside])
    emitted = np.float32(lamps) * place.emitted
    if emitted.any():
        direct += _from_lamps(caster, place, emitted, points, normals)
    sun = _sunlight(caster, suns_toward, suns_irradiance, points, normals)
    closed = place.openings is not None
    matrix = _gathering(caster, place, of_vertex, points, normals, CLOSED_GATHER if closed else OPEN_GATHER)
    albedo = np.zeros_like(points)
    albedo[of_vertex] = place.albedo_linear
    blend = _smoother(place, normals) if closed else None
    lit, bounced = _crossed(place, direct + sun, len(points)), np.zeros_like(points)
    for _ in range(BOUNCES):
        arriving = matrix @ (albedo * (lit + bounced))
        if blend is not None:
            for _ in range(SMOOTHING):
                arriving = blend @ arriving
        arriving = _crossed(place, arriving.astype(np.float32), len(points))
        change = np.abs(arriving - bounced).max() / max(arriving.max(), 1e-30)
        bounced = arriving
        if change < 1e-3:
            break
    ambient = (_crossed(place, direct, len(points)) + bounced)[of_vertex]
    return Lighting(place, caster, environment, suns_toward, suns_irradiance, ambient, float(lamps))


def _without_suns(environment):
    """Suns as directions and irradiances, (S, 3) float32 each, and the environment without them."""
    toward, irradiance, texel = distant_lights(environment)
    share = luminance(irradiance) / max(luminance(irradiance).sum(), 1e-30)
    suns = share > SUN_SHARE
    radiance = environment.radiance.copy()
    calm = np.median(radiance, axis=1)
    row, column = np.divmod(texel[suns], radiance.shape[1])
    radiance[row, column] = np.minimum(calm[row], radiance[row, column])
    sky = Environment(radiance, environment.name, environment.rotation_deg)
    return toward[suns], irradiance[suns], sky


def _shading_points(place):
    """Where light is gathered: points and normals (P, 3), and for each vertex (V,) its point.

    Every vertex of a solid, then the middle of each side of each leaf.
    """
    points, normals = _vertex_points(place)
    start = place.leaf_start
    sides = points[start:].reshape(-1, 4, 3).mean(axis=1)
    facing = normals[start:].reshape(-1, 4, 3)[:, 0]
    of_vertex = np.concatenate([np.arange(start), start + np.repeat(np.arange(len(sides)), 4)])
    return (np.concatenate([points[:start], sides]), np.concatenate([normals[:start], facing])), of_vertex


def _vertex_points(place):
    """The vertices moved slightly into their own faces, away from contacts: points and normals (V, 3) float32."""
    middle = place.vertices[place.faces].mean(axis=1)
    total = np.stack(
        [np.bincount(place.faces.ravel(), np.repeat(axis, 3), len(place.vertices)) for axis in middle.T], 1
    )
    count = np.maximum(np.bincount(place.faces.ravel(), minlength=len(place.vertices)), 1)
    toward = total / count[:, None] - place.vertices
    toward -= (toward * place.normals).sum(axis=1, keepdims=True) * place.normals
    return (place.vertices + INWARD * toward).astype(np.float32), place.normals


def _two_sided(place, values):
    """Values (V, 3) with each leaf's two sides mixed by its transmittance."""
    if place.leaf_start == len(values) or not place.transmittance:
        return values
    values = values.copy()
    leaves = values[place.leaf_start :].reshape(-1, 2, 4, 3)
    leaves += np.float32(place.transmittance) * (leaves[:, ::-1] - leaves)
    return values


def _crossed(place, values, count):
    """The same for shading points (P, 3), where each side of a leaf is one row."""
    if place.leaf_start == count or not place.transmittance:
        return values
    values = values.copy()
    leaves = values[place.leaf_start :].reshape(-1, 2, 3)
    leaves += np.float32(place.transmittance) * (leaves[:, ::-1] - leaves)
    return values


def _inside(place, points):
    """Which points lie within a place closed except for its windows, far enough from all of them: (P,) bool."""
    if place.openings is None:
        return np.zeros(len(points), bool)
    inside = np.ones(len(points), bool)
    for corner, along, up in place.openings:
        inward = np.cross(along, up)
        inside &= (points - corner) @ (inward / np.linalg.norm(inward)) > NEAR_WINDOW_M
    return inside


def _unoccluded(caster, points, normals, rows, toward, far=np.inf):
    """Which rays from points[rows] along `toward`, (R, 3), meet nothing within `far` lengths of it: (R,) bool."""
    free = np.empty(len(rows), bool)
    for start in range(0, len(rows), RAYS_AT_ONCE):
        block = slice(start, start + RAYS_AT_ONCE)
        origin = points[rows[block]] + np.float32(CLEARANCE_M) * normals[rows[block]]
        free[block] = ~caster.occluded(np.hstack([origin, toward[block]]), far)
    return free


def _sunlight(caster, toward, irradiance, points, normals):
    light = np.zeros((len(points), 3), np.float32)
    points, normals = np.asarray(points, np.float32), np.asarray(normals, np.float32)
    for way, power in zip(toward, irradiance, strict=True):
        cosine = normals @ way
        rows = np.flatnonzero(cosine > 0)
        free = _unoccluded(caster, points, normals, rows, np.broadcast_to(way, (len(rows), 3)))
        light[rows] += (cosine[rows] * free)[:, None] * power / np.float32(np.pi)
    return light


def _from_sky(caster, sky, points, normals, draws=SKY_DIRECTIONS):
    """Irradiance over pi of a sky without suns, by draws that all points share: (P, 3) float32."""
    toward, irradiance, _ = distant_lights(sky, draws)
    light, block = np.zeros_like(points), max(1, RAYS_AT_ONCE // len(toward))
    for start in range(0, len(points), block):
        rows = slice(start, start + block)
        cosine = np.maximum(normals[rows] @ toward.T, 0)
        point, way = np.nonzero(cosine)
        cosine[point, way] *= _unoccluded(caster, points[rows], normals[rows], point, toward[way])
        light[rows] = cosine @ irradiance / np.float32(np.pi)
    return light


def _from_windows(caster, sky, openings, points, normals):
    """The same through openings, by points spread over each: radiance x cosines x area / distance^2."""
    steps = np.arange(WINDOW_POINTS)
    u, v = ((steps / PLASTIC**power + 0.5) % 1.0 for power in (1, 2))
    light = np.zeros(points.shape)
    for corner, along, up in openings:
        inward = np.cross(along, up)
        area = np.linalg.norm(inward)
        spots = corner + u[:, None] * along + v[:, None] * up
        for spot in spots:
            toward = (spot - points).astype(np.float32)
            square = (toward**2).sum(axis=1)
            cosine = np.maximum((normals * toward).sum(axis=1), 0) * np.maximum(
                -toward @ (inward / area).astype(np.float32), 0
            )
            rows = np.flatnonzero(cosine > 0)
            free = _unoccluded(caster, points, normals, rows, toward[rows])
            rows = rows[free]
            share = cosine[rows] / square[rows] ** 2 * (area / WINDOW_POINTS / np.pi)
            light[rows] += share[:, None] * _nearest_texel(sky, toward[rows])
    return light.astype(np.float32)


def _nearest_texel(sky, toward):
    """Radiance of the texels that these directions, (N, 3), lie in: a hundred draws a point need no interpolation."""
    height, width = sky.radiance.shape[:2]
    x, y, z = toward.T
    longitude = np.arctan2(x, z) - np.float32(np.radians(sky.rotation_deg))
    column = np.floor((0.5 - longitude / np.float32(2 * np.pi)) * width).astype(np.int64) % width
    row = ((0.5 - np.arctan2(y, np.hypot(x, z)) / np.float32(np.pi)) * height).astype(np.int64)
    return sky.radiance[np.clip(row, 0, height - 1), column]


def _from_lamps(caster, place, emitted, points, normals):
    """Irradiance over pi of all that glows, by points spread over its area."""
    rows = np.flatnonzero(emitted[place.faces].any(axis=(1, 2)))
    corners = place.vertices[place.faces[rows]].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    reached = np.cumsum(area)
    count = LAMP_POINTS * len(np.unique(place.part[place.faces[rows, 0]]))
    steps = (np.arange(count) + 0.5) / count
    chosen = np.searchsorted(reached, steps * reached[-1])
    u, v = ((np.arange(count) / PLASTIC**power + 0.5) % 1.0 for power in (1, 2))
    u, v = np.where(u + v > 1, 1 - u, u)[:, None], np.where(u + v > 1, 1 - v, v)[:, None]
    a, b, c = corners[chosen].transpose(1, 0, 2)
    spots, outward = a + u * (b - a) + v * (c - a), cross[chosen] / (2 * area[chosen, None])
    glow = emitted[place.faces[rows[chosen]]].mean(axis=1)
    nearest = 0.25 * reached[-1] / count
    light = np.zeros_like(points)
    for spot, out, power in zip(spots, outward, glow, strict=True):
        toward = (spot + 2 * CLEARANCE_M * out - points).astype(np.float32)
        square = (toward**2).sum(axis=1)
        cosine = np.maximum((normals * toward).sum(axis=1), 0) * np.maximum(-toward @ out.astype(np.float32), 0)
        rows_lit = np.flatnonzero(cosine > 0)
        rows_lit = rows_lit[_unoccluded(caster, points, normals, rows_lit, toward[rows_lit], 1.0)]
        share = cosine[rows_lit] / np.maximum(square[rows_lit], nearest) ** 2 * (reached[-1] / count / np.pi)
        light[rows_lit] += share[:, None] * power
    return light


def _gathering(caster, place, of_vertex, points, normals, rays):
    """The mean over cosine-weighted rays of what each point sees: a sparse (P, P) matrix; rows sum to at most 1."""
    count = len(points)
    steps = np.arange(rays)
    radius, turn = np.sqrt((steps + 0.5) / rays), 2 * np.pi * steps / GOLDEN
    spin = 2 * np.pi * ((np.arange(count) / GOLDEN) % 1.0)
    helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    side = np.cross(normals, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(normals, side)
    parts, block = [], max(1, RAYS_AT_ONCE // rays)
    for start in range(0, count, block):
        rows = slice(start, min(start + block, count))
        angle = turn + spin[rows, None]
        toward = (radius * np.cos(angle))[..., None] * side[rows, None] + (radius * np.sin(angle))[..., None] * other[
            rows, None
        ]
        toward += np.sqrt(1 - radius**2)[:, None] * normals[rows, None]
        origin = np.broadcast_to((points[rows] + np.float32(CLEARANCE_M) * normals[rows])[:, None], toward.shape)
        hits = caster.first_hits(np.concatenate([origin, toward], axis=2))
        seen = hits.faces >= 0
        uv = hits.uv[seen]
        weights = np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1)
        corners = place.faces[hits.faces[seen]]
        front = np.einsum("nk,nk->n", toward[seen], place.normals[corners[:, 0]]) < 0
        nearest = corners[np.arange(len(corners)), weights.argmax(axis=1)]
        row = np.nonzero(seen)[0][front]
        shape = (rows.stop - rows.start, count)
        entries = np.full(len(row), 1.0 / rays, np.float32)
        parts.append(sparse.csr_matrix((entries, (row, of_vertex[nearest[front]])), shape))
    return sparse.vstack(parts, format="csr")


def _smoother(place, normals):
    """Averages each vertex with its neighbours that look the same way: a sparse (P, P) matrix; rows sum to 1."""
    faces = place.faces[: np.searchsorted(place.faces[:, 0], place.leaf_start)]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    alike = np.maximum((normals[edges[:, 0]] * normals[edges[:, 1]]).sum(axis=1), 0) ** 8
    count = len(normals)
    matrix = sparse.csr_matrix((alike, edges.T), (count, count)) + sparse.identity(count) * 2.0
    return sparse.diags(1.0 / np.asarray(matrix.sum(axis=1)).ravel()) @ matrix
