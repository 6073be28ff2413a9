"""From the words of a command line to the requests of the library: an option's name in the parser is a field's name."""

import argparse
from dataclasses import fields
from typing import Any


def given(request: type, words: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of a request, a dataclass, that the command line gives; other fields are absent.

    A parser whose options have no defaults (`argument_default=argparse.SUPPRESS`) leaves them out of its namespace, so
    that every default is the dataclass's own.
    """
    said = vars(words)
    return {field.name: said[field.name] for field in fields(request) if field.name in said}


def option_names(parser: argparse.ArgumentParser) -> dict[str, str]:
    """Return the option of every setting, such as {"budget_s": "--budget"}, for messages that name settings."""
    found = {}
    for action in parser._actions:
        long = [option for option in action.option_strings if option.startswith("--")]
        if long:
            found[action.dest] = long[0]
    return found
