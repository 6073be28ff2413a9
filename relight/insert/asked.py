"""A request to insert an object: its file, position, heading and size, and the surface that it stands on.

    statue.glb at=1.55,0,-.6
    statue.glb at=1.55,0,-.6 turn=30 scale=.5 on=floor
    layout.json

The words are those of `splat2mesh.base.specs`.
"""

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import inside, read_json
from splat2mesh.base.specs import clip, parse_spec, plain, vector
from splat2mesh.layout import LARGEST
from splat2mesh.scene.mesh import Mesh

from ..lamps.shapes import checked_size

WORDS = ("at", "turn", "scale", "on", "albedo")
"""Keys of the name=value words after a file."""

SUPPORTS = ("floor",)
"""The surfaces that an object may be dropped on."""


@dataclass(frozen=True, eq=False)
class AskedInsert:
    """An object to insert.

    source: a mesh file, a splat, or a Mesh whose y points up. at: the position of its origin, in the frame of the splat
    that the scene was made from. turn_deg: about the vertical, counter-clockwise from above. scale: units of the splat
    per unit of the object; None for 1, or less if the object would then exceed the scene. on: "floor" drops or lifts
    it onto the surface below. albedo: linear, multiplies its own colours; None keeps them, or takes grey if it has
    none.
    """

    source: "str | os.PathLike[str] | Mesh"
    at: Triple = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0
    scale: float | None = None
    on: str | None = None
    albedo: Triple | None = None

    def __post_init__(self) -> None:
        set_to = object.__setattr__
        set_to(self, "at", vector("at", self.at))
        set_to(self, "turn_deg", checked_size("turn", self.turn_deg, -math.inf))
        if self.scale is not None:
            set_to(self, "scale", checked_size("scale", self.scale, most=LARGEST))
        if self.on is not None and self.on not in SUPPORTS:
            raise InputError(f"on {clip(self.on)}: expected {' or '.join(SUPPORTS)}")
        if self.albedo is not None:
            set_to(self, "albedo", _albedo(self.albedo))

    @property
    def name(self) -> str:
        """Its name."""
        return "mesh" if isinstance(self.source, Mesh) else Path(self.source).name


def asked_inserts(inserted: Iterable[Any]) -> list[AskedInsert]:
    """Return the requested objects, in order.

    inserted: each an AskedInsert, a Mesh, a path, or a text as above. Raises InputError, in one line, for anything
    else.
    """
    found: list[AskedInsert] = []
    for each in inserted:
        if isinstance(each, AskedInsert):
            found.append(each)
        elif isinstance(each, Mesh):
            found.append(AskedInsert(each))
        elif isinstance(each, (str, os.PathLike)):
            found += _parsed(os.fspath(each))
        else:
            raise InputError(f"`inserted` {clip(each)}: expected a file, a text, a Mesh or an AskedInsert")
    return found


def described(asked: AskedInsert) -> dict[str, Any]:
    """Position and pose of an inserted object, JSON-clean; its file describes the object."""
    place = {"at": list(asked.at), "turn_deg": asked.turn_deg, "scale": asked.scale, "on": asked.on}
    return {"name": asked.name, **place, "albedo": asked.albedo and list(asked.albedo)}


def _parsed(text: str) -> list[AskedInsert]:
    try:
        head, given = parse_spec(text)
        if not head:
            raise InputError("expected a file first, such as statue.glb at=1.5,0,-.6")
        if not os.path.lexists(head):
            raise InputError("no such file")
        layout = _layout(Path(head)) if head.lower().endswith(".json") else None
        if layout is None:
            return [_made(head, given)]
        if given:
            raise InputError(f"{next(iter(given))}: a layout sets the positions of its objects")
        return layout
    except InputError as error:
        raise InputError(f"`inserted` {clip(text)}: {plain(error)}") from None


def _layout(path: Path) -> list[AskedInsert] | None:
    """The objects of a layout: a list, or {"objects": [...]}, of {"file", "at", ...}. None for JSON of another kind,
    such as a splat's."""
    content = read_json(path)
    if isinstance(content, dict):
        if "objects" not in content:
            return None
        content = content["objects"]
    if not isinstance(content, list) or not content:
        raise InputError("expected a list of objects, each with a file and its position, at")
    found = []
    for number, each in enumerate(content, 1):
        if not isinstance(each, dict) or not isinstance(each.get("file"), str):
            raise InputError(f"object {number}: expected a file, as text")
        fields = {name: value for name, value in each.items() if name != "file"}
        file = inside(path.parent, each["file"], path)
        if not file.exists():
            raise InputError(f"object {number}: {clip(each['file'])}: no such file beside the layout")
        found.append(_made(str(file), fields))
    return found


def _made(file: str, given: Mapping[str, Any]) -> AskedInsert:
    for word in given:
        if word not in WORDS:
            raise InputError(f"{clip(word)}: expected some of {', '.join(WORDS)}")
    fields = {{"turn": "turn_deg"}.get(word, word): value for word, value in given.items()}
    if "at" not in fields:
        raise InputError("at: missing; give its position, such as at=1.5,0,-.6")
    return AskedInsert(file, **fields)


def _albedo(value: Any) -> Triple:
    parts = value.split(",") if isinstance(value, str) else value
    parts = [parts] * 3 if isinstance(parts, (int, float)) else list(parts) * (3 if len(parts) == 1 else 1)
    red, green, blue = vector("albedo", parts)
    if not all(0.0 <= each <= 1.0 for each in (red, green, blue)):
        raise InputError(f"albedo {clip(value)}: expected one or three linear values from 0 to 1")
    return red, green, blue
