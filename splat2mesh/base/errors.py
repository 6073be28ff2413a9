"""Errors and warnings about input, as types that every part of the toolkit shares.

A message names a setting of the library in backquotes, as Python writes it: "`max_chunk_vertices` 2: a chunk needs at
least 3". A command line that has an option of that name writes it in its place: "--max-chunk-vertices 2: ...". So the
library knows no option, and the message uses the name that the reader typed.
"""

import re
from collections.abc import Mapping

MOST_NAMED = 3
"""Things of one kind that a message names."""

_SETTING = re.compile(r"`(\w+)`")


class InputError(ValueError):
    """Input that cannot be used. The message says what was expected, what was found and the next step. The command line
    prints it as one line and exits with code 2."""


class UnfinishedError(Exception):
    """Work that failed in part, where the rest is done and kept. The message names the parts and how to go on. The
    command line prints it as one line and exits with code 1."""


class DataWarning(UserWarning):
    """Part of the input was dropped or repaired; the message carries the count."""


def with_options(message: str, options: Mapping[str, str]) -> str:
    """A message in which settings that have an option are written as that option. options: setting -> option, such as
    {"budget_s": "--budget"}. Other words in backquotes stay as they are."""
    return _SETTING.sub(lambda match: options.get(match[1], match[0]), message)
