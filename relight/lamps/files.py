"""Files of lamps: JSON, glTF. An IES profile is only a part of a lamp, which also needs a position.

JSON is a list of lamps, or {"lamps": [...]}: {"type": "sphere", "position": [1.5, 1.5, -1.5], "radius": 0.1,
"radiance": [70, 55, 38]}. `type` is a key of `fields.FIELDS`, whose fields it may have; lengths as in the splat.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import MOST_NODES
from splat2mesh.base.inputs import file_size, quiet_numbers, read_json, reading
from splat2mesh.base.specs import clip, plain

from .asked import AskedLamp
from .fields import asked_lamp
from .gltf_lights import read_gltf_lamps


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
    for number, fields in enumerate(content, 1):
        try:
            if "type" not in fields:
                raise InputError('type: missing; such as "type": "sphere"')
            with quiet_numbers():
                given = {name: value for name, value in fields.items() if name != "type"}
                lamps.append(asked_lamp(str(fields["type"]), given, Path(path).parent))
        except InputError as error:
            raise InputError(f"{path}: lamp {number}: {plain(error)}") from None
    return lamps


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise InputError(f"{clip(next(name for name in names if names.count(name) > 1))}: given twice")
    return found


READERS: dict[str, Callable[[Path], list[AskedLamp]]] = {
    ".json": read_json_lamps,
    ".glb": read_gltf_lamps,
    ".gltf": read_gltf_lamps,
}

LAMP_SUFFIXES = (*READERS, ".ies")
