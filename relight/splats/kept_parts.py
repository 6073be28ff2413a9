"""The parts of a capture that were made by hand, in the folder of its scene, and their names in a request.

`parts.json`: {"schema_version": 1, "parts": [{"name": ..., "file": ..., "splats": N, "light": {...}}, ...]}. A file is
a `.npy` beside it with a truth for each splat. A light of its own has the fields of `lit_part`, or is missing. A name
may be changed there.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from splat2mesh.base.arrays import Mask
from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import inside, read_json
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.strictjson import text_of

from .part_spec import AnyPart

NAME = "parts.json"
"""In the folder of a scene."""

SCHEMA_VERSION = 1


class KeptPart(NamedTuple):
    """file: the mask of a part. light: what its own light is, by the fields of `lit_part`; none without. entry: what
    NAME says of it."""

    file: Path
    light: Mapping[str, Any]
    entry: Mapping[str, Any]


def kept_parts(folder: str | os.PathLike[str]) -> dict[str, KeptPart]:
    """The parts of a scene folder, by name. Raises InputError for a damaged file."""
    path = Path(folder) / NAME
    return {
        entry["name"]: KeptPart(inside(folder, entry["file"], path), entry.get("light", {}), entry)
        for entry in _entries(folder)
    }


def next_name(folder: str | os.PathLike[str]) -> str:
    """The name that the next part of a scene folder gets."""
    taken = {entry["name"] for entry in _entries(folder)} | {Path(entry["file"]).stem for entry in _entries(folder)}
    return next(name for name in (f"part{number}" for number in range(1, len(taken) + 2)) if name not in taken)


def keep_part(folder: str | os.PathLike[str], part: Mask, light: Mapping[str, Any] | None = None) -> str:
    """Write a part, a truth for each splat, and its light into a scene folder; returns its name. Raises InputError for
    an empty part and a damaged file."""
    if not part.any():
        raise InputError("the part has no splats")
    name, entries = next_name(folder), _entries(folder)
    file = f"{name}.npy"
    with staged_file(Path(folder) / file) as staging:
        np.save(staging, part)
    own = {"light": dict(light)} if light else {}
    entries.append({"name": name, "file": file, "splats": int(part.sum()), **own})
    with staged_file(Path(folder) / NAME) as staging:
        staging.write_text(text_of({"schema_version": SCHEMA_VERSION, "parts": entries}, indent=1) + "\n", "utf-8")
    return name


def with_files(given: Sequence[AnyPart], folder: str | os.PathLike[str]) -> tuple[AnyPart, ...]:
    """Requested parts, of which names of parts of a scene folder are replaced by their masks."""
    if not any(isinstance(each, str) for each in given) or not (Path(folder) / NAME).is_file():
        return tuple(given)
    known = kept_parts(folder)
    return tuple(
        str(known[each].file) if isinstance(each, str) and each in known and not os.path.exists(each) else each
        for each in given
    )


def _entries(folder: str | os.PathLike[str]) -> list[dict[str, Any]]:
    path = Path(folder) / NAME
    if not path.is_file():
        return []
    found = read_json(path)
    entries = found.get("parts") if isinstance(found, dict) and found.get("schema_version") == SCHEMA_VERSION else None
    if not isinstance(entries, list) or not all(_sound(each) for each in entries):
        raise InputError(f"{path} is damaged: expected parts with a name, a file and a number of splats; delete it")
    return list(entries)


def _sound(entry: Any) -> bool:
    kinds = {"name": str, "file": str, "splats": int}
    sound = isinstance(entry, dict) and all(isinstance(entry.get(key), kind) for key, kind in kinds.items())
    return sound and isinstance(entry.get("light", {}), dict)
