"""The forms in which a light may be given, as an Environment."""

import os

from . import CAPTURED
from .captured import CapturedLight
from .daylight import DaylightRequest
from .environment import Environment


def light_of(source: Environment | DaylightRequest | str | os.PathLike[str]) -> Environment:
    """Return the Environment itself, or what is read of a file, made by name, or the sky of a date.

    Raises InputError for what cannot be read.
    """
    if isinstance(source, Environment):
        return source
    if isinstance(source, DaylightRequest):
        return source.environment()
    return CapturedLight() if source == CAPTURED else Environment.load(source)
