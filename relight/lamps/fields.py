"""A lamp from its fields, by the names that `--lamp` and files of lamps share.

Values are texts, as a command line has them, or what JSON holds.
"""

import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import inside
from splat2mesh.base.specs import clip, vector
from splat2mesh.scene.color import luminance

from .asked import (
    BULB_M,
    DEFAULT_BRIGHTNESS,
    LONGEST_NAME,
    TUBE_M,
    AskedLamp,
    Brightness,
    in_picture_units,
    parse_brightness,
)
from .color import TEMPERATURES, WHITE, blackbody, parse_color
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

FIELDS = {
    "sphere": ("position", "radius", "radiance", "intensity"),
    "spot": ("position", "target", "cutoff_deg", "beam_deg", "radius", "intensity"),
    "rectangle": (
        *("center", "edge_u", "edge_v", "target", "normal", "up", "width", "height", "two_sided", "radiance"),
    ),
    "tube": ("start", "end", "radius", "radiance"),
    "mesh": ("file", "vertices", "faces", "two_sided", "radiance"),
    "profile": (
        *("file", "position", "target", "turn_deg", "radius", "intensity"),
        *("vertical_deg", "horizontal_deg", "table"),
    ),
}
"""Kind of a lamp -> its own fields."""

EVERY = ("color", "brightness", "name")
"""Fields that every lamp may have."""

SHORT = {"cutoff": "cutoff_deg", "beam": "beam_deg", "turn": "turn_deg", "to": "end"}
"""Word of the command line -> field."""

PLACE = {"sphere": "position", "spot": "position", "rectangle": "center", "tube": "start", "profile": "position"}
"""Kind -> where it is, which is also called `at`."""

WARM = blackbody(TEMPERATURES["warm"])
"""The colour of a lamp without one."""


def asked_lamp(kind: str, given: Mapping[str, Any], folder: Path | None = None) -> AskedLamp:
    """The lamp that fields ask for.

    kind: a key of FIELDS. given: by the names in FIELDS, EVERY and SHORT, and `at`. folder: where `file` starts, which
    must then lie in it or below; without one it starts where the program runs. Raises InputError that names the field.
    """
    if kind not in FIELDS:
        raise InputError(f"{clip(kind)}: not a kind of lamp{meant(kind, FIELDS)}; expected one of {', '.join(FIELDS)}")
    fields = _named(kind, given)
    asked = _MAKERS[kind](fields, folder)
    if "name" in fields:
        asked = renamed(asked, fields["name"])
    return asked


def renamed(asked: AskedLamp, name: Any) -> AskedLamp:
    """The lamp under another name. Raises InputError for one that is no line of text."""
    text = name.strip() if isinstance(name, str) else ""
    if not text or not text.isprintable() or len(text) > LONGEST_NAME:
        raise InputError(f"name {clip(name)}: expected a line of up to {LONGEST_NAME} letters")
    return AskedLamp(asked.shape, asked.brightness, asked.color, text, asked.radius_in_metres)


def meant(word: str, known: Iterable[str]) -> str:
    """A suggestion for an unknown word, as the end of a phrase."""
    near = difflib.get_close_matches(str(word).lower()[:40], list(known), 1)
    return f"; did you mean {near[0]}?" if near else ""


def _named(kind: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields by their full names."""
    known, fields = (*FIELDS[kind], *EVERY), {}
    short = {word: name for word, name in SHORT.items() if name in known}
    if kind in PLACE:
        short["at"] = PLACE[kind]
    for word, value in given.items():
        name = short.get(word, word)
        if name not in known:
            if name in ("radiance", "intensity"):
                other = "radiance" if name == "intensity" else "intensity"
                raise InputError(f"{name}: a {kind} has none; give its {other}")
            near = meant(word, [*known, *short])
            raise InputError(f"{clip(word)}: a {kind} has no such field{near}; it has {', '.join(known)}")
        if name in fields:
            raise InputError(f"{name}: given twice")
        fields[name] = value
    return fields


def _missing(fields: Mapping[str, Any], kind: str, *names: str) -> None:
    for name in names:
        if name not in fields:
            raise InputError(f"{name}: missing; a {kind} needs {' and '.join(names)}")


def _number(fields: Mapping[str, Any], name: str, otherwise: float) -> float:
    return checked_size(name, fields[name], least=0.0) if name in fields else otherwise


def _flag(fields: Mapping[str, Any], name: str) -> bool:
    value = fields.get(name, False)
    known = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
    found = value if isinstance(value, bool) else known.get(str(value).lower())
    if found is None:
        raise InputError(f"`{name}` {clip(value)}: expected yes or no")
    return found


def _light(fields: Mapping[str, Any], color: Triple = WARM) -> tuple[Triple, Brightness]:
    """Requested colour and brightness; `color` where unspecified."""
    absolute = [name for name in ("radiance", "intensity") if name in fields]
    if "color" in fields:
        color = parse_color(fields["color"])
    if not absolute:
        return color, parse_brightness(fields["brightness"]) if "brightness" in fields else DEFAULT_BRIGHTNESS
    if len(absolute) == 2 or "brightness" in fields:
        raise InputError(f"{absolute[0]}: give that or {'intensity' if len(absolute) == 2 else 'brightness'}")
    name, value = absolute[0], fields[absolute[0]]
    parts = value.split(",") if isinstance(value, str) else value
    if not isinstance(parts, (list, tuple)) or len(parts) == 1:
        single: Any = parts[0] if isinstance(parts, (list, tuple)) else parts
        return color, Brightness(checked_size(name, single, least=0.0), "picture")
    if "color" in fields:
        raise InputError(f"color: `{name}` {clip(value)} has one; give one number with it, or leave one out")
    return in_picture_units(checked_light(name, vector(name, value)))


def _sphere(fields: Mapping[str, Any], folder: Path | None) -> AskedLamp:
    _missing(fields, "sphere", "position")
    position = vector("position", fields["position"])
    color, brightness = _light(fields)
    sized = "radius" in fields
    radius = _number(fields, "radius", 0.0 if "intensity" in fields else BULB_M)
    if radius == 0.0 and "radiance" in fields:
        raise InputError("`radius` 0: a point has no radiance; give its intensity")
    if radius > 0.0 and "intensity" in fields:  # of a ball the same light as a radiance
        with np.errstate(over="ignore"):
            each = float(np.float64(brightness.value) / (math.pi * np.float64(radius) ** 2))
        brightness = Brightness(each, "picture")
    if radius > 0.0:
        unsized = not sized and "intensity" not in fields
        return AskedLamp(SphereLamp(position, radius, WHITE), brightness, color, radius_in_metres=unsized)
    return AskedLamp(SphereLamp(position, intensity=WHITE), brightness, color)


def _spot(fields: Mapping[str, Any], folder: Path | None) -> AskedLamp:
    _missing(fields, "spot", "position", "target")
    cutoff = checked_size("cutoff_deg", fields.get("cutoff_deg", 30.0))
    beam = _number(fields, "beam_deg", 0.75 * cutoff)
    position, target = (vector(name, fields[name]) for name in ("position", "target"))
    shape = SpotLamp(position, target, WHITE, cutoff, beam, _number(fields, "radius", 0.0))
    color, brightness = _light(fields)
    return AskedLamp(shape, brightness, color)


def _rectangle(fields: Mapping[str, Any], folder: Path | None) -> AskedLamp:
    _missing(fields, "rectangle", "center")
    center = vector("center", fields["center"])
    if "edge_u" in fields or "edge_v" in fields:
        _missing(fields, "rectangle", "center", "edge_u", "edge_v")
        doubled = [name for name in ("target", "normal", "up", "width", "height") if name in fields]
        if doubled:
            raise InputError(f"{doubled[0]}: the edges already set it; give the edges, or width, height and target")
        edge_u, edge_v = vector("edge_u", fields["edge_u"]), vector("edge_v", fields["edge_v"])
    else:
        _missing(fields, "rectangle", "center", "width", "height")
        edge_u, edge_v = _edges(fields, center)
    color, brightness = _light(fields)
    return AskedLamp(RectangleLamp(center, edge_u, edge_v, WHITE, _flag(fields, "two_sided")), brightness, color)


def _edges(fields: Mapping[str, Any], center: Triple) -> tuple[Triple, Triple]:
    """Sides of a rectangle that faces its target or along its normal; the second one follows `up`, else y, else z."""
    if ("target" in fields) == ("normal" in fields):
        raise InputError("target: missing; a rectangle needs a target or a normal")
    name = "target" if "target" in fields else "normal"
    ahead = np.subtract(vector(name, fields[name]), center if name == "target" else 0.0)
    length = float(np.linalg.norm(ahead))
    if not 0.0 < length < math.inf:
        raise InputError(f"`{name}` {clip(fields[name])}: it gives the rectangle no direction")
    ahead = ahead / length
    up = np.array([0.0, 1.0, 0.0] if abs(ahead[1]) < 0.99 else [0.0, 0.0, 1.0])
    if "up" in fields:
        up = np.array(vector("up", fields["up"]))
    upward = up - (up @ ahead) * ahead
    height = float(np.linalg.norm(upward))
    if not height > 1e-9 * float(np.linalg.norm(up)) or not height < math.inf:
        raise InputError(f"`up` {clip(fields['up'])}: it is parallel to the direction that the rectangle faces")
    upward = upward / height
    u = checked_size("width", fields["width"]) * np.cross(upward, ahead)
    v = checked_size("height", fields["height"]) * upward
    return (float(u[0]), float(u[1]), float(u[2])), (float(v[0]), float(v[1]), float(v[2]))


def _tube(fields: Mapping[str, Any], folder: Path | None) -> AskedLamp:
    _missing(fields, "tube", "start", "end")
    start, end = (vector(name, fields[name]) for name in ("start", "end"))
    shape = TubeLamp(start, end, checked_size("radius", fields.get("radius", TUBE_M)), WHITE)
    color, brightness = _light(fields)
    return AskedLamp(shape, brightness, color, radius_in_metres="radius" not in fields)


def _mesh(fields: Mapping[str, Any], folder: Path | None) -> AskedLamp:
    if "file" in fields:
        doubled = [name for name in ("vertices", "faces", "two_sided", "radiance") if name in fields]
        if doubled:
            raise InputError(f"{doubled[0]}: the file already sets it")
        return changed(read_glow(_file(fields, folder)), fields)
    _missing(fields, "mesh", "vertices", "faces")
    radiance = fields.get("radiance")
    shape = MeshLamp(
        _array("vertices", fields["vertices"], np.float64),
        _array("faces", fields["faces"], np.int64),
        np.array(WHITE),
        _flag(fields, "two_sided"),
    )
    if isinstance(radiance, list) and radiance and isinstance(radiance[0], list):
        if "brightness" in fields or "color" in fields:
            raise InputError("radiance: given for each face, together with a colour or a brightness; give one of them")
        shape = MeshLamp(shape.vertices, shape.faces, _array("radiance", radiance, np.float64), shape.two_sided)
        return AskedLamp(shape, Brightness(1.0, "picture"))
    color, brightness = _light(fields)
    return AskedLamp(shape, brightness, color)


def _profile(fields: Mapping[str, Any], folder: Path | None) -> AskedLamp:
    _missing(fields, "profile", "position", "target")
    position, target = (vector(name, fields[name]) for name in ("position", "target"))
    tables = ("vertical_deg", "horizontal_deg", "table")
    color, brightness = _light(fields)
    if "file" in fields:
        doubled = [name for name in tables if name in fields]
        if doubled:
            raise InputError(f"{doubled[0]}: the file already sets it")
        found = read_profile(_file(fields, folder))
        vertical, horizontal, table = found.vertical_deg, found.horizontal_deg, found.table
        if not any(name in fields for name in ("brightness", "intensity")):
            brightness = Brightness(found.candela, "candela")
    else:
        _missing(fields, "profile", "position", "target", *tables)
        vertical, horizontal, table = (_array(name, fields[name], np.float64) for name in tables)
        if vertical.ndim != 1 or horizontal.ndim != 1:
            raise InputError("`vertical_deg`, `horizontal_deg`: expected a list of angles each")
    turn = vector("turn_deg", [fields.get("turn_deg", 0.0)] * 3)[0]
    radius = _number(fields, "radius", 0.0)
    shape = ProfileLamp(position, target, WHITE, vertical, horizontal, table, turn, radius)
    return AskedLamp(shape, brightness, color)


def changed(asked: AskedLamp, fields: Mapping[str, Any]) -> AskedLamp:
    """A lamp of a file with requested values instead of its own: color, brightness, name."""
    shape, color, brightness = asked.shape, asked.color, asked.brightness
    if "color" in fields:
        color = parse_color(fields["color"])
        if brightness.unit == "picture":  # which is a factor of shape and colour
            brightness = Brightness(brightness.value * float(luminance(asked.color)), "picture")
        if isinstance(shape, MeshLamp):  # its own colours become shades of that one
            grey = np.repeat(luminance(shape.radiance)[..., None], 3, axis=-1)
            shape = MeshLamp(shape.vertices, shape.faces, grey, shape.two_sided)
    if "brightness" in fields:
        brightness = parse_brightness(fields["brightness"])
    asked = AskedLamp(shape, brightness, color, asked.name, asked.radius_in_metres)
    return renamed(asked, fields["name"]) if "name" in fields else asked


def _array(name: str, value: Any, dtype: type) -> Any:
    found: Any = None
    try:
        found = np.array(value, dtype) if isinstance(value, list) else None
    except (TypeError, ValueError, OverflowError):
        pass
    if found is None:
        raise InputError(f"`{name}` {clip(value)}: expected a list of numbers")
    return found


def _file(fields: Mapping[str, Any], folder: Path | None) -> Path:
    return Path(str(fields["file"])) if folder is None else inside(folder, fields["file"], folder)


_MAKERS: dict[str, Callable[[Mapping[str, Any], Path | None], AskedLamp]] = {
    "sphere": _sphere,
    "spot": _spot,
    "rectangle": _rectangle,
    "tube": _tube,
    "mesh": _mesh,
    "profile": _profile,
}
