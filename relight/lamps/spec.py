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

import re
from dataclasses import replace
from typing import Any

from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import quiet_numbers
from splat2mesh.base.specs import clip, parse_spec, plain, vector

from .asked import AskedLamp
from .fields import FIELDS, asked_lamp, changed, meant
from .files import LAMP_SUFFIXES, read_lamps
from .moving import shifted

OF_FILES = ("at", "color", "brightness", "name")
"""Words after a file: where its origin goes, and what its lamps have instead of their own."""


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
