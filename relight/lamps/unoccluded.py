"""The unoccluded light of one emitter on a white vertex, in closed form, and the targets of its shadow rays.

All is exit radiance of a white surface, irradiance over pi, for an emitter of radiance 1.
Sources: a sphere, cut by the horizon or not: Snyder, "Area light sources for real-time graphics", 1996. A polygon:
Lambert's formula, after clipping at the horizon (Arvo, "Analytic methods for simulated light transport", 1995). A tube
has none: its light is that of the points which shadow rays aim at.
"""

import math

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.base.sphere import GOLDEN_TURN

from ..transfer.occluder import MAX_OFFSET
from .emitters import BALL, TRIANGLE, Emitters

INSIDE = np.float32(1.0)
"""The light of a vertex inside a glowing ball: from all its hemisphere."""

TUBE_POINTS = 64
"""Points of a tube that its unoccluded light is summed over: within .2% where it is ten radii away, 4% of what is left
of it where it is nearly below the horizon or seen end on."""

STAND_OFF = MAX_OFFSET
"""Part of the scene's diagonal by which shadow rays end before a panel or tube, as they begin off the surface: what a
lamp is mounted on does not hide it."""


@kernel
def ball(cosine: float, square: float, radius_square: float) -> float:
    """A ball at a squared distance, whose centre is seen at an angle of this cosine to the normal."""
    if square <= radius_square:
        return 1.0
    sin_square = radius_square / square
    if cosine * cosine > sin_square:
        return cosine * sin_square if cosine > 0.0 else 0.0
    sine = math.sqrt(max(1.0 - cosine * cosine, 1e-12))
    x = math.sqrt(max(1.0 / sin_square - 1.0, 1e-12))
    y = min(1.0, max(-1.0, -x * cosine / sine))
    across = sine * math.sqrt(max(1.0 - y * y, 0.0))
    found = (cosine * math.acos(y) - x * across) * sin_square + math.atan(across / x)
    return max(found / math.pi, 0.0)


@kernel
def triangle(
    px: float, py: float, pz: float, nx: float, ny: float, nz: float, place: NDArray, first: NDArray, second: NDArray
) -> float:
    """A triangle that shines to both sides, as a vertex sees it above its horizon."""
    corner = np.empty((3, 3))
    height = np.empty(3)
    corner[0, 0], corner[0, 1], corner[0, 2] = place[0] - px, place[1] - py, place[2] - pz
    for axis in range(3):
        corner[1, axis] = corner[0, axis] + first[axis]
        corner[2, axis] = corner[0, axis] + second[axis]
    for i in range(3):
        height[i] = corner[i, 0] * nx + corner[i, 1] * ny + corner[i, 2] * nz
    kept = np.empty((4, 3))
    count = 0
    for i in range(3):
        j = (i + 1) % 3
        if height[i] >= 0.0:
            kept[count] = corner[i]
            count += 1
        if (height[i] >= 0.0) != (height[j] >= 0.0):
            part = height[i] / (height[i] - height[j])
            for axis in range(3):
                kept[count, axis] = corner[i, axis] + part * (corner[j, axis] - corner[i, axis])
            count += 1
    if count < 3:
        return 0.0
    total = 0.0
    for i in range(count):
        j = (i + 1) % count
        ax, ay, az = kept[i]
        bx, by, bz = kept[j]
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        length = math.sqrt(cx * cx + cy * cy + cz * cz)
        if length > 0.0:
            angle = math.atan2(length, ax * bx + ay * by + az * bz)
            total += angle * (cx * nx + cy * ny + cz * nz) / length
    return min(abs(total) / (2.0 * math.pi), 1.0)


@kernel
def tube_view(
    px: float, py: float, pz: float, place: NDArray, first: NDArray
) -> tuple[
    tuple[float, float, float],
    tuple[float, float, float],
    tuple[float, float, float],
    float,
    float,
    float,
]:
    """Of a tube as a point sees it: the unit directions along its axis, towards that and aside; where along it the
    point is nearest, how long it is, and how far off its axis is."""
    length = math.sqrt(first[0] ** 2 + first[1] ** 2 + first[2] ** 2)
    ax, ay, az = first[0] / length, first[1] / length, first[2] / length
    wx, wy, wz = px - place[0], py - place[1], pz - place[2]
    near = wx * ax + wy * ay + wz * az
    tx, ty, tz = near * ax - wx, near * ay - wy, near * az - wz
    distance = max(math.sqrt(tx * tx + ty * ty + tz * tz), 1e-12)
    tx, ty, tz = tx / distance, ty / distance, tz / distance
    aside = (ay * tz - az * ty, az * tx - ax * tz, ax * ty - ay * tx)
    return (ax, ay, az), (tx, ty, tz), aside, near, length, distance


@kernel
def directed(emitters: Emitters, e: int, dx: float, dy: float, dz: float, length: float) -> float:
    """The intensity of a ball towards a vertex, as a part of that along its axis; (dx, dy, dz) leads from the vertex to
    it."""
    if emitters.profile[e] < 0 and emitters.cone[e, 0] >= np.float32(math.pi):
        return 1.0
    ax, ay, az = emitters.first[e]
    cosine = min(1.0, max(-1.0, -(dx * ax + dy * ay + dz * az) / max(length, 1e-12)))
    angle = math.acos(cosine)
    row = emitters.profile[e]
    if row < 0:
        beam, cutoff = emitters.cone[e, 0], emitters.cone[e, 1]
        if angle <= beam:
            return 1.0
        return (cutoff - angle) / (cutoff - beam) if angle < cutoff else 0.0
    hx, hy, hz = emitters.second[e]
    bx, by, bz = ay * hz - az * hy, az * hx - ax * hz, ax * hy - ay * hx
    turn = math.atan2(-(dx * bx + dy * by + dz * bz), -(dx * hx + dy * hy + dz * hz))
    rows, columns = emitters.profiles.shape[1], emitters.profiles.shape[2]
    v = angle / math.pi * (rows - 1)
    h = (turn / (2.0 * math.pi)) % 1.0 * (columns - 1)
    i, j = min(int(v), rows - 2), min(int(h), columns - 2)
    v -= i
    h -= j
    table = emitters.profiles[row]
    upper = table[i, j] * (1.0 - h) + table[i, j + 1] * h
    lower = table[i + 1, j] * (1.0 - h) + table[i + 1, j + 1] * h
    return upper * (1.0 - v) + lower * v


@kernel
def _before(emitters: Emitters, e: int, px: float, py: float, pz: float) -> bool:
    """Whether a point is on the side that a triangle shines to."""
    ux, uy, uz = emitters.first[e]
    vx, vy, vz = emitters.second[e]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    x, y, z = emitters.place[e]
    return (px - x) * nx + (py - y) * ny + (pz - z) * nz > 0.0


@kernel
def aimed(
    emitters: Emitters,
    e: int,
    px: float,
    py: float,
    pz: float,
    nx: float,
    ny: float,
    nz: float,
    leaf: float,
    sample: int,
    samples: int,
    shift: float,
    turn: float,
) -> tuple[float, float, float, float]:
    """Ray number `sample` of `samples` to an emitter: the way to the point that it aims at, and its weight.

    The weight is the unoccluded light of the point, so that the weights of all samples sum to the whole.
    leaf: 0 for a surface, 1 for a volume that takes light equally from all sides, where a quarter replaces the cosine.
    shift, turn in [0, 1): of the vertex.
    """
    u = ((sample + shift) / samples) % 1.0
    v = (sample * GOLDEN_TURN + turn) % 1.0
    kind = emitters.kind[e]
    x, y, z = emitters.place[e, 0] - px, emitters.place[e, 1] - py, emitters.place[e, 2] - pz
    if kind == BALL:
        square = x * x + y * y + z * z
        radius_square = np.float64(emitters.radius[e]) ** 2
        if square <= radius_square:
            return 0.0, 0.0, 0.0, (1.0 - leaf + leaf * 0.25) / samples
        length = math.sqrt(square)
        x, y, z = x / length, y / length, z / length
        sin_square = radius_square / square
        least = math.sqrt(1.0 - sin_square)
        lean = u * sin_square / (1.0 + least)  # 1 - cosine, which at small angles keeps its digits
        sine = math.sqrt(lean * (2.0 - lean))
        sign = math.copysign(1.0, z)
        a = -1.0 / (sign + z)
        b = x * y * a
        c, s = sine * math.cos(2.0 * math.pi * v), sine * math.sin(2.0 * math.pi * v)
        dx = c * (1.0 + sign * x * x * a) + s * b + (1.0 - lean) * x
        dy = c * sign * b + s * (sign + y * y * a) + (1.0 - lean) * y
        dz = -c * sign * x - s * y + (1.0 - lean) * z
        reach = length * (1.0 - lean) - math.sqrt(max(radius_square - square * sine * sine, 0.0))
        cosine = max(dx * nx + dy * ny + dz * nz, 0.0)
        share = 2.0 * sin_square / (1.0 + least) / samples
        weight = share * ((1.0 - leaf) * cosine + leaf * 0.25)
        return dx * reach, dy * reach, dz * reach, weight
    if kind == TRIANGLE:
        root = math.sqrt(u)
        f, g = root * (1.0 - v), root * v
        ux, uy, uz = emitters.first[e]
        wx, wy, wz = emitters.second[e]
        x, y, z = x + f * ux + g * wx, y + f * uy + g * wy, z + f * uz + g * wz
        square = max(x * x + y * y + z * z, 1e-14)
        mx, my, mz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx  # twice the area
        length = math.sqrt(square)
        facing = -(x * mx + y * my + z * mz) / length
        facing = abs(facing) if emitters.two_sided[e] else max(facing, 0.0)
        cosine = max((x * nx + y * ny + z * nz) / length, 0.0)
        weight = ((1.0 - leaf) * cosine + leaf * 0.25) * 0.5 * facing / (square * math.pi) / samples
        area = math.sqrt(mx * mx + my * my + mz * mz)
        height = -(x * mx + y * my + z * mz) / area
        off = math.copysign(min(STAND_OFF, 0.5 * abs(height)), height) / area
        return x + off * mx, y + off * my, z + off * mz, min(weight, 1.0)
    along, toward, aside, near, length, distance = tube_view(px, py, pz, emitters.place[e], emitters.first[e])
    radius = np.float64(emitters.radius[e])
    if distance <= radius:
        return 0.0, 0.0, 0.0, (1.0 - leaf + leaf * 0.25) / samples if 0.0 < near < length else 0.0
    # Across, on the side that faces the vertex; then along the strip that is seen there.
    most = math.asin(radius / distance)
    angle = most * (2.0 * v - 1.0)
    c, s = math.cos(angle), math.sin(angle)
    depth = max(distance * c - math.sqrt(max(radius * radius - (distance * s) ** 2, 0.0)), 1e-12)
    start = math.atan(-near / depth)
    span = math.atan((length - near) / depth) - start
    rise = math.tan(start + span * u)
    x = c * toward[0] + s * aside[0] + rise * along[0]
    y = c * toward[1] + s * aside[1] + rise * along[1]
    z = c * toward[2] + s * aside[2] + rise * along[2]
    flat = 1.0 / math.sqrt(1.0 + rise * rise)
    cosine = max((x * nx + y * ny + z * nz) * flat, 0.0)
    weight = ((1.0 - leaf) * cosine + leaf * 0.25) * flat * 2.0 * most * span / math.pi / samples
    depth -= min(STAND_OFF, 0.5 * depth)
    return x * depth, y * depth, z * depth, weight


@kernel
def unoccluded(emitters: Emitters, e: int, px: float, py: float, pz: float, nx: float, ny: float, nz: float) -> float:
    """The unoccluded light of emitter e at a vertex, for radiance 1."""
    kind = emitters.kind[e]
    if kind == BALL:
        dx, dy, dz = emitters.place[e, 0] - px, emitters.place[e, 1] - py, emitters.place[e, 2] - pz
        square = dx * dx + dy * dy + dz * dz
        length = math.sqrt(square)
        cosine = (dx * nx + dy * ny + dz * nz) / max(length, 1e-12)
        found = ball(cosine, square, np.float64(emitters.radius[e]) ** 2)
        return found * directed(emitters, e, dx, dy, dz, length) if found > 0.0 else 0.0
    if kind == TRIANGLE:
        if not emitters.two_sided[e] and not _before(emitters, e, px, py, pz):
            return 0.0
        return triangle(px, py, pz, nx, ny, nz, emitters.place[e], emitters.first[e], emitters.second[e])
    found = 0.0
    for sample in range(TUBE_POINTS):
        found += aimed(emitters, e, px, py, pz, nx, ny, nz, 0.0, sample, TUBE_POINTS, 0.5, 0.0)[3]
    return found
