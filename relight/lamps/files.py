"""Files of lamps, read and written: JSON, glTF. An IES profile is only a part of a lamp, which also needs a position.

JSON is a list of lamps, or {"lamps": [...]}: {"type": "sphere", "position": [1.5, 1.5, -1.5], "radius": 0.1,
"radiance": [70, 55, 38]}. `type` is a key of `fields.FIELDS`, whose fields it may have; lengths as in the splat.
"""

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import MOST_NODES
from splat2mesh.base.inputs import file_size, quiet_numbers, read_json, reading
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.specs import clip, plain

from .asked import BULB_M, NAMES, TEMPERATURES, TUBE_M, AskedLamp, Brightness, LampScale, parse_color, resolve
from .fields import asked_lamp
from .gltf_lights import read_gltf_lamps
from .photometry import times
from .shapes import MeshLamp, TubeLamp


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
