"""The forms in which a lamp may be given: a shape, a request, a text, a file."""

import os
from collections.abc import Iterable
from typing import Any, get_args

from splat2mesh.base.errors import InputError

from .asked import AskedLamp, Brightness
from .shapes import Lamp, MeshLamp
from .spec import parse_lamps


def asked_lamps(placed: Iterable[Any]) -> list[AskedLamp]:
    """Return the requested lamps, in order: a shape, whose light is in units of the picture, an AskedLamp, a text as of
    `spec.parse_lamps`, or the name of a file. Raises InputError for anything else, and for what makes no sense."""
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


def in_brief(shape: Lamp) -> str:
    """Return the kind of a lamp and where it is: "sphere at 1.5,1.5,-1.5"."""
    kind = type(shape).__name__.removesuffix("Lamp").lower()
    if isinstance(shape, MeshLamp):
        return f"{kind} of {len(shape.faces)} faces at {_place(shape.vertices.mean(axis=0))}"
    names = ("position", "center", "start")
    return f"{kind} at {_place(next(getattr(shape, name) for name in names if hasattr(shape, name)))}"


def _place(point: Iterable[float]) -> str:
    return ",".join(f"{value:.3g}" for value in point)
