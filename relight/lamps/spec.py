"""The text of `--lamp`: a position, a kind with a position, or a file, then words such as color=3000K.

    1.5,1.5,-1.5                                               a warm bulb, +2 EV
    1.5,1.5,-1.5 radius=.1 color=3000K brightness=+1EV
    spot:0,2,0 target=0,0,0 cutoff=25 beam=20
    rectangle:0,2.4,0 target=0,0,0 width=1 height=.5
    tube:-1,2.4,0 to=1,2.4,0
    profile.ies at=0,2,0 target=0,0,0
    sign.glb brightness=+3EV
    lamps.json

The words are those of `splat2mesh.base.specs`.
"""

import os
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, get_args

from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import quiet_numbers
from splat2mesh.base.specs import clip, meant, parse_spec, plain, vector

from .asked import AskedLamp, Brightness
from .fields import FIELDS, asked_lamp, changed
from .files import LAMP_SUFFIXES, read_lamps
from .shapes import Lamp, MeshLamp, shifted

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
