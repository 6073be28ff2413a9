"""Albedo patterns: linear RGB as a function of position.

Every function takes points, (V, 3) in the scene frame, and returns (V, 3) float64 in [0, 1].
"""

import numpy as np
from scipy.spatial import cKDTree

from splat2mesh.scene.color import luminance

DARKEST, LIGHTEST = 0.06, 0.75
"""Range of the albedos. Charcoal to white paper: outside it neither photographs nor relighting show much."""


def random_colors(rng, count):
    """Well-mixed colours, (count, 3): hues a golden angle apart, saturation and value at random."""
    hue = (rng.uniform() + np.arange(count) * 0.381966)[:, None] * 2 * np.pi + np.array([0, 2, 4]) * np.pi / 3
    saturation, value = rng.uniform(0.2, 0.9, (count, 1)), rng.uniform(0.35, 1.0, (count, 1))
    tint = value * (1 - saturation * (0.5 - 0.5 * np.cos(hue)))
    return DARKEST + (LIGHTEST - DARKEST) * tint


def palette(rng, count):
    """Colours (count, 3) about one brightness, and how patchy a scene of them is, from 0 to 1.

    The middle of their luminances is between 0.08 and 0.7, even in its log, and their spread grows with patchiness.
    """
    level, patchy = np.exp(rng.uniform(np.log(0.08), np.log(0.7))), rng.uniform() ** 1.3
    colors = random_colors(rng, count)
    offsets = rng.permutation(np.linspace(-1.0, 1.0, count)) * (0.08 + 0.85 * patchy)
    logit = np.log(level / (1 - level)) + 1.4 * offsets
    wanted = 1.0 / (1.0 + np.exp(-logit))
    tint = colors / luminance(colors)[:, None]
    tint = 1.0 + (0.25 + 0.75 * patchy) * (tint - 1.0)
    return np.clip(tint * wanted[:, None], 0.03, 0.88), patchy


def stripes(points, colors, direction, period):
    """Two colours in equal stripes across `direction`, (3,)."""
    phase = points @ np.asarray(direction, np.float64) / (np.linalg.norm(direction) * period)
    return np.asarray(colors)[np.floor(2 * phase).astype(int) % 2]


def checker(points, colors, period):
    """Two colours in a chequerboard of cubes, shifted so that no face on an axis lies on a boundary."""
    cell = np.floor(points / period + 0.31).astype(int)
    return np.asarray(colors)[cell.sum(axis=1) % 2]


def patches(points, colors, rng):
    """One colour for each cell of a random Voronoi mosaic over the points."""
    sites = rng.uniform(points.min(axis=0), points.max(axis=0), (len(colors), 3))
    return np.asarray(colors)[cKDTree(sites).query(points, workers=-1)[1]]


def mottled(points, color, rng, wavelength, amount=1.0):
    """One colour whose brightness wanders by about 30% of `amount` over `wavelength`."""
    waves = rng.normal(0.0, 2 * np.pi / wavelength, (3, 8))
    noise = np.sin(points @ waves + rng.uniform(0.0, 2 * np.pi, 8)).mean(axis=1, keepdims=True)
    return np.clip(np.asarray(color) * np.exp(amount * noise), 0.0, 0.9)
