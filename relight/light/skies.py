"""Built-in environments drawn by formula: (256, 512, 3) float32 linear, canonical lat-long, mean luminance 1.

Left, right and front are those of a camera on +z that looks at the origin: -x is left, +z the front.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Directions, Floats, Radiance, Vector
from splat2mesh.scene.color import luminance

from . import HEIGHT, WIDTH
from .projections import row_solid_angles, texel_directions
from .sky_model import SUN_RADIUS_DEG

_GROUND_ALBEDO = 0.2  # of soil and grass
_SUBSAMPLES = 16  # a side of each texel near a disc's rim


def image_of(name: str) -> NDArray[np.float32]:
    """Return a built-in sky, (HEIGHT, WIDTH, 3), canonical lat-long, mean luminance 1."""
    sky = _sky(name)
    return (sky.image / sky.mean).astype(np.float32)


def seen(name: str, directions: Directions) -> NDArray[np.float32]:
    """Return a built-in sky as an eye sees it in unit directions (..., 3), in any detail: for pictures alone.

    The sun is a disc of its true size. Far ground fades into the air above the horizon, which the image, whose texels
    are 0.7 degrees wide, does not resolve.
    """
    sky = _sky(name)
    directions = np.asarray(directions, np.float64)
    below = directions[..., 1] < 0.0 if sky.ground is not None else np.zeros(directions.shape[:-1], bool)
    result = np.empty((*directions.shape[:-1], 3))
    above = directions[~below]
    light = sky.formula(above)
    if sky.sun is not None:
        center, radiance = sky.sun
        inside = above @ center > np.cos(np.radians(SUN_RADIUS_DEG))
        light = light + inside[..., None] * radiance
    result[~below] = light
    if sky.ground is not None:
        low = directions[below]
        level = low * [1.0, 0.0, 1.0]
        level /= np.maximum(np.linalg.norm(level, axis=-1, keepdims=True), 1e-9)
        air = np.exp(low[..., 1] / _HAZE_HEIGHT)[..., None]
        result[below] = _mix(sky.ground, sky.formula(level), air)
    return (result / sky.mean).astype(np.float32)


def _studio_light(directions: Directions) -> NDArray[np.float64]:
    """A photographer's studio: key from the upper front left, soft fill, rim from behind, grey surroundings."""
    height = directions[..., 1:2]
    image = np.where(height > 0, 0.40 + 0.35 * height, 0.40 + 0.20 * height) * np.array([0.97, 0.99, 1.05])
    for center, half_size, color in (
        ((-0.66, 0.50, 0.80), (0.44, 0.36), (11.5, 11.0, 10.0)),  # key
        ((0.90, 0.10, 0.65), (0.40, 0.55), (2.2, 2.3, 2.5)),  # fill
        ((0.55, 0.50, -0.85), (0.16, 0.50), (9.5, 10.0, 11.0)),  # rim
        ((0.0, 1.0, 0.02), (0.30, 0.30), (2.0, 2.0, 2.0)),  # overhead
    ):
        image += _softbox(directions, center, half_size)[..., None] * color
    return image


def _overcast_sky(directions: Directions) -> NDArray[np.float64]:
    """The CIE overcast sky, L = Lz (1 + 2 sin elevation) / 3."""
    return (1.0 + 2.0 * np.maximum(directions[..., 1:2], 0.0)) / 3.0 * np.array([0.97, 1.0, 1.06])


def _noon_sky(directions: Directions) -> NDArray[np.float64]:
    """A clear day: on level ground five sixths of the light are the sun's."""
    sun = _direction(*_SUNS["noon"][0])
    blue = _mix((0.80, 0.90, 1.05), (0.28, 0.50, 1.10), np.sqrt(np.maximum(directions[..., 1:2], 0.0)))
    blue = _mix(blue, (1.05, 1.0, 0.95), np.exp(8.0 * (directions @ sun - 1.0))[..., None])  # whiter about the sun
    return _clear_sky(directions, sun)[..., None] * blue


def _sunset_sky(directions: Directions) -> NDArray[np.float64]:
    """An evening, warm along the ground: the sun gives level ground a quarter of what the sky gives."""
    sun = _direction(*_SUNS["sunset"][0])
    height = np.sqrt(np.maximum(directions[..., 1:2], 0.0))
    towards = 0.5 + 0.5 * (directions @ sun)[..., None]
    horizon = _mix((0.62, 0.55, 0.70), (1.90, 0.92, 0.36), towards**3)
    sky = _mix(horizon, (0.22, 0.33, 0.62), height)
    return sky + np.array([3.0, 1.5, 0.5]) * towards**60  # haze about the sun


_SKIES = {"studio": _studio_light, "overcast": _overcast_sky, "noon": _noon_sky, "sunset": _sunset_sky}

BUILTIN = tuple(_SKIES)

_SUNS = {"noon": ((-35.0, 60.0), (1.05, 1.0, 0.92), 5.0), "sunset": ((-60.0, 6.0), (1.50, 0.94, 0.50), 0.25)}
"""Azimuth and elevation in degrees, colour, and light on level ground over that of the sky."""

_HAZE_HEIGHT = 0.02
"""The farthest ground is lost in the air: the slope, as a sine, at which 1/e of the air's light is left."""


class _Sky(NamedTuple):
    """A sky in numbers: its formula, (direction, radiance) of its sun or None, the radiance of its ground or None, and
    the image of all of it with its mean luminance."""

    formula: Callable[[Directions], NDArray[np.float64]]
    sun: tuple[Vector, Vector] | None
    ground: Vector | None
    image: NDArray[np.float64]
    mean: float


@lru_cache
def _sky(name: str) -> _Sky:
    directions = texel_directions(HEIGHT, WIDTH)
    image, sun, ground = _SKIES[name](directions), None, None
    if name in _SUNS:
        angles, color, share = _SUNS[name]
        center = _direction(*angles)
        power, tint = _sun_power(image, directions, center, share), np.asarray(color) / luminance(color)
        solid_angle = 2.0 * np.pi * (1.0 - np.cos(np.radians(SUN_RADIUS_DEG)))
        sun = center, power / solid_angle * tint
        areas = row_solid_angles(HEIGHT, WIDTH)
        disc = _disc(directions, center) * areas
        image = image + (disc * power / disc.sum() / areas)[..., None] * tint
    if name != "studio":
        image = _over_ground(image, directions)
        ground = image[-1, 0]
    mean = np.sum(luminance(image) * row_solid_angles(HEIGHT, WIDTH)) / (4.0 * np.pi)
    return _Sky(_SKIES[name], sun, ground, image, mean)


def _direction(azimuth_deg: float, elevation_deg: float) -> NDArray[np.float64]:
    """Unit vector (3,): azimuth from +z towards +x, elevation towards +y."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])


def _mix(a: ArrayLike, b: ArrayLike, share: Floats) -> NDArray[np.float64]:
    return np.asarray(a) * (1.0 - share) + np.asarray(b) * share


def _softbox(directions: Directions, center: ArrayLike, half_size: tuple[float, float]) -> NDArray[np.float64]:
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


def _clear_sky(directions: Directions, sun: Vector) -> NDArray[np.float64]:
    """Relative luminance (H, W) of the CIE clear sky (Kittler; CIE 22-1973), without the sun's disc."""
    height = np.maximum(directions[..., 1], 0.01)
    cosine = np.clip(directions @ sun, -1.0, 1.0)
    scatter = 0.91 + 10.0 * np.exp(-3.0 * np.arccos(cosine)) + 0.45 * cosine**2
    return scatter * (1.0 - np.exp(-0.32 / height))


def _sun_power(sky: Radiance, directions: Directions, sun: Vector, level_share: float) -> float:
    """Irradiance of a surface that faces a sun which brings `level_share` times the sky's own luminous light onto level
    ground."""
    level = np.sum(luminance(sky) * row_solid_angles(HEIGHT, WIDTH) * np.maximum(directions[..., 1], 0.0))
    return level_share * level / sun[1]


def _disc(directions: Directions, center: Vector) -> NDArray[np.float64]:
    """Share (H, W) of each texel that the sun's disc covers."""
    radius, k = np.radians(SUN_RADIUS_DEG), _SUBSAMPLES
    covered = np.zeros(directions.shape[:2])
    near = directions @ center > np.cos(radius + np.pi / HEIGHT)  # a texel's reach is under pi / HEIGHT
    for row in np.flatnonzero(near.any(axis=1)):
        fine = texel_directions(HEIGHT * k, WIDTH * k, slice(row * k, (row + 1) * k)) @ center
        covered[row] = (fine > np.cos(radius)).reshape(k, WIDTH, k).mean(axis=(0, 2))
    return covered


def _over_ground(sky: Radiance, directions: Directions) -> NDArray[np.float64]:
    """The sky above the horizon, and below it a matt ground of uniform radiance that this sky lights."""
    areas = row_solid_angles(HEIGHT, WIDTH)[..., None]
    above = directions[..., 1:2] > 0
    irradiance = np.sum(sky * areas * directions[..., 1:2] * above, axis=(0, 1))
    return np.where(above, sky, _GROUND_ALBEDO * irradiance / np.pi)
