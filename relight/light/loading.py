"""The forms in which a light may be given, as an Environment."""

import os

import numpy as np

from . import CAPTURED
from .daylight import DaylightRequest
from .environment import Environment


class CapturedLight(Environment):
    """Light as it was captured: no environment at all, so that nothing of it can be looked up, turned or scaled."""

    def __init__(self) -> None:
        super().__init__(np.zeros((2, 4, 3), np.float32), CAPTURED)


def light_of(source: Environment | DaylightRequest | str | os.PathLike[str]) -> Environment:
    """Return the Environment itself, or what is read of a file, made by name, or the sky of a date.

    Raises InputError for what cannot be read.
    """
    if isinstance(source, Environment):
        return source
    if isinstance(source, DaylightRequest):
        return source.environment()
    return CapturedLight() if source == CAPTURED else Environment.load(source)
