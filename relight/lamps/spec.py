"""Lamps as texts and files. A text is a position, a kind with a position, or a file, then words such as color=3000K.

    1.5,1.5,-1.5                                               a warm bulb, +2 EV
    1.5,1.5,-1.5 radius=.1 color=3000K brightness=+1EV
    spot:0,2,0 target=0,0,0 cutoff=25 beam=20
    rectangle:0,2.4,0 target=0,0,0 width=1 height=.5
    tube:-1,2.4,0 to=1,2.4,0
    profile.ies at=0,2,0 target=0,0,0
    sign.glb brightness=+3EV
    lamps.json

The words are those of `splat2mesh.base.specs`. JSON is a list of lamps, or {"lamps": [...]}: {"type": "sphere",
"position": [1.5, 1.5, -1.5], "radius": 0.1, "radiance": [70, 55, 38]}. `type` is a key of `fields.FIELDS`, whose fields
it may have; lengths as in the splat. An IES profile is only a part of a lamp, which also needs a position.
"""

import json
import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import MOST_NODES
from splat2mesh.base.inputs import file_size, quiet_numbers, read_json, reading
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.specs import clip, meant, parse_spec, plain, vector

from .asked import BULB_M, NAMES, TEMPERATURES, TUBE_M, AskedLamp, Brightness, LampScale, parse_color, resolve
from .fields import FIELDS, asked_lamp, changed
from .gltf_lights import read_gltf_lamps
from .photometry import times
from .shapes import Lamp, MeshLamp, TubeLamp, shifted

OF_FILES = ("at", "color", "brightness", "name")
"""Words after a file: where its origin goes, and what its lamps have instead of their own."""


def asked_lamps(placed: Iterable[Any]) -> list[AskedLamp]:
    """Return the requested lamps, in order: a shape, whose light is in units of the picture, an AskedLamp, a text as of
    `parse_lamps`, or the name of a file. Raises InputError for anything else, and for what makes no sense."""
    found: list[AskedLamp] = []
    for each in placed:
        if isinstance(each, AskedLamp):
            found.append(each)
        elif isinstance(each, get_args(Lamp)):
            found.append(AskedLamp(each, Brightness(1.0, "picture")))
        elif isinstance(each, (str, os.PathLike)):
            found += parse_lamps(os.fspath(each))
        else:
            raise InputError(f"`placed` {each!r}: expected a lamp, a text or a file of lamps")
    return found


def parse_lamps(text: str) -> list[AskedLamp]:
    """The lamps that a text asks for: one, or those of a file. Raises InputError, in one line, for anything else."""
    try:
        with quiet_numbers():
            return _parsed(text)
    except InputError as error:
        raise InputError(f"`placed` {clip(text)}: {plain(error)}") from None


def _parsed(text: str) -> list[AskedLamp]:
    head, given = parse_spec(text)
    if not head:
        return [asked_lamp("sphere", given)]
    if head.lower().endswith(".ies"):
        return [asked_lamp("profile", _with("file", head, given))]
    if head.lower().endswith(LAMP_SUFFIXES):
        return _of_file(head, given)
    kind, colon, place = head.rpartition(":")
    if not colon:
        if not re.match(r"[-+.\d]", head):
            expected = f"x,y,z, or {', '.join(FIELDS)} before :x,y,z, or a file ({' '.join(LAMP_SUFFIXES)})"
            raise InputError(f"{clip(head)}: expected {expected}{meant(head.partition(' ')[0], FIELDS)}")
        kind = "sphere"
    if kind in ("mesh", "profile"):
        raise InputError(f"{kind}: give its file, such as {'sign.glb' if kind == 'mesh' else 'x.ies at=x,y,z'}")
    if kind not in FIELDS:
        raise InputError(f"{clip(kind)}: not a kind of lamp{meant(kind, FIELDS)}; expected one of {', '.join(FIELDS)}")
    return [asked_lamp(kind, _with("at", place, given))]


def _with(name: str, value: str, given: dict[str, Any]) -> dict[str, Any]:
    if name in given:
        raise InputError(f"{name}: given twice")
    return {name: value, **given}


def _of_file(path: str, given: dict[str, Any]) -> list[AskedLamp]:
    for word in given:
        if word not in OF_FILES:
            raise InputError(
                f"{clip(word)}: not a field of lamps from files{meant(word, OF_FILES)}; expected {', '.join(OF_FILES)}"
            )
    lamps = [changed(asked, given) for asked in read_lamps(path)]
    if "at" in given:
        by = vector("at", given["at"])
        lamps = [replace(asked, shape=shifted(asked.shape, by)) for asked in lamps]
    return lamps


def in_brief(shape: Lamp) -> str:
    """Return the kind of a lamp and where it is: "sphere at 1.5,1.5,-1.5"."""
    kind = type(shape).__name__.removesuffix("Lamp").lower()
    if isinstance(shape, MeshLamp):
        return f"{kind} of {len(shape.faces)} faces at {_place(shape.vertices.mean(axis=0))}"
    names = ("position", "center", "start")
    return f"{kind} at {_place(next(getattr(shape, name) for name in names if hasattr(shape, name)))}"


def _place(point: Iterable[float]) -> str:
    return ",".join(f"{value:.3g}" for value in point)


def read_lamps(path: str | os.PathLike[str]) -> list[AskedLamp]:
    """The lamps of a file, at least one, as they stand there.

    path: ends in one of LAMP_SUFFIXES. Raises InputError for a file that is missing, of another kind, broken, or
    without lamps, and for an IES profile. What is no lamp but a sun or a sky is counted by a DataWarning.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".ies":
        raise InputError(f"{path}: a profile has no position; write: {path.name} at=x,y,z target=x,y,z")
    if suffix not in READERS:
        raise InputError(f"{path}: not a file of lamps; expected one of {' '.join(LAMP_SUFFIXES)}")
    file_size(path, "file of lamps")
    with reading(path):
        return READERS[suffix](path)


def read_json_lamps(path: str | os.PathLike[str]) -> list[AskedLamp]:
    """The lamps of a JSON file; a `file` that one names lies in its folder or below. Raises InputError."""
    try:
        content = read_json(path, object_pairs_hook=_once)
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    if isinstance(content, dict):
        others = [name for name in content if name not in ("lamps", "about")]
        if others and "lamps" in content:
            raise InputError(f'{path}: {clip(others[0])}: expected nothing beside "lamps" but "about"')
        content = content.get("lamps")
    if not isinstance(content, list) or not all(isinstance(each, dict) for each in content):
        raise InputError(f'{path}: expected a list of lamps, or {{"lamps": [...]}}')
    if not 0 < len(content) <= MOST_NODES:
        raise InputError(f"{path}: has {len(content):,} lamps, expected 1 to {MOST_NODES:,}")
    lamps = []
    for number, each in enumerate(content, 1):
        try:
            if "type" not in each:
                raise InputError('type: missing; such as "type": "sphere"')
            with quiet_numbers():
                given = {name: value for name, value in each.items() if name != "type"}
                lamps.append(asked_lamp(str(each["type"]), given, Path(path).parent))
        except InputError as error:
            raise InputError(f"{path}: lamp {number}: {plain(error)}") from None
    return lamps


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise InputError(f"{clip(next(name for name in names if names.count(name) > 1))}: given twice")
    return found


def write_lamps(
    path: str | os.PathLike[str], lamps: Sequence[AskedLamp], scale: LampScale | None = None, about: str = ""
) -> None:
    """Write lamps as JSON; `read_json_lamps` gives the same ones.

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


_SUFFIXES = {"EV": "EV", "lumen": "lm", "candela": "cd"}

READERS: dict[str, Callable[[Path], list[AskedLamp]]] = {
    ".json": read_json_lamps,
    ".glb": read_gltf_lamps,
    ".gltf": read_gltf_lamps,
}

LAMP_SUFFIXES = (*READERS, ".ies")
