"""Forgiving command lines: negative values, commas, near misses. Imports nothing heavy."""

import argparse
import math
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from .errors import InputError
from .specs import meant

_VALUE = re.compile(r"-[\d.]|-[xyz]$")
"""Values that look like options: a negative number, or an axis."""


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line, with what may have been meant.

    signed: options whose value may begin with a minus sign, as in `--up -y` or `--rotate -30:30:10`.
    signed_words: the same of options of several words, as in `--lamp -1,2,3 radius=.1`.
    """

    signed: tuple[str, ...] = ()
    signed_words: tuple[str, ...] = ()

    _given: Sequence[str] = ()

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Return the parsed command line; invalid words end the process with one line."""
        self._given = joined(sys.argv[1:] if args is None else args, self.signed, self.signed_words)
        return super().parse_args(self._given, namespace)

    def error(self, message: str) -> NoReturn:
        """End the process with exit code 2 and a message."""
        unknown = re.match(r"unrecognized arguments: (\S+)", message)
        if unknown and unknown[1].startswith("--"):
            options = [text for action in self._actions for text in action.option_strings]
            message = f"{unknown[1]}: no such option" + meant(unknown[1], options)
        elif unknown:
            message = self._second_value(unknown[1]) or message
        self.exit(2, f"error: {message}; {self.prog} --help shows all\n")

    def _second_value(self, word: str) -> str:
        """The message on a surplus word after an option of one value; empty without one."""
        at = self._given.index(word) if word in self._given else 0
        if at < 2:
            return ""
        for action in self._actions:
            if self._given[at - 2] in action.option_strings and action.nargs is None:
                option, value = self._given[at - 2 : at]
                several = f": give {option} before each" if isinstance(action, argparse._AppendAction) else ""
                return f"{option} takes one value, found {value} and {word}{several}"
        return ""


def joined(arguments: Sequence[str], signed: Iterable[str], words: Iterable[str] = ()) -> list[str]:
    """Arguments in which a value that begins with a minus is joined to its signed option: --up -y -> --up=-y. words:
    options of several words; the first gets a space before it, which distinguishes it from an option."""
    result: list[str] = []
    names, several = set(signed), set(words)
    for argument in arguments:
        if result and result[-1] in names and _VALUE.match(argument):
            result[-1] = f"{result[-1]}={argument}"
        elif result and result[-1] in several and _VALUE.match(argument):
            result.append(f" {argument}")
        else:
            result.append(argument)
    return result


def share(option: str, text: str | None) -> float | None:
    """A share of 1: "0.01" or "1%" -> 0.01. Raises InputError for anything else, and for 1 or more."""
    if text is None:
        return None
    percent = text.strip().endswith("%")
    try:
        value = float(text.strip().removesuffix("%")) / (100.0 if percent else 1.0)
    except ValueError:
        raise InputError(f"{option} {text}: expected a share such as 0.02, or 2%") from None
    if value >= 1.0:
        meant = "" if percent else f"; did you mean {value:g}%?"
        raise InputError(f"{option} {text}: expected a share below 1, such as 0.02 or 2%{meant}")
    return value


def count(option: str, text: str) -> int:
    """A whole number, also as 20k or 1.5M. Raises InputError for anything else."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([kKmM]?)", text.strip())
    number = float(match[1]) * {"": 1, "k": 1e3, "m": 1e6}[match[2].lower()] if match else math.nan
    if not number.is_integer():
        raise InputError(f"{option} {text}: expected a whole number, such as 20000, 20k or 1.5M")
    return int(number)
