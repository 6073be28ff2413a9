"""The likeliest captured lights as pictures: the albedo that each leaves, and its map in a corner."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.sphere import texel_directions
from splat2mesh.scene.color import bytes_from_unit, luminance, srgb_from_linear

from ..albedo.by_hand import SkyAndSun
from ..engine.appearance import Appearance
from ..engine.by_hand import LightByHand, can_be_set
from ..engine.relighter import Relighter
from ..light.environment import Environment
from ..light.projections import SUBSAMPLES
from ..light.tonemap import compress_highlights
from .sheet import GAP, INK

MAP_PART = 0.26
"""Width of a light's map, of the picture's."""

MIDDLE = 0.5
"""Display value of the median luminance of a map's upper half."""

Painter = Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[np.uint8]]
"""(albedo, irradiance of the capture), (V, 3) each -> picture, (H, W, 3) uint8."""


def offered_pictures(relighter: Relighter, look: Appearance, paint: Painter) -> list[tuple[str, NDArray[np.uint8]]]:
    """Names and pictures of the lights that an estimate offered in the folder of a scene; none of fewer than two."""
    said = relighter.said.light is not None or str((look.capture or {}).get("light")).startswith("estimated")
    if not said or not can_be_set(look, relighter):
        return []
    by_hand = LightByHand(relighter, look)
    likely = [each for each in by_hand.offered if not each.entry.by_hand]
    if len(likely) < 2:
        return []
    found = []
    for number, offered in enumerate(likely, 1):
        picture = paint(*by_hand.under(offered.whole)).copy()
        shown = light_map(offered.whole, round(MAP_PART * picture.shape[1]))
        (height, width), right = shown.shape[:2], picture.shape[1] - GAP
        picture[GAP - 1 : GAP + height + 1, right - width - 1 : right + 1] = INK
        picture[GAP : GAP + height, right - width : right] = shown
        found.append((label(number, offered), picture))
    return found


def label(number: int, offered: SkyAndSun) -> str:
    """The name of an offered light, with its number, from 1, and its share."""
    share = 100.0 * offered.entry.share
    return f"light {number}: {offered.entry.name}, " + (f"{share:.0f}%" if share >= 0.5 else "below 1%")


def light_map(environment: Environment, width: int) -> NDArray[np.uint8]:
    """The lat-long map of a light, (width / 2, width, 3) uint8, exposed for its upper half."""
    height = width // 2
    directions = texel_directions(SUBSAMPLES * height, SUBSAMPLES * width).reshape(-1, 3)
    fine = environment.lookup(directions).astype(np.float64).reshape(height, SUBSAMPLES, width, SUBSAMPLES, 3)
    image = fine.mean(axis=(1, 3))
    level = max(float(np.median(luminance(image[: height // 2]))), 1e-9)
    shown = compress_highlights((image * MIDDLE / level).reshape(-1, 3).astype(np.float32))
    return bytes_from_unit(srgb_from_linear(shown)).reshape(height, width, 3)
