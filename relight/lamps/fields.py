"""A lamp from its fields, by the names that `--lamp` and files of lamps share: those of the shapes, and a few more.

Values are texts, as a command line has them, or what JSON holds.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import inside
from splat2mesh.base.specs import clip, meant, vector
from splat2mesh.scene.color import luminance

from .asked import (
    BULB_M,
    DEFAULT_BRIGHTNESS,
    LONGEST_NAME,
    TEMPERATURES,
    TUBE_M,
    WHITE,
    AskedLamp,
    Brightness,
    blackbody,
    in_picture_units,
    parse_brightness,
    parse_color,
)
from .gltf_lights import read_glow
from .ies import read_profile
from .shapes import (
    MeshLamp,
    ProfileLamp,
    RectangleLamp,
    SphereLamp,
    SpotLamp,
    TubeLamp,
    checked_light,
    checked_size,
)

SHAPES: dict[str, Any] = {
    "sphere": SphereLamp,
    "spot": SpotLamp,
    "rectangle": RectangleLamp,
    "tube": TubeLamp,
    "mesh": MeshLamp,
    "profile": ProfileLamp,
}
"""Kind of a lamp -> its shape."""

FACING = "target", "normal", "up", "width", "height"
"""Fields of a rectangle in place of its edges."""

FILE_SETS = {
    "mesh": ("vertices", "faces", "two_sided", "radiance"),
    "profile": ("vertical_deg", "horizontal_deg", "table"),
}
"""Kind -> what its `file` sets."""

FIELDS = {
    kind: (*("file",) * (kind in FILE_SETS), *(each.name for each in fields(shape)), *FACING * (kind == "rectangle"))
    for kind, shape in SHAPES.items()
}
"""Kind -> its own fields."""

EVERY = ("color", "brightness", "name")
"""Fields that every lamp may have."""

SHORT = {"cutoff": "cutoff_deg", "beam": "beam_deg", "turn": "turn_deg", "to": "end"}
"""Word of the command line -> field."""

LIGHT = "radiance", "intensity"

USUAL_RADII_M = {"sphere": BULB_M, "tube": TUBE_M}

WARM = blackbody(TEMPERATURES["warm"])
"""The colour of a lamp without one."""


def asked_lamp(kind: str, given: Mapping[str, Any], folder: Path | None = None) -> AskedLamp:
    """The lamp that fields ask for.

    kind: a key of FIELDS. given: by the names in FIELDS, EVERY and SHORT, and `at`. folder: where `file` starts, which
    must then lie in it or below; without one it starts where the program runs. Raises InputError that names the field.
    """
    if kind not in FIELDS:
        raise InputError(f"{clip(kind)}: not a kind of lamp{meant(kind, FIELDS)}; expected one of {', '.join(FIELDS)}")
    values = _named(kind, given)
    asked = _made(kind, values, folder)
    return renamed(asked, values["name"]) if "name" in values else asked


def renamed(asked: AskedLamp, name: Any) -> AskedLamp:
    """The lamp under another name. Raises InputError for one that is no line of text."""
    text = name.strip() if isinstance(name, str) else ""
    if not text or not text.isprintable() or len(text) > LONGEST_NAME:
        raise InputError(f"name {clip(name)}: expected a line of up to {LONGEST_NAME} letters")
    return replace(asked, name=text)


def changed(asked: AskedLamp, values: Mapping[str, Any]) -> AskedLamp:
    """A lamp of a file with requested values instead of its own: color, brightness, name."""
    shape, color, brightness = asked.shape, asked.color, asked.brightness
    if "color" in values:
        color = parse_color(values["color"])
        if brightness.unit == "picture":  # which is a factor of shape and colour
            brightness = Brightness(brightness.value * float(luminance(asked.color)), "picture")
        if isinstance(shape, MeshLamp):  # its own colours become shades of that one
            shape = replace(shape, radiance=np.repeat(luminance(shape.radiance)[..., None], 3, axis=-1))
    if "brightness" in values:
        brightness = parse_brightness(values["brightness"])
    asked = replace(asked, shape=shape, brightness=brightness, color=color)
    return renamed(asked, values["name"]) if "name" in values else asked


def _named(kind: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields by their full names."""
    known, values = (*FIELDS[kind], *EVERY), dict[str, Any]()
    short = {word: name for word, name in SHORT.items() if name in known}
    if kind != "mesh":
        short["at"] = FIELDS[kind]["file" in FIELDS[kind]]
    for word, value in given.items():
        name = short.get(word, word)
        if name in LIGHT and name not in known:
            raise InputError(f"{name}: a {kind} has none; give its {LIGHT[name == LIGHT[0]]}")
        if name not in known:
            near = meant(word, [*known, *short])
            raise InputError(f"{clip(word)}: a {kind} has no such field{near}; it has {', '.join(known)}")
        if name in values:
            raise InputError(f"{name}: given twice")
        values[name] = value
    return values


def _made(kind: str, values: Mapping[str, Any], folder: Path | None) -> AskedLamp:
    """The lamp of fields by their full names, without its name."""
    own, by_file = _own(kind, values), FILE_SETS[kind] if "file" in values else ()
    _check_free(values, by_file, "the file already sets it")
    needed = [each.name for each in fields(SHAPES[kind]) if each.default is MISSING]
    _check_there(own, kind, [name for name in needed if name not in (*LIGHT, *by_file)])
    path = inside(folder, values["file"], folder) if folder and by_file else Path(str(values.get("file")))
    if by_file and kind == "mesh":
        return changed(read_glow(path), values)
    color, brightness = _light(values)
    if by_file:
        profile = read_profile(path)
        own |= {name: getattr(profile, name) for name in by_file}
        if not {"brightness", "intensity"} & values.keys():
            brightness = Brightness(profile.candela, "candela")
    formed = {name: _formed(name, value) for name, value in own.items()} | _lit(kind, values)
    return AskedLamp(
        SHAPES[kind](**formed), brightness, color, radius_in_metres="radius" in own and "radius" not in values
    )


def _own(kind: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """What the shape is made of beside its light: with a usual radius, and the sides of a rectangle."""
    own = {name: value for name, value in values.items() if name in FIELDS[kind] and name not in (*LIGHT, "file")}
    if kind in USUAL_RADII_M and not {"radius", "intensity"} & values.keys():
        own["radius"] = USUAL_RADII_M[kind]
    if kind == "rectangle":
        own = {name: value for name, value in own.items() if name not in FACING} | _sides(values)
    return own


def _lit(kind: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """The light of a shape before colour and brightness: white, as an intensity where it is no surface."""
    point = "intensity" in values or not (
        "radiance" in values or checked_size("radius", values.get("radius", 1.0), 0.0)
    )
    light = [name for name in LIGHT if name in FIELDS[kind]][-point]
    return {light: _formed(light, values[light]) if _of_faces(values) else WHITE}


def _check_there(values: Mapping[str, Any], kind: str, needed: Iterable[str]) -> None:
    for name in needed:
        if name not in values:
            raise InputError(f"{name}: missing; a {kind} needs {' and '.join(needed)}")


def _check_free(values: Mapping[str, Any], names: Iterable[str], problem: str) -> None:
    for name in names:
        if name in values:
            raise InputError(f"{name}: {problem}")


def _of_faces(values: Mapping[str, Any]) -> bool:
    """Whether each face has a radiance of its own."""
    light = values.get("radiance")
    return isinstance(light, list) and bool(light) and isinstance(light[0], list)


def _light(values: Mapping[str, Any]) -> tuple[Triple, Brightness]:
    """Requested colour and brightness; WARM where unspecified."""
    absolute = [name for name in LIGHT if name in values]
    if _of_faces(values):
        _check_free(values, ("brightness", "color"), "given with a radiance for each face; give one of them")
        return WHITE, Brightness(1.0, "picture")
    color = parse_color(values["color"]) if "color" in values else WARM
    if not absolute:
        return color, parse_brightness(values["brightness"]) if "brightness" in values else DEFAULT_BRIGHTNESS
    if len(absolute) == 2 or "brightness" in values:
        raise InputError(f"{absolute[0]}: give that or {'intensity' if len(absolute) == 2 else 'brightness'}")
    name, value = absolute[0], values[absolute[0]]
    parts = value.split(",") if isinstance(value, str) else value
    if not isinstance(parts, (list, tuple)) or len(parts) == 1:
        single: Any = parts[0] if isinstance(parts, (list, tuple)) else parts
        return color, Brightness(checked_size(name, single, least=0.0), "picture")
    if "color" in values:
        raise InputError(f"color: `{name}` {clip(value)} has one; give one number with it, or leave one out")
    return in_picture_units(checked_light(name, vector(name, value)))


def _sides(values: Mapping[str, Any]) -> dict[str, Any]:
    """Sides of a rectangle that faces its target or along its normal; the second one follows `up`, else y, else z."""
    if {"edge_u", "edge_v"} & values.keys():
        _check_free(values, FACING, "the edges already set it; give the edges, or width, height and target")
        return {}
    _check_there(values, "rectangle", ["center", "width", "height"])
    if ("target" in values) == ("normal" in values):
        raise InputError("target: missing; a rectangle needs a target or a normal")
    name = "target" if "target" in values else "normal"
    ahead = np.subtract(vector(name, values[name]), vector("center", values["center"]) if name == "target" else 0.0)
    length = float(np.linalg.norm(ahead))
    if not 0.0 < length < math.inf:
        raise InputError(f"`{name}` {clip(values[name])}: it gives the rectangle no direction")
    ahead = ahead / length
    up = np.array(vector("up", values.get("up", (0.0, 1.0, 0.0) if abs(ahead[1]) < 0.99 else (0.0, 0.0, 1.0))))
    upward = up - (up @ ahead) * ahead
    height = float(np.linalg.norm(upward))
    if not height > 1e-9 * float(np.linalg.norm(up)) or not height < math.inf:
        raise InputError(f"`up` {clip(values['up'])}: it is parallel to the direction that the rectangle faces")
    upward = upward / height
    sides = np.cross(upward, ahead), upward
    return {
        edge: (checked_size(size, values[size]) * side).tolist()
        for edge, size, side in zip(("edge_u", "edge_v"), ("width", "height"), sides, strict=True)
    }


def _formed(name: str, value: Any) -> Any:
    """The value of a field as its shape takes it."""
    if name in (*FILE_SETS["profile"], "vertices", "faces", "radiance"):
        return _array(name, value, np.int64 if name == "faces" else np.float64)
    if name != "two_sided":
        return value
    known = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
    if (found := known.get(str(value).lower())) is None:
        raise InputError(f"`{name}` {clip(value)}: expected yes or no")
    return found


def _array(name: str, value: Any, dtype: type) -> Any:
    if isinstance(value, (list, np.ndarray)):
        try:
            return np.array(value, dtype)
        except (TypeError, ValueError, OverflowError):
            pass
    raise InputError(f"`{name}` {clip(value)}: expected a list of numbers")
