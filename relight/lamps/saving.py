"""Lamps as a JSON file that `--lamp` reads back to the same light."""

import json
import os
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import staged_file

from .asked import BULB_M, TUBE_M, AskedLamp, Brightness, LampScale, resolve
from .color import NAMES, TEMPERATURES, parse_color
from .photometry import times
from .shapes import MeshLamp, TubeLamp

_SUFFIXES = {"EV": "EV", "lumen": "lm", "candela": "cd"}


def write_lamps(
    path: str | os.PathLike[str], lamps: Sequence[AskedLamp], scale: LampScale | None = None, about: str = ""
) -> None:
    """Write lamps as JSON; `files.read_json_lamps` gives the same ones.

    scale: of the scene, for lamps whose units the file cannot express. about: a line for people.
    Raises InputError without lamps, and for a file that cannot be written.
    """
    if not lamps:
        raise InputError(f"{path}: there are no lamps to save")
    content: dict[str, Any] = {"about": about} if about else {}
    content["lamps"] = [fields_of(each, scale) for each in lamps]
    try:
        with staged_file(path) as partial:
            partial.write_text(json.dumps(content, indent=1) + "\n", "utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error}") from None


def fields_of(asked: AskedLamp, scale: LampScale | None = None) -> dict[str, Any]:
    """Return the fields of a lamp in a file, `type` first. Raises InputError as `write_lamps` does."""
    shape, brightness = asked.shape, asked.brightness
    if isinstance(shape, MeshLamp) and shape.radiance.ndim == 2 and brightness.unit != "picture":
        asked = AskedLamp(resolve(asked, _needed(scale)), Brightness(1.0, "picture"), name=asked.name)
        shape, brightness = asked.shape, asked.brightness  # of which a file has no other unit
    written: dict[str, Any] = {"type": type(shape).__name__.removesuffix("Lamp").lower()}
    for each in fields(shape):
        value = getattr(shape, each.name)
        if each.name == "radius":
            unsized = asked.radius_in_metres and value == (TUBE_M if isinstance(shape, TubeLamp) else BULB_M)
            written |= {} if unsized else {"radius": _radius(asked, scale)}
        elif each.name not in ("radiance", "intensity"):
            written[each.name] = value.tolist() if isinstance(value, np.ndarray) else value
    colored = times(shape, np.asarray(asked.color))
    name = "intensity" if getattr(colored, "radiance", None) is None else "radiance"
    light: NDArray[np.float64] = np.asarray(getattr(colored, name))
    if brightness.unit == "picture":
        written[name] = (light * brightness.value).tolist()
    else:
        if light.any():
            written["color"] = color_text(light)
        written["brightness"] = f"{brightness.value!r}{_SUFFIXES[brightness.unit]}"
    if asked.name:
        written["name"] = asked.name
    return written


def color_text(light: ArrayLike) -> str | list[float]:
    """Return what `color.parse_color` reads as the colour of a light (3,): its name where it has one."""
    red, green, blue = (float(each) for each in np.asarray(light))
    color = parse_color((red, green, blue))
    return next((name for name in (*TEMPERATURES, *NAMES) if np.allclose(parse_color(name), color)), list(color))


def _radius(asked: AskedLamp, scale: LampScale | None) -> float:
    radius: float = getattr(asked.shape, "radius", 0.0)
    return radius * _needed(scale).metre if asked.radius_in_metres else radius


def _needed(scale: LampScale | None) -> LampScale:
    if scale is None:
        raise InputError("metres and EV need the scale of the scene: give it")
    return scale
