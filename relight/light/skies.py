"""Built-in environments drawn by formula: (256, 512, 3) float32 linear, canonical lat-long, mean luminance 1.

Left, right and front are those of a camera on +z that looks at the origin: -x is left, +z the front.
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import luminance

from .projections import row_solid_angles, texel_directions

HEIGHT, WIDTH = 256, 512
_SUN_RADIUS_DEG = 0.266  # half the mean apparent diameter of the solar disc
_GROUND_ALBEDO = 0.2  # of soil and grass
_SUBSAMPLES = 16  # a side of each texel near a disc's rim


def studio() -> NDArray:
    """Photographer's studio: key from the upper front left, soft fill, rim from behind, grey surroundings."""
    directions = texel_directions(HEIGHT, WIDTH)
    height = directions[..., 1:2]
    image = np.where(height > 0, 0.40 + 0.35 * height, 0.40 + 0.20 * height) * np.array([0.97, 0.99, 1.05])
    for center, half_size, color in (
        ((-0.66, 0.50, 0.80), (0.44, 0.36), (11.5, 11.0, 10.0)),  # key
        ((0.90, 0.10, 0.65), (0.40, 0.55), (2.2, 2.3, 2.5)),  # fill
        ((0.55, 0.50, -0.85), (0.16, 0.50), (9.5, 10.0, 11.0)),  # rim
        ((0.0, 1.0, 0.02), (0.30, 0.30), (2.0, 2.0, 2.0)),  # overhead
    ):
        image += _softbox(directions, center, half_size)[..., None] * color
    return _normalised(image)


def overcast() -> NDArray:
    """Overcast day: the CIE overcast sky, L = Lz (1 + 2 sin elevation) / 3, over a grey ground it lights."""
    directions = texel_directions(HEIGHT, WIDTH)
    sky = (1.0 + 2.0 * np.maximum(directions[..., 1:2], 0.0)) / 3.0 * np.array([0.97, 1.0, 1.06])
    return _normalised(_over_ground(sky, directions))


def noon() -> NDArray:
    """Clear day, sun 60 degrees up: five sixths of the light on level ground are the sun's, one the sky's."""
    directions = texel_directions(HEIGHT, WIDTH)
    sun = _direction(azimuth_deg=-35.0, elevation_deg=60.0)
    blue = _mix((0.80, 0.90, 1.05), (0.28, 0.50, 1.10), np.sqrt(np.maximum(directions[..., 1:2], 0.0)))
    blue = _mix(blue, (1.05, 1.0, 0.95), np.exp(8.0 * (directions @ sun - 1.0))[..., None])  # whiter about the sun
    sky = _clear_sky(directions, sun)[..., None] * blue
    sky = _with_sun(sky, directions, sun, (1.05, 1.0, 0.92), level_share=5.0)
    return _normalised(_over_ground(sky, directions))


def sunset() -> NDArray:
    """Sun 6 degrees up on the left: warm light along the ground, a quarter as much on it as the sky's."""
    directions = texel_directions(HEIGHT, WIDTH)
    sun = _direction(azimuth_deg=-60.0, elevation_deg=6.0)
    height = np.sqrt(np.maximum(directions[..., 1:2], 0.0))
    towards = 0.5 + 0.5 * (directions @ sun)[..., None]
    horizon = _mix((0.62, 0.55, 0.70), (1.90, 0.92, 0.36), towards**3)
    sky = _mix(horizon, (0.22, 0.33, 0.62), height)
    sky = sky + np.array([3.0, 1.5, 0.5]) * towards**60  # haze about the sun
    sky = _with_sun(sky, directions, sun, (1.50, 0.94, 0.50), level_share=0.25)
    return _normalised(_over_ground(sky, directions))


BUILTIN = {"studio": studio, "overcast": overcast, "noon": noon, "sunset": sunset}


def _direction(azimuth_deg, elevation_deg):
    """Unit vector (3,): azimuth from +z towards +x, elevation towards +y."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])


def _mix(a, b, share):
    return np.asarray(a) * (1.0 - share) + np.asarray(b) * share


def _softbox(directions, center, half_size):
    """Brightness (H, W) in 0..1 of a rectangle that faces the origin from `center`, with soft edges.

    half_size: horizontal and vertical half extent over its distance.
    """
    forward = np.asarray(center) / np.linalg.norm(center)
    right = np.cross((0.0, 1.0, 0.0), forward)
    right /= np.linalg.norm(right)
    depth = directions @ forward
    ahead = np.maximum(depth, 1e-3)
    x = np.abs(directions @ right) / ahead / half_size[0]
    y = np.abs(directions @ np.cross(forward, right)) / ahead / half_size[1]
    ramp_x, ramp_y = (np.clip((1.0 - edge) / 0.25, 0.0, 1.0) for edge in (x, y))
    return np.where(depth > 0, ramp_x**2 * (3 - 2 * ramp_x) * ramp_y**2 * (3 - 2 * ramp_y), 0.0)


def _clear_sky(directions, sun):
    """Relative luminance (H, W) of the CIE clear sky (Kittler; CIE 22-1973), without the sun's disc."""
    height = np.maximum(directions[..., 1], 0.01)
    cosine = np.clip(directions @ sun, -1.0, 1.0)
    scatter = 0.91 + 10.0 * np.exp(-3.0 * np.arccos(cosine)) + 0.45 * cosine**2
    return scatter * (1.0 - np.exp(-0.32 / height))


def _with_sun(sky, directions, sun, color, level_share):
    """The sky with a sun that brings `level_share` times the sky's own luminous light onto level ground."""
    areas = row_solid_angles(HEIGHT, WIDTH)
    level = np.sum(luminance(sky) * areas * np.maximum(directions[..., 1], 0.0))
    disc = _disc(directions, sun) * areas
    power = level_share * level / sun[1]  # irradiance of a surface that faces the sun
    return sky + (disc * power / disc.sum() / areas)[..., None] * (np.asarray(color) / luminance(color))


def _disc(directions, center):
    """Share (H, W) of each texel that the sun's disc covers."""
    radius, k = np.radians(_SUN_RADIUS_DEG), _SUBSAMPLES
    covered = np.zeros(directions.shape[:2])
    near = directions @ center > np.cos(radius + np.pi / HEIGHT)  # a texel's reach is under pi / HEIGHT
    for row in np.flatnonzero(near.any(axis=1)):
        fine = texel_directions(HEIGHT * k, WIDTH * k, slice(row * k, (row + 1) * k)) @ center
        covered[row] = (fine > np.cos(radius)).reshape(k, WIDTH, k).mean(axis=(0, 2))
    return covered


def _over_ground(sky, directions):
    """The sky above the horizon, and below it a matt ground of uniform radiance that this sky lights."""
    areas = row_solid_angles(HEIGHT, WIDTH)[..., None]
    above = directions[..., 1:2] > 0
    irradiance = np.sum(sky * areas * directions[..., 1:2] * above, axis=(0, 1))
    return np.where(above, sky, _GROUND_ALBEDO * irradiance / np.pi)


def _normalised(image):
    mean = np.sum(luminance(image) * row_solid_angles(HEIGHT, WIDTH)) / (4.0 * np.pi)
    return (image / mean).astype(np.float32)
