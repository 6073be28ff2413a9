"""Albedo patterns: linear RGB as a function of position.

Every function takes points, (V, 3) in the scene frame, and returns (V, 3) float64 in [0, 1].
"""

import numpy as np
from scipy.spatial import cKDTree

DARKEST, LIGHTEST = 0.06, 0.75
"""Range of the albedos. Charcoal to white paper: outside it neither photographs nor relighting show much."""


def random_colors(rng, count):
    """Well-mixed colours, (count, 3): hues a golden angle apart, saturation and value at random."""
    hue = (rng.uniform() + np.arange(count) * 0.381966)[:, None] * 2 * np.pi + np.array([0, 2, 4]) * np.pi / 3
    saturation, value = rng.uniform(0.2, 0.9, (count, 1)), rng.uniform(0.35, 1.0, (count, 1))
    tint = value * (1 - saturation * (0.5 - 0.5 * np.cos(hue)))
    return DARKEST + (LIGHTEST - DARKEST) * tint


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


def mottled(points, color, rng, wavelength):
    """One colour whose brightness wanders by about 30% over `wavelength`."""
    waves = rng.normal(0.0, 2 * np.pi / wavelength, (3, 8))
    noise = np.sin(points @ waves + rng.uniform(0.0, 2 * np.pi, 8)).mean(axis=1, keepdims=True)
    return np.clip(np.asarray(color) * np.exp(1.0 * noise), 0.0, 0.9)
