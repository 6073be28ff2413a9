"""Albedos of places: linear RGB as a function of position, at any resolution.

Every maker returns a paint: a callable from points (N, 3), scene frame in metres, and unit normals (N, 3) to linear
albedo (N, 3) in [0, 1]. It draws nothing at random when called: the same point always has the same colour, on a
vertex, on a splat and in a picture.
"""

from functools import cache

import numpy as np

LATTICE = 64
"""Cells after which the noise repeats along each axis: a power of two."""

UNLIT, WHITEST = 0.015, 0.85
"""Range of the albedos: wet black to fresh plaster."""


def hashed(*whole, seed=0):
    """A number in [0, 1) for each tuple of whole numbers: arrays of one shape -> float64 of that shape.

    Source: the finaliser of MurmurHash3 (Appleby), once for each coordinate.
    """
    state = np.full(np.shape(whole[0]), seed * 0x9E3779B9 + 0x7F4A7C15, np.uint64) & np.uint64(0xFFFFFFFF)
    for number in whole:
        state = state ^ (np.asarray(number).astype(np.int64).astype(np.uint64) & np.uint64(0xFFFFFFFF))
        for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
            state = (state ^ (state >> np.uint64(shift))) * np.uint64(factor) & np.uint64(0xFFFFFFFF)
        state ^= state >> np.uint64(16)
    return state / 2.0**32


@cache
def _lattice():
    """The values at the corners of the noise's cells: (LATTICE^3,) float32 in [0, 1)."""
    return np.random.default_rng(0).random(LATTICE**3, np.float32)


def noise(points, wavelength, seed=0, octaves=3):
    """Smooth noise about 0, within 1: (N, 3) -> (N, 1). wavelength: of its coarsest octave, one or three lengths.

    Value noise on a lattice (Perlin 1985; Ebert et al., "Texturing and Modeling", chapter 2).
    """
    table, last = _lattice(), LATTICE - 1
    total = np.zeros(len(points), np.float32)
    for octave in range(octaves):
        places = points * (2.0**octave / np.asarray(wavelength)) + 1e3 * hashed(np.arange(3), seed=seed + octave)
        cell = np.floor(places)
        share = (places - cell).astype(np.float32)
        x, y, z = (share * share * (3 - 2 * share)).T
        i, j, k = cell.astype(np.int64).T & last
        near, far = i * LATTICE * LATTICE, ((i + 1) & last) * LATTICE * LATTICE
        along_z = []
        for layer in (k, (k + 1) & last):
            rows = [row + layer for row in (j * LATTICE, ((j + 1) & last) * LATTICE)]
            low, high = ((1 - x) * table[near + row] + x * table[far + row] for row in rows)
            along_z.append((1 - y) * low + y * high)
        total += np.float32(0.5**octave) * (2 * ((1 - z) * along_z[0] + z * along_z[1]) - 1)
    return (total / (2.0 - 0.5 ** (octaves - 1)))[:, None]


def plain(color, amount=0.2, wavelength=0.3, seed=0):
    """One colour whose brightness wanders by `amount`."""
    return lambda points, _: bounded(np.asarray(color) * np.exp(amount * noise(points, wavelength, seed)))


def foliage(color, leaf, seed=0):
    """Leaves without shape: bright and dark spots as large as one. leaf: its length in metres."""

    def paint(points, _):
        spots = noise(points, leaf, seed, 2)
        return bounded(np.asarray(color) * np.exp(1.5 * spots - 0.35 + 0.5 * noise(points, 5 * leaf, seed + 3)))

    return paint


def lawn(seed=0):
    """Soil and short grass in patches, greener and yellower over some metres."""
    green, yellow, soil = np.array([[0.085, 0.165, 0.032], [0.19, 0.205, 0.06], [0.13, 0.10, 0.06]])

    def paint(points, _):
        dry = np.clip(0.45 + 1.3 * noise(points, 5.0, seed), 0, 1) ** 1.5
        bare = np.clip(2.2 * noise(points, 0.9, seed + 9) - 0.9, 0, 1)
        base = mixed(mixed(green, yellow, 0.75 * dry), soil, bare)
        return bounded(base * np.exp(0.3 * noise(points, 0.16, seed + 17)))

    return paint


def flagstones(length=0.72, width=0.54, joint=0.024, seed=0):
    """Courses of sandstone slabs of unlike lengths, with dark joints, in the plane x, z."""
    palette = np.array([[0.42, 0.35, 0.26], [0.36, 0.33, 0.29], [0.47, 0.38, 0.27], [0.33, 0.28, 0.23]])

    def paint(points, _):
        row, across = np.divmod(points[:, 2] + 100.0 * width, width)
        stretch = length * (0.75 + 0.5 * hashed(row, seed=seed))
        column, along = np.divmod(points[:, 0] + stretch * hashed(row, seed=seed + 1) + 100.0 * length, stretch)
        tone = hashed(row, column, seed=seed + 2)
        stone = palette[(hashed(row, column, seed=seed + 3) * len(palette)).astype(int)]
        stone = stone * np.exp(0.35 * (tone - 0.5))[:, None] * np.exp(0.28 * noise(points, 0.25, seed + 4, 4))
        rim = np.minimum(np.minimum(across, width - across), np.minimum(along, stretch - along))
        rim = rim + 0.006 * noise(points, 0.08, seed + 5)[:, 0]
        moss = np.array([0.075, 0.08, 0.045]) * np.exp(0.4 * noise(points, 0.1, seed + 6))
        return bounded(mixed(moss, stone, smoothstep(joint * 0.5, joint * 1.1, rim)))

    return paint


def bricks(length=0.3, height=0.1, joint=0.015, seed=0):
    """Brick courses in running bond on upright walls, with light mortar."""
    palette = np.array([[0.36, 0.135, 0.075], [0.42, 0.18, 0.10], [0.30, 0.11, 0.07], [0.45, 0.22, 0.13]])

    def paint(points, normals):
        along = np.where(np.abs(normals[:, 0]) > np.abs(normals[:, 2]), points[:, 2], points[:, 0])
        course, rise = np.divmod(points[:, 1] + 50.0 * height, height)
        column, run = np.divmod(along + 0.5 * length * (course % 2) + 100.0 * length, length)
        clay = palette[(hashed(course, column, seed=seed) * len(palette)).astype(int)]
        clay = clay * np.exp(0.5 * (hashed(course, column, seed=seed + 1) - 0.5))[:, None]
        clay = clay * np.exp(0.25 * noise(points, 0.05, seed + 2) + 0.2 * noise(points, 1.4, seed + 3))
        rim = np.minimum(np.minimum(rise, height - rise), np.minimum(run, length - run))
        mortar = np.array([0.44, 0.41, 0.36]) * np.exp(0.2 * noise(points, 0.2, seed + 4))
        return bounded(mixed(mortar, clay, smoothstep(joint * 0.4, joint * 0.8, rim)))

    return paint


def planks(color, along=(1.0, 0.0, 0.0), across=(0.0, 0.0, 1.0), width=0.12, length=1.6, seed=0, gap=0.003):
    """Boards with grain along them, each of its own tone, and dark gaps between. along, across: unit (3,)."""
    along, across = np.asarray(along), np.asarray(across)

    def paint(points, _):
        board, over = np.divmod(points @ across + 100.0 * width, width)
        run = points @ along + length * hashed(board, seed=seed) + 50.0 * length
        piece, on = np.divmod(run, length)
        tone = np.exp(0.55 * (hashed(board, piece, seed=seed + 1) - 0.5))[:, None]
        shift = np.stack([board * 7.3, piece * 3.1, 0 * board], axis=1)
        local = np.stack([run / 14.0, points @ across, points @ np.cross(along, across)], axis=1) + shift
        grain = np.exp(0.38 * noise(local, 0.035, seed + 2, 2) + 0.12 * noise(local, 0.12, seed + 3))
        edge = np.minimum(np.minimum(over, width - over), np.minimum(on, length - on))
        return bounded(np.asarray(color) * tone * grain * (0.25 + 0.75 * smoothstep(0.0, gap, edge)[:, None]))

    return paint


def roof_tiles(color=(0.40, 0.17, 0.09), width=0.2, course=0.28, seed=0):
    """Rows of clay tiles down a slope that falls along z."""

    def paint(points, _):
        row, down = np.divmod(points[:, 2] + 100.0 * course, course)
        column, over = np.divmod(points[:, 0] + 0.5 * width * (row % 2) + 100.0 * width, width)
        tone = np.exp(0.6 * (hashed(row, column, seed=seed) - 0.5) + 0.3 * noise(points, 0.9, seed + 1)[:, 0])
        shade = 0.45 + 0.55 * np.minimum(
            smoothstep(0.0, 0.05, down), smoothstep(0.0, 0.02, np.minimum(over, width - over))
        )
        return bounded(np.asarray(color) * (tone * shade)[:, None])

    return paint


def wallpaper(ground, print_color, period=0.34, seed=0):
    """A damask: ogee ornaments in two tones of a colour, on upright walls."""

    def paint(points, normals):
        along = np.where(np.abs(normals[:, 0]) > np.abs(normals[:, 2]), points[:, 2], points[:, 0])
        u, v = 2 * np.pi * along / period, np.pi * points[:, 1] / period
        ogee = np.cos(u) * np.cos(v) + 0.35 * np.cos(2 * u) * np.cos(2 * v) + 0.25 * np.cos(3 * v) * np.cos(u)
        ink = smoothstep(0.28, 0.40, np.abs(ogee)) * (1.0 - 0.8 * smoothstep(0.85, 0.95, np.abs(ogee)))
        return bounded(mixed(ground, print_color, ink) * np.exp(0.08 * noise(points, 0.5, seed)))

    return paint


def rug(center, half_size, colors, seed=0):
    """A woven rug: borders, and lozenges within. center: (x, z). half_size: (x, z). colors: four."""
    colors, half = np.asarray(colors), np.asarray(half_size)

    def paint(points, _):
        place = points[:, [0, 2]] - center
        inset = (half - np.abs(place)).min(axis=1)
        lozenge = np.abs(((place / 0.62 + 0.5) % 1.0) - 0.5).sum(axis=1)
        color = np.where((lozenge < 0.18)[:, None], colors[1], colors[0])
        color = np.where(((lozenge > 0.36) & (lozenge < 0.46))[:, None], colors[2], color)
        teeth = 0.16 + 0.02 * np.sign(np.sin(place.sum(axis=1) * 60.0))
        for low, high, of in ((0.0, 0.05, colors[3]), (0.05, 0.07, colors[2]), (0.07, teeth, colors[1])):
            color = np.where(((inset >= low) & (inset < high))[:, None], of, color)
        return bounded(color * np.exp(0.3 * noise(points, 0.02, seed, 2) + 0.12 * noise(points, 0.4, seed + 2)))

    return paint


def landscape(corner, right, up, seed=0):
    """A painted landscape: sky, hills, a field. corner (3,); right, up: (3,) full width and height of the canvas."""
    right, up = np.asarray(right, float), np.asarray(up, float)
    sky, glow, hill, field = np.array([[0.16, 0.32, 0.55], [0.75, 0.48, 0.25], [0.06, 0.12, 0.13], [0.42, 0.33, 0.07]])

    def paint(points, _):
        at = points - corner
        u, v = at @ right / (right @ right), at @ up / (up @ up)
        line = np.stack([3.0 * u + 11.0 * seed, 0 * u, 0 * u], axis=1)
        color = mixed(glow, sky, np.clip((v - 0.45) / 0.5, 0, 1))
        cloud = noise(np.stack([2.0 * u, 7.0 * v, 0 * u + seed], axis=1), 0.8, seed + 5)[:, 0]
        color = mixed(color, [0.8, 0.74, 0.68], smoothstep(0.1, 0.5, cloud) * (v > 0.5))
        for level, tone, number in ((0.52, 1.9, 1), (0.4, 1.0, 2)):
            ridge = level + 0.14 * noise(line + number, 0.7, seed + number)[:, 0]
            color = np.where((v < ridge)[:, None], hill * tone, color)
        rows = np.exp(0.4 * np.sin(60.0 * (u - 0.5) / np.maximum(0.45 - v, 0.06)))[:, None]
        color = np.where((v < 0.24 + 0.05 * u)[:, None], field * rows, color)
        return bounded(color * np.exp(0.35 * noise(points, 0.03, seed + 8, 2)))

    return paint


def rings(palette, period, axis=1, seed=0):
    """Bands of glaze around a pot: colours in turn along one axis, hand-drawn. palette: (C, 3)."""
    palette = np.asarray(palette)

    def paint(points, _):
        band = np.floor(points[:, axis] / period + 0.12 * noise(points, 0.15, seed)[:, 0]).astype(int) % len(palette)
        return bounded(palette[band] * np.exp(0.15 * noise(points, 0.06, seed + 1)))

    return paint


def mixed(first, second, share):
    """`first` where share is 0, `second` where it is 1. share: (N,) or (N, 1)."""
    share = np.asarray(share)
    share = share[:, None] if share.ndim == 1 else share
    return np.asarray(first) * (1.0 - share) + np.asarray(second) * share


def smoothstep(low, high, value):
    """0 below `low`, 1 above `high`, smooth between (Ken Perlin's smoothstep)."""
    share = np.clip((value - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def bounded(color):
    """Colours within the range of the albedos."""
    return np.clip(color, UNLIT, WHITEST)
