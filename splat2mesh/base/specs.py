"""The text of an option that describes one thing: a head, such as a file or a position, then name=value words.

A value ends where the next word with a = begins, so paths and names may have spaces.
"""

import difflib
import math
import re
from collections.abc import Iterable
from typing import Any

from .errors import InputError

LONGEST_SPEC = 4096

_WORD = re.compile(r"(?<!\s)\s+(?=\w+\s*=)")
_KEY = re.compile(r"(\w+)\s*=\s*(.*)", re.DOTALL)


def parse_spec(text: str) -> tuple[str, dict[str, Any]]:
    """The head of a text, "" where it begins with a word, and the words by name. Raises InputError for other texts."""
    if len(text) > LONGEST_SPEC:
        raise InputError(f"{len(text)} letters, expected at most {LONGEST_SPEC}")
    words = _WORD.split(text.strip())
    head = "" if _KEY.fullmatch(words[0]) else words.pop(0)
    given: dict[str, Any] = {}
    for word in words:
        name, value = re.split(r"\s*=\s*", word, maxsplit=1)
        if name in given:
            raise InputError(f"{clip(name)}: given twice")
        given[name] = value
    return head, given


def clip(value: Any) -> str:
    """A value in a message: one line, not long."""
    words = " ".join(str(value).split())
    return words if len(words) <= 60 else words[:57] + "..."


def meant(word: str, known: Iterable[str]) -> str:
    """A suggestion for an unknown word, as the end of a phrase."""
    near = difflib.get_close_matches(str(word).lower()[:40], list(known), 1)
    return f"; did you mean {near[0]}?" if near else ""


def vector(name: str, value: Any) -> tuple[float, float, float]:
    """Three finite numbers, of a sequence or of a text with commas. Raises InputError that names them."""
    try:
        x, y, z = (float(each) for each in (value.split(",") if isinstance(value, str) else value))
    except (TypeError, ValueError):
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise InputError(f"`{name}` {clip(value)}: expected three numbers, such as 1.5,0,-.6")
    return x, y, z


def plain(error: InputError) -> str:
    """The text of an error in one line, in which no field is read as an option of the command line."""
    return " ".join(str(error).split()).replace("`", "")
