"""Paints of walls and pavements: plaster, courses of stone or brick, gravel, asphalt; and how they are joined.

Every maker returns a paint, as those of `textures` do.
"""

import numpy as np

from .textures import bounded, hashed, mixed, noise, smoothstep

PLASTERS = np.array(
    [
        (0.58, 0.38, 0.14),
        (0.53, 0.27, 0.20),
        (0.72, 0.69, 0.62),
        (0.28, 0.37, 0.46),
        (0.29, 0.36, 0.23),
        (0.43, 0.16, 0.08),
        (0.35, 0.34, 0.32),
        (0.66, 0.55, 0.25),
        (0.075, 0.12, 0.23),
        (0.20, 0.055, 0.045),
        (0.10, 0.10, 0.105),
        (0.64, 0.58, 0.47),
    ]
)
"""Lime washes of European towns, linear: ochre, rose, white, blue, sage, red, grey, lemon, indigo, oxblood, slate,
cream."""

STONES = np.array(
    [(0.075, 0.075, 0.08), (0.26, 0.25, 0.24), (0.52, 0.48, 0.40), (0.40, 0.29, 0.17), (0.30, 0.13, 0.08)]
)
"""Basalt, granite, limestone, sandstone, clay."""

RENDER = np.array([0.30, 0.26, 0.21])
"""What shows where plaster has come off."""


def shades(color, count, spread, seed=0):
    """A palette (count, 3) about one colour: brightness varies by `spread` (of the log), hue by a third of that."""
    rng = np.random.default_rng(seed)
    return np.asarray(color) * np.exp(spread * (rng.normal(size=(count, 1)) + rng.normal(size=(count, 3)) / 3))


def plaster(color, wear=0.3, seed=0):
    """Lime wash: clouds, streaks of rain, and bare render in spots. wear: 0 fresh and even, 1 old and patchy."""

    def paint(points, _):
        clouds = 0.7 * noise(points, 1.9, seed) + 0.35 * noise(points, 0.3, seed + 1)
        streaks = np.clip(noise(points, (0.3, 3.5, 0.3), seed + 2), 0, 1)
        wash = np.asarray(color) * np.exp(wear * (clouds - 0.8 * streaks))
        bare = smoothstep(0.62 - 0.37 * wear, 0.68 - 0.37 * wear, noise(points, 1.2, seed + 3, 4)[:, 0])
        return bounded(mixed(wash, RENDER * np.exp(0.3 * noise(points, 0.1, seed + 4)), bare * min(2 * wear, 1.0)))

    return paint


def coursed(palette, length, height, joint, mortar, seed=0):
    """Courses of blocks, shifted by random, on upright walls or, where a surface looks up, in the plane x, z.

    palette: (C, 3). length, height, joint: of a block and the gap between, in metres. mortar: colour of the joints.
    """
    palette = np.asarray(palette)

    def paint(points, normals):
        flat, along_z = np.abs(normals[:, 1]) > 0.7, np.abs(normals[:, 0]) > np.abs(normals[:, 2])
        rise = np.where(flat, points[:, 2], points[:, 1])
        run = np.where(~flat & along_z, points[:, 2], points[:, 0])
        course, over = np.divmod(rise + 200.0 * height, height)
        block, on = np.divmod(run + length * hashed(course, seed=seed) + 200.0 * length, length)
        stone = palette[(hashed(course, block, seed=seed + 1) * len(palette)).astype(int)]
        stone = stone * np.exp(0.22 * noise(points, 0.3 * length, seed + 2) + 0.2 * noise(points, 2.3, seed + 3))
        rim = np.minimum(np.minimum(over, height - over), np.minimum(on, length - on))
        rim = rim + 0.3 * joint * noise(points, 6 * joint, seed + 4)[:, 0]
        return bounded(mixed(mortar, stone, smoothstep(0.4 * joint, 0.9 * joint, rim)))

    return paint


def gravel(color, spread=0.4, size=0.035, seed=0):
    """Pebbles that differ in brightness by `spread`, trodden lighter in paths. size: of a pebble in metres."""

    def paint(points, _):
        cell = np.floor((points + 0.4 * size * noise(points, 2 * size, seed, 1)) / size)
        tone = spread * (2 * hashed(cell[:, 0], cell[:, 2], seed=seed + 1)[:, None] - 1)
        return bounded(np.asarray(color) * np.exp(tone + 0.5 * spread * noise(points, 1.7, seed + 2)))

    return paint


def asphalt(color, line_z=None, seed=0):
    """Asphalt with mended patches, and a broken white line along x at `line_z`."""

    def paint(points, _):
        mended = smoothstep(0.3, 0.32, noise(points, 2.6, seed, 1)[:, 0])
        base = np.asarray(color) * np.exp(0.25 * noise(points, 0.04, seed + 1, 2) + 0.25 * noise(points, 1.5, seed + 2))
        base = base * (1 - 0.35 * mended)[:, None]
        if line_z is None:
            return bounded(base)
        line = (np.abs(points[:, 2] - line_z) < 0.07) & (points[:, 0] % 3.0 < 1.8)
        return bounded(mixed(base, [0.62, 0.61, 0.57], 0.85 * line))

    return paint


def banded(lower, upper, height):
    """One paint below a height in metres and another above it."""

    def paint(points, normals):
        below = points[:, 1] < height
        return np.where(below[:, None], lower(points, normals), upper(points, normals))

    return paint


def wall_paint(rng):
    """Plaster, brick or ashlar at random, over a dado of another in one of two: a paint."""
    seed, kind = int(rng.integers(1000)), rng.choice(3, p=(0.6, 0.2, 0.2))
    stone, spread = STONES[rng.integers(len(STONES))], rng.uniform(0.05, 0.4)
    if kind == 0:
        paint = plaster(plaster_color(rng), rng.uniform(0.05, 1.0), seed)
    elif kind == 1:
        clay = np.array([(0.36, 0.13, 0.075), (0.50, 0.36, 0.20), (0.22, 0.09, 0.065)])[rng.integers(3)]
        paint = coursed(shades(clay, 6, spread, seed), 0.24, 0.075, 0.012, (0.42, 0.39, 0.34), seed)
    else:
        paint = coursed(shades(stone, 6, spread, seed), rng.uniform(0.45, 0.8), 0.3, 0.014, 0.6 * stone, seed)
    if rng.random() < 0.5:
        return paint
    dado = STONES[rng.integers(len(STONES) - 1)]
    return banded(coursed(shades(dado, 5, 0.12, seed), 0.6, 0.35, 0.012, 0.6 * dado, seed + 9), paint, 0.7)


def plaster_color(rng):
    """One of the lime washes, a little off."""
    return np.clip(PLASTERS[rng.integers(len(PLASTERS))] * np.exp(0.12 * rng.normal(size=3)), 0.04, 0.78)


def paving(rng):
    """Flags, setts, gravel or bricks at random: a paint of the ground."""
    seed, spread = int(rng.integers(1000)), rng.uniform(0.05, 0.45)
    stone = STONES[rng.integers(len(STONES))]
    kind = rng.integers(3)
    if kind == 2:
        return gravel(stone * rng.uniform(0.9, 1.3), spread, 0.04, seed)
    length, height = ((rng.uniform(0.5, 0.9), 0.5), (0.14, 0.12))[kind]
    return coursed(shades(stone, 7, spread, seed), length, height, 0.02, stone * rng.uniform(0.4, 1.2), seed)
