"""The colour of a lamp, as text: a temperature, a hexadecimal colour, a name, or three numbers.

A colour here is linear Rec. 709 RGB whose luminance is 1, so that it never changes how bright a lamp is.
"""

import math
import re
from collections.abc import Sequence

import numpy as np

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import clip, meant
from splat2mesh.scene.color import linear_from_srgb, luminance

from ..light.color_spaces import REC709, xyz_from_rgb
from .shapes import checked_light

WHITE: Triple = (1.0, 1.0, 1.0)

COLDEST_K, HOTTEST_K = 1000.0, 25000.0

TEMPERATURES = {"candle": 1900.0, "warm": 2700.0, "halogen": 3000.0, "neutral": 4000.0, "cool": 6500.0}
"""Names of whites, in kelvin: as the packages of bulbs have them."""

NAMES = {
    "white": "ffffff",
    "red": "ff0000",
    "orange": "ffa500",
    "amber": "ffbf00",
    "yellow": "ffff00",
    "green": "00ff00",
    "cyan": "00ffff",
    "blue": "0000ff",
    "purple": "800080",
    "magenta": "ff00ff",
    "pink": "ffc0cb",
}
"""sRGB of the other names: those of CSS, but green is its lime, which is what a green lamp shows."""

_XYZ_FROM_RGB = np.asarray(xyz_from_rgb(REC709))


def parse_color(value: str | Sequence[float]) -> Triple:
    """The colour that a text or three numbers mean, linear with luminance 1.

    value: "3000K", "#ffcc88" or "ffcc88" (sRGB), a name of TEMPERATURES or NAMES, or linear RGB, as a text with commas
    too. Raises InputError for anything else, and for black.
    """
    if not isinstance(value, str):
        return _of_luminance_1(checked_light("color", value))
    text = value.strip().lower()
    if kelvin := re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?)\s*k", text):
        return blackbody(float(kelvin[1]))
    if text in TEMPERATURES:
        return blackbody(TEMPERATURES[text])
    if code := re.fullmatch(r"#?([0-9a-f]{6})", NAMES.get(text, text), re.ASCII):
        red, green, blue = linear_from_srgb(np.frombuffer(bytes.fromhex(code[1]), np.uint8) / 255.0).tolist()
        return _of_luminance_1((red, green, blue))
    if "," in text:
        return _of_luminance_1(checked_light("color", text.split(",")))  # type: ignore[arg-type]  # it makes floats
    expected = "a temperature such as 3000K, sRGB such as #ffcc88, a name such as warm, or linear red,green,blue"
    raise InputError(f"`color` {clip(value)}: expected {expected}{meant(text, [*TEMPERATURES, *NAMES])}")


def blackbody(kelvin: float) -> Triple:
    """The colour of a black body, linear with luminance 1.

    kelvin: from 1000 to 25000. Below 1900 K its blue lies outside Rec. 709 and is taken as 0.
    Source: M. Krystek, "An algorithm to calculate correlated colour temperature", 1985: the locus in CIE 1960 u, v.
    Against Planck's law and the CIE 1931 observer x and y are within 0.0005 to 15000 K, and 0.002 to 25000 K.
    """
    if not COLDEST_K <= kelvin <= HOTTEST_K:
        raise InputError(f"`color` {kelvin:g}K: expected {COLDEST_K:g}K to {HOTTEST_K:g}K")
    t = float(kelvin)
    u = (0.860117757 + 1.54118254e-4 * t + 1.28641212e-7 * t * t) / (1.0 + 8.42420235e-4 * t + 7.08145163e-7 * t * t)
    v = (0.317398726 + 4.22806245e-5 * t + 4.20481691e-8 * t * t) / (1.0 - 2.89741816e-5 * t + 1.61456053e-7 * t * t)
    x, y = 3.0 * u / (2.0 * u - 8.0 * v + 4.0), 2.0 * v / (2.0 * u - 8.0 * v + 4.0)
    xyz = np.array([x / y, 1.0, (1.0 - x - y) / y])
    red, green, blue = np.maximum(np.linalg.solve(_XYZ_FROM_RGB, xyz), 0.0).tolist()
    return _of_luminance_1((red, green, blue))


def _of_luminance_1(color: Triple) -> Triple:
    bright = float(luminance(color))
    red, green, blue = (each / bright if bright > 0.0 else math.inf for each in color)
    if not max(red, green, blue) < math.inf:
        raise InputError(f"`color` {','.join(f'{each:g}' for each in color)}: a lamp cannot be black")
    return red, green, blue
