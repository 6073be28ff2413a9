"""Light that arrives at objects, and the change that objects make at surrounding surfaces, with as few rays as needed.

The change at a vertex is the light from the object minus the light that came along the same rays before: from the sky,
other surfaces, suns and lamps. So a vertex that the object does not reach keeps its light to the bit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Mask
from splat2mesh.base.kernels import kernel
from splat2mesh.base.progress import Advance
from splat2mesh.base.threads import in_slices
from splat2mesh.render.raycaster import Hits, corner_weights

from ..lamps.tracing import DRAFT_RAYS, lamplight
from ..planning.costs import FOLLOWED
from ..transfer.occluder import BATCH_RAYS
from ..transfer.sampling import fibonacci_azimuths, hashed_offsets, shoot, tangents, turned
from ..transfer.sunlight import sunlight
from .standing import Standing
from .surroundings import Receiving, Surroundings, Together

OBJECT_RAYS = 256
"""Rays from each vertex of an object, in all directions."""

NEAR_RAYS = 8
"""Factor on the number of rays for a vertex within the sphere of an object, where they go in all directions. With
as many as elsewhere noise at contacts is three to four times as large."""

LEAST_CONE = 1.0 / 400.0
"""Part of a hemisphere that the sphere of an object must fill: a smaller part makes no visible change."""


def light_on(
    around: Surroundings, standing: Standing, seed: int = 0, advance: Advance = lambda count: None
) -> NDArray[np.float32]:
    """Return the exit radiance of white at the vertices of objects, (V, 3) float32, with light between them."""
    at, count = standing.occluder, len(standing.vertices)
    azimuths = fibonacci_azimuths(OBJECT_RAYS)
    received = np.zeros((count, 3), np.float32)
    rows, faces, weights = [], [], []
    size = max(1, BATCH_RAYS // OBJECT_RAYS)
    for start in range(0, count, size):
        part = slice(start, min(start + size, count))
        advance(0)
        rays = np.zeros((part.stop - start, OBJECT_RAYS, 6), np.float32)
        shoot(at.origins[part], at.normals[part], azimuths, seed, rays)
        flat = rays.reshape(-1, 6)
        own, behind = standing.caster.first_hits(flat), around.occluder.first_hits(flat)
        blocked = own.distance < behind.distance
        light = around.seen(behind, flat[:, 3:])
        light[blocked] = 0.0
        received[part] = light.reshape(-1, OBJECT_RAYS, 3).mean(axis=1)
        hit = np.flatnonzero(blocked)
        front = np.einsum("ij,ij->i", at.normals[at.faces[own.faces[hit]]].sum(axis=1), flat[hit, 3:]) < 0.0
        hit = hit[front]
        rows.append((start + hit // OBJECT_RAYS).astype(np.int32))
        faces.append(own.faces[hit])
        weights.append(corner_weights(own.uv[hit]))
    places = Receiving(at.origins, at.normals)
    received += _direct(around, Together(around.occluder, places, standing.caster), places)
    return _thrown_on(received, standing, np.concatenate(rows), np.concatenate(faces), np.concatenate(weights))


def _thrown_on(
    received: NDArray[np.float32],
    standing: Standing,
    rows: NDArray[np.int32],
    faces: NDArray[np.int32],
    weights: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Light (V, 3) including bounces within and between objects."""
    corners, found = standing.faces[faces], received
    for _ in range(FOLLOWED if len(rows) else 0):
        sent = standing.albedo * found + standing.emission
        met = np.einsum("nk,nkc->nc", weights, sent[corners]) / OBJECT_RAYS
        found = received + np.stack([np.bincount(rows, met[:, c], len(received)) for c in range(3)], axis=1)
    return found.astype(np.float32)


class Casting(NamedTuple):
    """How light is gathered. rays: to each object. seed: of them. least: part of a hemisphere that an object must
    fill."""

    rays: int
    seed: int = 0
    least: float = LEAST_CONE


def change_at(
    around: Surroundings,
    standing: Standing,
    sent: NDArray[np.float32],  # (V, 3) radiance of the objects' vertices
    how: Casting,
    at: Receiving,  # M places
    advance: Advance = lambda count: None,
) -> NDArray[np.float32]:
    """Return the change of irradiance over pi at M points due to objects, (M, 3) float32: exactly 0 where no ray meets
    an object."""
    change = np.zeros((len(at.origins), 3), np.float32)
    for number, (middle, radius) in enumerate(standing.spheres):
        reached = np.flatnonzero(in_reach(middle, radius, at, how.least))
        toward = middle - at.origins[reached]
        distance = np.linalg.norm(toward, axis=1)
        near = distance <= radius
        cosine = np.sqrt(1.0 - (radius / np.maximum(distance, radius)) ** 2).astype(np.float32)
        axis = np.where(near[:, None], at.normals[reached], toward / np.maximum(distance[:, None], 1e-12))
        for place, count in ((~near, how.rays), (near, NEAR_RAYS * how.rays)):
            many, size = how._replace(rays=count), max(1, BATCH_RAYS // count)
            for part in np.split(np.flatnonzero(place), range(size, int(place.sum()), size)):
                rows, cone = reached[part], (axis[part].astype(np.float32), cosine[part])
                change[rows] += _through(around, _Part(standing, number, sent), at.of(rows), cone, many)
                advance(len(part))
    before = _direct_where(around, standing, at)
    if len(before):
        places = at.of(before)
        change[before] += _direct(around, Together(around.occluder, places, standing.caster), places)
        change[before] -= _direct(around, Together(around.occluder, places), places)
    return change


def in_reach(middle: NDArray[np.float64], radius: float, at: Receiving, least: float = LEAST_CONE) -> Mask:
    """Mask (M,) of the points where an object may change light other than that of suns and lamps: those from which its
    sphere is large enough."""
    toward = middle - at.origins
    height = np.einsum("ij,ij->i", at.normals, toward)
    return np.asarray((radius**2 > least * (toward**2).sum(axis=1)) & (height > -radius))


class _Part(NamedTuple):
    """One of the objects, and what all of them send: radiance (V, 3) of their vertices."""

    standing: Standing
    number: int
    sent: NDArray[np.float32]


def _through(
    around: Surroundings,
    part: _Part,
    at: Receiving,
    cone: tuple[NDArray[np.float32], NDArray[np.float32]],
    how: Casting,
) -> NDArray[np.float32]:
    """Change (M, 3) that one object makes at M points, by the rays towards it. cone: its axes and cosines."""
    size, count, standing = len(at.origins), how.rays, part.standing
    rays, weights = np.zeros((size, count, 6), np.float32), np.zeros((size, count), np.float32)
    offsets = hashed_offsets(at.origins, at.normals, how.seed)
    in_slices(_aim, size, at.origins, at.normals, *cone, fibonacci_azimuths(count), offsets, rays, weights)
    live = np.flatnonzero(weights.ravel() > 0.0)
    flat = rays.reshape(-1, 6)[live]
    own = standing.caster.first_hits(flat)
    met = own.faces >= 0
    met[met] = standing.owner[own.faces[met]] == part.number
    live, flat = live[met], flat[met]
    behind = around.occluder.first_hits(flat)
    first = own.distance[met] < behind.distance
    live, flat = live[first], flat[first]
    before = around.seen(_of(behind, first), flat[:, 3:])
    corners = standing.faces[own.faces[met][first]]
    after = np.einsum("nk,nkc->nc", corner_weights(own.uv[met][first]), part.sent[corners])
    change = weights.ravel()[live, None] * (after - before)
    return np.stack([np.bincount(live // count, change[:, c], size) for c in range(3)], axis=1).astype(np.float32)


def _of(hits: Hits, rows: Mask) -> Hits:
    return Hits(hits.distance[rows], hits.faces[rows], hits.uv[rows], hits.normals[rows])


def _direct_where(around: Surroundings, standing: Standing, at: Receiving) -> Indices:
    """Rows of the points that may lie in the shadow of objects under suns and lamps: the way to the sphere of the light
    passes that of an object."""
    origins = at.origins.astype(np.float64)
    found = np.zeros(len(origins), bool)
    lights = [(1000.0 * direction, 0.0, 0.0) for direction in around.suns.directions]  # far outside the unit frame
    for lamp in [] if around.lamps is None else np.unique(around.lamps.lamp):
        assert around.lamps is not None
        own = around.lamps.of_lamp(int(lamp))
        center = 0.5 * (own.middle.min(axis=0) + own.middle.max(axis=0)).astype(np.float64)
        lights.append((center, 1.0, float((np.linalg.norm(own.middle - center, axis=1) + own.reach).max())))
    for place, near, size in lights:
        way = place - near * origins
        square = np.maximum(np.einsum("ij,ij->i", way, way), 1e-12)
        for middle, radius in standing.spheres:
            toward = middle - origins
            along = np.clip(np.einsum("ij,ij->i", toward, way) / square, 0.0, 1.0)
            apart = along[:, None] * way - toward
            found |= np.einsum("ij,ij->i", apart, apart) < (radius + along * size) ** 2
    return np.flatnonzero(found)


def _direct(around: Surroundings, occluder: Together, at: Receiving) -> NDArray[np.float32]:
    """Light of suns and lamps at the vertices of an occluder, (M, 3)."""
    found = np.zeros((len(at.origins), 3), np.float32)
    if len(around.suns):
        found += sunlight(occluder, slice(None), around.suns)
    if around.lamps is not None:
        found += lamplight(occluder, around.lamps, DRAFT_RAYS)
    return found


@kernel
def _aim(
    begin: int,
    end: int,
    origins: NDArray,
    normals: NDArray,
    axes: NDArray,
    cosines: NDArray,
    azimuths: NDArray,
    offsets: NDArray,
    rays: NDArray,
    weights: NDArray,
) -> None:
    """Directions evenly over a cone about an axis, and the weight of each in the irradiance over pi: solid angle times
    cosine over pi."""
    count, one = len(azimuths), np.float32(1)
    for v in range(begin, end):
        nx, ny, nz = normals[v]
        shift, (cos_turn, sin_turn) = offsets[v, 0], turned(offsets[v, 1])
        tx, ty, tz, bx, by, bz, ax, ay, az = tangents(axes[v, 0], axes[v, 1], axes[v, 2])
        solid = np.float32(2.0 * np.pi) * (one - cosines[v]) / np.float32(count)
        for i in range(count):
            height = one - (np.float32(i) + shift) / np.float32(count) * (one - cosines[v])
            radius = np.sqrt(max(one - height * height, np.float32(0)))
            u = radius * (cos_turn * azimuths[i, 0] - sin_turn * azimuths[i, 1])
            w = radius * (sin_turn * azimuths[i, 0] + cos_turn * azimuths[i, 1])
            dx, dy, dz = u * tx + w * bx + height * ax, u * ty + w * by + height * ay, u * tz + w * bz + height * az
            rays[v, i, 0], rays[v, i, 1], rays[v, i, 2] = origins[v]
            rays[v, i, 3], rays[v, i, 4], rays[v, i, 5] = dx, dy, dz
            weights[v, i] = solid * max(nx * dx + ny * dy + nz * dz, np.float32(0)) * np.float32(1.0 / np.pi)
