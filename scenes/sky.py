"""The sky of a capture: one with clouds, drawn by formula, and far splats that look like a trained picture of a sky."""

import numpy as np

from relight import Environment
from relight.light.projections import row_solid_angles, texel_directions
from splat2mesh.scene.color import luminance

from .cameras import FLIP
from .places.textures import noise

HEIGHT, WIDTH = 256, 512
SUN_AZIMUTH_DEG, SUN_ELEVATION_DEG = -38.0, 44.0
SUN_OVER_SKY = 2.4
"""Irradiance of the sun on level ground over that of the sky: a bright day with clouds."""

FAR, FAR_SPREAD = 2.2, 0.25
"""Distance of the sky's splats in the place's radius. Training leaves them at all distances: spread of the log."""

PILOT, EYES = 6000, 24
"""Directions that sample how much of the sky is seen, and the most views that are used."""


def capture_sky(name):
    """Environment by name: "cloudy" is drawn here, all else is read by `Environment.load`."""
    return cloudy() if str(name) == "cloudy" else Environment.load(name)


def cloudy():
    """Blue sky with broken clouds and a sun: an Environment, 512 x 256, mean luminance 1."""
    directions = texel_directions(HEIGHT, WIDTH)
    up = directions[..., 1:2]
    azimuth, elevation = np.radians([SUN_AZIMUTH_DEG, SUN_ELEVATION_DEG])
    sun = np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
    near = np.clip(directions @ sun, -1, 1)[..., None]
    height = np.sqrt(np.clip(up, 0, 1))
    sky = np.array([0.78, 0.92, 1.12]) * (1 - height) + np.array([0.17, 0.36, 0.86]) * height
    sky = sky + np.array([0.9, 0.85, 0.75]) * np.exp(6.0 * (near - 1))
    plane = (directions / (np.maximum(up, 0) + 0.22)).reshape(-1, 3) * [1, 0, 1]
    billow = noise(plane, 1.6, 11, 6).reshape(up.shape) + 0.35 * noise(plane, 0.5, 4, 4).reshape(up.shape)
    lit = noise(plane + 0.12 * sun * [1, 0, 1], 1.6, 11, 6).reshape(up.shape)
    cover = np.clip((billow - 0.02) / 0.3, 0, 1) * np.clip(up / 0.06, 0, 1)
    cover = cover * cover * (3 - 2 * cover)
    cloud = (
        1.8
        * (1.35 - 1.1 * np.clip(lit + 0.15, -0.3, 0.6) + 1.6 * np.exp(5.0 * (near - 1)))
        * np.array([1.0, 0.99, 0.98])
    )
    image = np.where(up > 0, sky * (1 - cover) + cloud * cover, 0.0)
    areas = row_solid_angles(HEIGHT, WIDTH)[..., None]
    level = np.sum(image * areas * np.maximum(up, 0), axis=(0, 1))
    ground = np.array([0.07, 0.11, 0.035]) * level * (1 + SUN_OVER_SKY) / np.pi
    image = np.where(up > 0, image, ground)
    row, column = np.unravel_index(near[..., 0].argmax(), near.shape[:2])
    power = SUN_OVER_SKY * luminance(level) / sun[1] / areas[row, 0, 0]
    image[row, column] += power * np.array([1.06, 1.0, 0.86])
    mean = np.sum(luminance(image) * areas[..., 0]) / (4 * np.pi)
    return Environment((image / mean).astype(np.float32), "cloudy")


def sky_points(place, caster, views, count):
    """Positions of the far splats: the `count` most even ones beyond the scene that a view sees.

    Returns directions from the middle (N, 3), distances (N,) and mean spacing in radians, with N <= count; none when
    no view sees the sky. Scene frame.
    """
    middle = np.mean([view.center * FLIP for view in views], axis=0)
    radius = FAR * max(np.linalg.norm(place.vertices[place.faces].max(axis=1) - middle, axis=1).max(), 4.0)
    views = views[:: max(1, len(views) // EYES)]
    seen = _seen(caster, views, middle, radius, _even(PILOT)).mean()
    if seen == 0.0 or count == 0:
        return np.zeros((0, 3)), np.zeros(0), 0.0
    candidates = _even(round(1.03 * count / seen))
    chosen = candidates[_seen(caster, views, middle, radius, candidates)]
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(count, len(chosen))).astype(int)]
    far = radius * np.exp(FAR_SPREAD * np.random.default_rng(len(chosen)).normal(size=len(chosen)))
    return chosen, far, np.sqrt(4 * np.pi / len(candidates))


def _even(count):
    """Even directions on the sphere, (count, 3): the Fibonacci lattice."""
    steps = np.arange(count) + 0.5
    y, turn = 1 - 2 * steps / count, np.pi * (1 + np.sqrt(5)) * steps
    flat = np.sqrt(1 - y * y)
    return np.stack([flat * np.cos(turn), y, flat * np.sin(turn)], axis=1)


def _seen(caster, views, middle, radius, directions):
    points, seen = middle + radius * directions, np.zeros(len(directions), bool)
    for view in views:
        pixels, depth = view.project(points * FLIP)
        inside = (pixels > 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1) & (depth > 0) & ~seen
        rows = np.flatnonzero(inside)
        eye = view.center * FLIP
        seen[rows] = ~caster.occluded(np.hstack([np.broadcast_to(eye, (len(rows), 3)), points[rows] - eye]))
    return seen
