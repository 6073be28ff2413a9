"""An inset that shows the light in a corner of a picture: a chrome ball, a matt ball, and an arrow."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import luminance, srgb_from_linear

from ..light.tonemap import compress_highlights
from ..sh import harmonics
from .backdrop import behind
from .sheet import MARK, PAPER

if TYPE_CHECKING:
    from splat2mesh.render.view import View

    from ..light.environment import Environment

SIZE = 0.042
"""Radius of a ball, of the picture's height."""

SAMPLES = 2  # along a pixel's side
GREY = 0.5  # albedo of the matt ball
PLATE = 0.55  # opacity of the paper that the balls lie on
STEEP = 0.35  # sine of the angle to the line of sight below which an arrow would be a dot


def add_inset(
    image: NDArray,  # (H, W, 3) float32 sRGB in [0, 1]; changed in place
    view: "View",  # in the scene frame
    environment: "Environment",
    exposure: float,
) -> tuple[slice, slice]:
    """Draw the inset into the lower left corner: the rows and columns that it takes."""
    radius = SIZE * view.height
    wide, high = round(5.4 * radius), round(3.2 * radius)
    margin = round(0.3 * radius)
    rows = slice(max(view.height - margin - high, 0), max(view.height - margin, 0))
    columns = slice(min(margin, view.width), min(margin + wide, view.width))
    x, y = np.meshgrid(
        (np.arange(SAMPLES * wide) + 0.5) / SAMPLES / radius, (np.arange(SAMPLES * high) + 0.5) / SAMPLES / radius
    )
    color, cover = np.full((*x.shape, 3), np.divide(PAPER, 255.0)), np.full(x.shape, PLATE)
    cover[_outside_plate(x, y, wide / radius, high / radius)] = 0.0
    axes = view.camera_from_world[:3, :3]  # rows: right, down, forward
    light = strongest(environment)
    for centre, shade in (((1.4, 1.75), _chrome), ((3.7, 1.75), _matt)):
        u, v = x - centre[0], y - centre[1]
        on = u * u + v * v <= 1.0
        normal = np.stack([u[on], v[on], -np.sqrt(1.0 - u[on] ** 2 - v[on] ** 2)], axis=-1)
        color[on] = srgb_from_linear(compress_highlights(shade(normal, axes, environment, exposure)))
        cover[on] = 1.0
        if shade is _matt and light is not None:
            _draw_arrow(x, y, centre, axes @ light, color, cover)
    shape = (high, SAMPLES, wide, SAMPLES)
    cover_mean = cover.reshape(shape).mean(axis=(1, 3))[..., None]
    ink = (color * cover[..., None]).reshape(*shape, 3).mean(axis=(1, 3))
    target = image[rows, columns]
    cut = slice(high - target.shape[0], None), slice(0, target.shape[1])
    target[...] = ink[cut] + (1.0 - cover_mean[cut]) * target
    return rows, columns


def _chrome(normal: NDArray, axes: NDArray, environment: "Environment", exposure: float) -> NDArray:
    mirrored = np.array([0.0, 0.0, 1.0]) - 2.0 * normal[:, 2:] * normal  # the line of sight, (0, 0, 1), thrown back
    return behind(environment, mirrored @ axes, exposure)


def _matt(normal: NDArray, axes: NDArray, environment: "Environment", exposure: float) -> NDArray[np.float32]:
    leaving = harmonics.evaluate(normal @ axes, 3) @ harmonics.convolve(environment.sh(3)) / np.pi
    return (GREY * exposure * np.maximum(leaving, 0.0)).astype(np.float32)


def strongest(environment: "Environment") -> NDArray | None:
    """Unit direction (3,) that most light comes from, scene frame; None where it comes from all sides alike."""
    bands = luminance(environment.sh(2))
    toward = np.array([bands[3], bands[1], bands[2]])
    length = float(np.linalg.norm(toward))
    return toward / length if length > 0.02 * abs(bands[0]) and length > 0.0 else None


def _outside_plate(x: NDArray, y: NDArray, width: float, height: float) -> NDArray[np.bool_]:
    """Whether points lie beyond a rectangle with round corners."""
    round_off = 0.5
    dx = np.maximum(np.abs(x - width / 2) - width / 2 + round_off, 0.0)
    dy = np.maximum(np.abs(y - height / 2) - height / 2 + round_off, 0.0)
    return np.hypot(dx, dy) > round_off


def _draw_arrow(
    x: NDArray, y: NDArray, centre: tuple[float, float], light: NDArray, color: NDArray, cover: NDArray
) -> None:
    """An arrow towards the ball from where the light comes; a ring on the ball where it comes along the view."""
    flat = np.hypot(light[0], light[1])
    u, v = x - centre[0], y - centre[1]
    if flat < STEEP:
        ring = np.abs(np.hypot(u - light[0], v - light[1]) - 0.28) < 0.08
    else:
        along = (u * light[0] + v * light[1]) / flat
        aside = np.abs(-u * light[1] + v * light[0]) / flat
        shaft = (along > 1.2) & (along < 1.65) & (aside < 0.09)
        head = (along > 1.05) & (along < 1.4) & (aside < (along - 1.05) * 0.65)
        ring = shaft | head
    color[ring], cover[ring] = np.divide(MARK, 255.0), 1.0
