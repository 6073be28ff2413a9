"""Light that arrives at objects, and what they change at the surfaces around them: rays, as few as reach something.

What an object changes at a vertex is what it sends there less what came along the same rays before: of the sky, of
other surfaces, of suns and of lamps. So a vertex that it does not reach keeps its light to the bit.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Mask
from splat2mesh.base.progress import Advance
from splat2mesh.base.threads import in_slices
from splat2mesh.render.raycaster import Hits

from ..lamps.tracing import lamplight
from ..transfer.sampling import fibonacci_azimuths, hashed_offsets, shoot
from ..transfer.sunlight import sunlight
from .standing import Standing
from .surroundings import LAMP_RAYS, Receiving, Surroundings, Together, weights_of

BATCH_RAYS = 2**20

OBJECT_RAYS = 256
"""From each vertex of an object, all around."""

OWN_ROUNDS = 4
"""Of light between the parts of objects."""

NEAR_RAYS = 4
"""Times as many rays where a vertex lies within the sphere of an object, and they go all around."""

NEAR = 1.05
"""Radii of that sphere up to which they do: its cone would be nearly half of all directions."""

BOX = 1.001
"""Times the reach of an object: half the side of its box, with room for rounding."""

LEAST_CONE = 1.0 / 400.0
"""Part of a hemisphere that the sphere of an object must fill: less changes no light that is seen."""


def light_on(
    around: Surroundings, standing: Standing, seed: int = 0, advance: Advance = lambda count: None
) -> NDArray[np.float32]:
    """Return what white would send on at the vertices of objects, (V, 3) float32, light between them included."""
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
        weights.append(weights_of(own.uv[hit]))
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
    """Light (V, 3) with what objects send to each other and to themselves."""
    corners, found = standing.faces[faces], received
    for _ in range(OWN_ROUNDS if len(rows) else 0):
        sent = standing.albedo * found + standing.emission
        met = np.einsum("nk,nkc->nc", weights, sent[corners]) / OBJECT_RAYS
        found = received + np.stack([np.bincount(rows, met[:, c], len(received)) for c in range(3)], axis=1)
    return found.astype(np.float32)


def change_at(
    around: Surroundings,
    standing: Standing,
    sent: NDArray[np.float32],  # (V, 3) radiance of the objects' vertices
    rays: int,  # to each object
    at: Receiving,  # M places
    seed: int = 0,
    advance: Advance = lambda count: None,
    least: float = LEAST_CONE,  # part of a hemisphere that an object must fill
) -> NDArray[np.float32]:
    """Return by how much objects change the irradiance over pi of places, (M, 3) float32: exactly 0 where none of the
    rays meets one."""
    change = np.zeros((len(at.origins), 3), np.float32)
    for number, (middle, radius) in enumerate(standing.spheres):
        reached = np.flatnonzero(in_reach(middle, radius, at, least))
        toward = middle - at.origins[reached]
        distance = np.linalg.norm(toward, axis=1)
        near = distance < NEAR * radius
        for inside, count in ((False, rays), (True, NEAR_RAYS * rays)):
            place = np.flatnonzero(near if inside else ~near)
            size = max(1, BATCH_RAYS // count)
            for start in range(0, len(place), size):
                part = place[start : start + size]
                cosine = np.full(len(part), -2.0, np.float32)
                if not inside:
                    cosine = np.sqrt(1.0 - (radius / distance[part]) ** 2).astype(np.float32)
                axis = (toward[part] / np.maximum(distance[part, None], 1e-12)).astype(np.float32)
                rows = reached[part]
                change[rows] += _through(around, standing, number, sent, at.of(rows), (axis, cosine), count, seed)
                advance(len(part))
    before = _direct_where(around, standing, at)
    if len(before):
        places = at.of(before)
        change[before] += _direct(around, Together(around.occluder, places, standing.caster), places)
        change[before] -= _direct(around, Together(around.occluder, places), places)
    return change


def within(around: Surroundings, standing: Standing, at: Receiving, least: float) -> Indices:
    """Rows of the places in the boxes that hold what objects may change by `in_reach`; all where suns or lamps throw
    shadows, which reach farther."""
    if len(around.suns) or around.lamps is not None:
        return np.arange(len(at.origins))
    found = np.zeros(len(at.origins), bool)
    for middle, radius in standing.spheres:
        reach = BOX * radius / np.sqrt(least)
        low, high = ((middle + side * reach).astype(np.float32) for side in (-1.0, 1.0))
        inside = (at.origins[:, 0] > low[0]) & (at.origins[:, 0] < high[0])
        for axis in (1, 2):
            inside &= (at.origins[:, axis] > low[axis]) & (at.origins[:, axis] < high[axis])
        found |= inside
    return np.flatnonzero(found)


def in_reach(middle: NDArray[np.float64], radius: float, at: Receiving, least: float = LEAST_CONE) -> Mask:
    """Which places (M,) the sphere of an object may change other light of than that of suns and lamps: those before
    which it is large enough."""
    toward = middle - at.origins
    height = np.einsum("ij,ij->i", at.normals, toward)
    return np.asarray((radius**2 > least * (toward**2).sum(axis=1)) & (height > -radius))


def _through(
    around: Surroundings,
    standing: Standing,
    number: int,
    sent: NDArray[np.float32],
    at: Receiving,
    cone: tuple[NDArray[np.float32], NDArray[np.float32]],
    count: int,
    seed: int,
) -> NDArray[np.float32]:
    """What one object changes at M places by the rays that go towards it, (M, 3). cone: its axes and cosines."""
    size = len(at.origins)
    rays, weights = np.zeros((size, count, 6), np.float32), np.zeros((size, count), np.float32)
    offsets = hashed_offsets(at.origins, at.normals, seed)
    in_slices(_aim, size, at.origins, at.normals, *cone, fibonacci_azimuths(count), offsets, rays, weights)
    live = np.flatnonzero(weights.ravel() > 0.0)
    flat = rays.reshape(-1, 6)[live]
    own = standing.caster.first_hits(flat)
    met = own.faces >= 0
    met[met] = standing.owner[own.faces[met]] == number
    live, flat = live[met], flat[met]
    behind = around.occluder.first_hits(flat)
    first = own.distance[met] < behind.distance
    live, flat = live[first], flat[first]
    before = around.seen(_of(behind, first), flat[:, 3:])
    corners = standing.faces[own.faces[met][first]]
    after = np.einsum("nk,nkc->nc", weights_of(own.uv[met][first]), sent[corners])
    change = weights.ravel()[live, None] * (after - before)
    return np.stack([np.bincount(live // count, change[:, c], size) for c in range(3)], axis=1).astype(np.float32)


def _of(hits: Hits, rows: Mask) -> Hits:
    return Hits(hits.distance[rows], hits.faces[rows], hits.uv[rows], hits.normals[rows])


def _direct_where(around: Surroundings, standing: Standing, at: Receiving) -> Indices:
    """Rows of the places that may lie in the shadow which objects throw of suns and lamps."""
    origins = at.origins.astype(np.float64)
    found = np.zeros(len(origins), bool)
    for middle, radius in standing.spheres:
        toward = middle - origins
        for direction in around.suns.directions:
            along = toward @ direction
            apart = np.linalg.norm(toward - along[:, None] * direction, axis=1)
            found |= (along > -radius) & (apart < radius)
        if around.lamps is not None:
            for lamp in np.unique(around.lamps.lamp):
                found |= _behind(around, lamp, origins, middle, radius)
    return np.flatnonzero(found)


def _behind(
    around: Surroundings, lamp: int, origins: NDArray[np.float64], middle: NDArray[np.float64], radius: float
) -> NDArray[np.bool_]:
    """Which places (N, 3) a ball may hide a lamp from: those whose way to the lamp's sphere leads past it."""
    assert around.lamps is not None
    of_lamp = around.lamps.lamp == lamp
    places, reach = around.lamps.middle[of_lamp].astype(np.float64), around.lamps.reach[of_lamp]
    center = 0.5 * (places.min(axis=0) + places.max(axis=0))
    size = float((np.linalg.norm(places - center, axis=1) + reach).max())
    way = center - origins
    square = np.maximum(np.einsum("ij,ij->i", way, way), 1e-12)
    along = np.clip(np.einsum("ij,ij->i", middle - origins, way) / square, 0.0, 1.0)
    apart = np.linalg.norm(origins + along[:, None] * way - middle, axis=1)
    return apart < radius + along * size


def _direct(around: Surroundings, occluder: Together, at: Receiving) -> NDArray[np.float32]:
    """Light of suns and lamps at the places that an occluder has for its vertices, (M, 3)."""
    found = np.zeros((len(at.origins), 3), np.float32)
    if len(around.suns):
        found += sunlight(occluder, slice(None), around.suns)
    if around.lamps is not None:
        found += lamplight(occluder, around.lamps, LAMP_RAYS)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
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
    """Directions even over a cone about an axis, and what each counts of the irradiance over pi: its solid angle times
    cosine over pi; below -1 the cone is the cosine lobe itself, in which all count alike."""
    count, one = len(azimuths), np.float32(1)
    for v in range(begin, end):
        lobe = cosines[v] < -one
        nx, ny, nz = normals[v]
        ax, ay, az = axes[v]
        if lobe:
            ax, ay, az = nx, ny, nz
        shift, turn = offsets[v, 0], np.float32(2.0 * np.pi) * offsets[v, 1]
        cos_turn, sin_turn = np.cos(turn), np.sin(turn)
        # Tangents without a branch: Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
        sign = np.copysign(one, az)
        a = -one / (sign + az)
        b = ax * ay * a
        tx, ty, tz = one + sign * ax * ax * a, sign * b, -sign * ax
        bx, by, bz = b, sign + ay * ay * a, -ay
        solid = np.float32(2.0 * np.pi) * (one - cosines[v]) / np.float32(count)
        for i in range(count):
            part = (np.float32(i) + shift) / np.float32(count)
            height = np.sqrt(max(one - part, np.float32(0))) if lobe else one - part * (one - cosines[v])
            radius = np.sqrt(max(one - height * height, np.float32(0)))
            u = radius * (cos_turn * azimuths[i, 0] - sin_turn * azimuths[i, 1])
            w = radius * (sin_turn * azimuths[i, 0] + cos_turn * azimuths[i, 1])
            dx, dy, dz = u * tx + w * bx + height * ax, u * ty + w * by + height * ay, u * tz + w * bz + height * az
            rays[v, i, 0], rays[v, i, 1], rays[v, i, 2] = origins[v]
            rays[v, i, 3], rays[v, i, 4], rays[v, i, 5] = dx, dy, dz
            if lobe:
                weights[v, i] = one / np.float32(count)
            else:
                cosine = max(nx * dx + ny * dy + nz * dz, np.float32(0)) * np.float32(1.0 / np.pi)
                weights[v, i] = solid * cosine
