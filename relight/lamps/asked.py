"""A requested lamp: its shape, colour and brightness, in units of the scene or of a manufacturer.

A colour is linear Rec. 709 RGB whose luminance is 1, so that it never changes how bright a lamp is.

lamp = resolve(asked, scale)  # in units of the picture
in_words(lamp, scale)         # "as bright as the room at 1.3 m"
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import clip, meant
from splat2mesh.scene.color import linear_from_srgb, luminance

from ..light import MOST_RADIANCE
from ..light.color_spaces import REC709, xyz_from_rgb
from .photometry import axis_intensity, flux, times
from .shapes import (
    Lamp,
    SphereLamp,
    TubeLamp,
    checked_light,
    checked_size,
)

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

Unit: TypeAlias = Literal["picture", "EV", "lumen", "candela"]

LARGEST_EV = float(math.ceil(math.log2(MOST_RADIANCE)))
"""Stops up to MOST_RADIANCE."""

LONGEST_NAME = 80

BULB_M, TUBE_M = 0.05, 0.013
"""Radii in metres of a bulb and of a fluorescent tube (T8), where none is given."""

_UNITS: dict[str, Unit] = {"ev": "EV", "lm": "lumen", "lumen": "lumen", "lumens": "lumen", "cd": "candela"}


@dataclass(frozen=True)
class Brightness:
    """The requested brightness of a lamp.

    unit: "picture": `value` times the light of the shape, which is in units of the picture (radiance 1 shows as white).
    "EV": at 1 m on its main axis the lamp gives 2^value times the scene's median captured irradiance. "candela": the
    intensity on its main axis. "lumen": its whole flux.
    """

    value: float
    unit: Unit = "EV"

    def __post_init__(self) -> None:
        if self.unit not in get_args(Unit):
            raise InputError(f"`brightness` in {self.unit}: expected one of {', '.join(get_args(Unit))}")
        most = LARGEST_EV if self.unit == "EV" else MOST_RADIANCE
        least = -LARGEST_EV if self.unit == "EV" else 0.0
        value = checked_size("brightness", self.value, least=least)
        if value > most:
            raise InputError(f"`brightness` {value:g} {self.unit}: expected at most {most:g}")
        object.__setattr__(self, "value", value)


DEFAULT_BRIGHTNESS = Brightness(2.0, "EV")


@dataclass(frozen=True, eq=False)
class AskedLamp:
    """A lamp as requested, with lengths in the splat's units.

    shape: where it is and how large; its radiance or intensity says how the light of its faces and channels compares,
    and is the light itself where the unit of the brightness is "picture". color (3,): linear RGB, by which that is
    multiplied; as people name it, of luminance 1. radius_in_metres: the radius of the shape is in metres instead, as
    none was given.
    """

    shape: Lamp
    brightness: Brightness = DEFAULT_BRIGHTNESS
    color: Triple = WHITE
    name: str = ""
    radius_in_metres: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "color", checked_light("color", self.color))
        object.__setattr__(self, "name", "".join(each for each in self.name if each.isprintable())[:LONGEST_NAME])


@dataclass(frozen=True)
class LampScale:
    """The scale of brightness and lengths.

    metre: splat units per metre. irradiance: the median captured one, as luminance in units of the picture: pi for
    white under a white sky. candela: radiance in the picture of 1 cd/m^2, None if unknown.
    """

    metre: float
    irradiance: float
    candela: float | None = None

    def __post_init__(self) -> None:
        for name in ("metre", "irradiance") if self.candela is None else ("metre", "irradiance", "candela"):
            object.__setattr__(self, name, checked_size(name, getattr(self, name)))


def in_picture_units(light: Sequence[float]) -> tuple[Triple, Brightness]:
    """Linear RGB in units of the picture as a colour of luminance 1, white for black, and a brightness."""
    red, green, blue = (float(each) for each in light)
    bright = float(luminance([red, green, blue]))
    if not bright > 0.0:
        return WHITE, Brightness(0.0, "picture")
    return (red / bright, green / bright, blue / bright), Brightness(bright, "picture")


def parse_brightness(text: str) -> Brightness:
    """The brightness that a text means: "+1EV", "800lm", "50cd". Raises InputError for anything else."""
    words = " ".join(str(text).split())
    match = re.fullmatch(r"([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*([a-zA-Z]+)", words)
    unit = (_UNITS | {"candela": "candela"}).get(match[2].lower()) if match else None
    try:
        value = float(match[1]) if match else math.nan
    except ValueError:
        value = math.nan
    if unit is None or not math.isfinite(value):
        raise InputError(f"`brightness` {words[:40]}: expected a number with its unit, such as +1EV, 800lm or 50cd")
    return Brightness(value, unit)


def resolve(asked: AskedLamp, scale: LampScale) -> Lamp:
    """The requested lamp, its light in units of the picture and its lengths in the splat's.

    The irradiance at 1 m is taken from the intensity on the main axis, as of a point: what a lamp gives from afar. A
    disc of half a metre really gives 6% less there. Raises InputError for lumens and candela without
    `LampScale.candela`, for a lamp that has no light to be scaled, and for one too bright.
    """
    brightness, shape = asked.brightness, asked.shape
    if asked.radius_in_metres and isinstance(shape, (SphereLamp, TubeLamp)):
        shape = replace(shape, radius=shape.radius * scale.metre)
    lamp = times(shape, np.asarray(asked.color))
    if brightness.unit == "picture":
        return times(lamp, brightness.value)
    if brightness.unit == "EV":
        wanted, has = 2.0**brightness.value * scale.irradiance * scale.metre * scale.metre, axis_intensity(lamp)
    else:
        if scale.candela is None:
            unit = {"lumen": "lm", "candela": "cd"}[brightness.unit]
            raise InputError(
                f"`brightness` {brightness.value:g}{unit}: nothing says how many candela a white of the picture has; "
                "give the brightness in EV, or the scale of the light"
            )
        wanted = brightness.value * scale.candela * scale.metre * scale.metre
        has = axis_intensity(lamp) if brightness.unit == "candela" else flux(lamp)
    sent = float(luminance(has))
    if wanted == 0.0:
        return times(lamp, 0.0)
    if not 0.0 < sent < math.inf:
        raise InputError(f"`brightness` {brightness.value:g} {brightness.unit}: the lamp sends out no light to scale")
    return times(lamp, wanted / sent)


def in_words(lamp: Lamp, scale: LampScale, place: str = "room") -> str:
    """The brightness of a lamp in everyday words: "as bright as the room at 1.3 m".

    That is the distance on its main axis, as of a point, at which it gives the median captured irradiance. With a
    `LampScale.candela` its lumens follow.
    """
    intensity = float(luminance(axis_intensity(lamp)))
    if intensity == 0.0:
        return "dark"
    distance_m = math.sqrt(intensity / scale.irradiance) / scale.metre
    text = f"as bright as the {place} at {_two_digits(distance_m)} m"
    if scale.candela is not None:
        text += f", {_two_digits(float(luminance(flux(lamp))) / (scale.candela * scale.metre * scale.metre))} lm"
    return text


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


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
