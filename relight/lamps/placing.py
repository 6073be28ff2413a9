"""What may be given as a lamp: a shape, a lamp as asked for, a text, a file."""

import os
from collections.abc import Iterable
from typing import Any, get_args

from splat2mesh.base.errors import InputError

from .asked import AskedLamp, Brightness
from .shapes import Lamp


def asked_lamps(placed: Iterable[Any]) -> list[AskedLamp]:
    """Return the lamps that are asked for, in order.

    Parameters
    ----------
    placed : iterable of Lamp, AskedLamp, str or path
        A shape has its light in units of the picture. A text is as of `spec.parse_lamps`, or the name of a file.

    Raises
    ------
    InputError
        For anything else, and for files and texts that make no sense.
    """
    found: list[AskedLamp] = []
    for each in placed:
        if isinstance(each, AskedLamp):
            found.append(each)
        elif isinstance(each, get_args(Lamp)):
            found.append(AskedLamp(each, Brightness(1.0, "picture")))
        elif isinstance(each, (str, os.PathLike)):
            from .spec import parse_lamps

            found += parse_lamps(os.fspath(each))
        else:
            raise InputError(f"`placed` {each!r}: expected a lamp, a text or a file of lamps")
    return found
