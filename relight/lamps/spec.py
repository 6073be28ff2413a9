"""The text of `--lamp`: a position, a kind with a position, or a file, then words such as color=3000K.

    1.5,1.5,-1.5                                               a warm bulb, +2 EV
    1.5,1.5,-1.5 radius=.1 color=3000K brightness=+1EV
    spot:0,2,0 target=0,0,0 cutoff=25 beam=20
    rectangle:0,2.4,0 target=0,0,0 width=1 height=.5
    tube:-1,2.4,0 to=1,2.4,0
    profile.ies at=0,2,0 target=0,0,0
    sign.glb brightness=+3EV
    lamps.json

A value ends where the next word with a = begins, so that paths and names may have spaces.
"""

import re
from dataclasses import replace
from typing import Any

from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import quiet_numbers

from .asked import AskedLamp, moved
from .fields import FIELDS, asked_lamp, changed, clip, meant, plain, vector
from .files import LAMP_SUFFIXES, read_lamps

LONGEST_SPEC = 4096

OF_FILES = ("at", "color", "brightness", "name")
"""Words after a file: where its origin goes, and what its lamps have instead of their own."""

_WORD = re.compile(r"(?<!\s)\s+(?=\w+\s*=)")
_KEY = re.compile(r"(\w+)\s*=\s*(.*)", re.DOTALL)


def parse_lamps(text: str) -> list[AskedLamp]:
    """The lamps that a text asks for: one, or those of a file. Raises InputError, in one line, for anything else."""
    if len(text) > LONGEST_SPEC:
        raise InputError(f"`placed` {clip(text)}: {len(text)} letters, expected at most {LONGEST_SPEC}")
    try:
        with quiet_numbers():
            return _parsed(text)
    except InputError as error:
        raise InputError(f"`placed` {clip(text)}: {plain(error)}") from None


def _parsed(text: str) -> list[AskedLamp]:
    words = _WORD.split(text.strip())
    head = "" if _KEY.fullmatch(words[0]) else words.pop(0)
    given: dict[str, Any] = {}
    for word in words:
        match = _KEY.fullmatch(word)
        if match is None:  # unreachable by the split, and no reason to trust that
            raise InputError(f"{clip(word)}: expected name=value")
        if match[1] in given:
            raise InputError(f"{clip(match[1])}: given twice")
        given[match[1]] = match[2]
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
        lamps = [replace(asked, shape=moved(asked.shape, by)) for asked in lamps]
    return lamps
