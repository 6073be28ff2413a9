"""Completions for shells, made from a command's parser, so they know every option."""

import argparse
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

SHELLS = ("bash", "zsh", "fish")


def add_completion(parser: argparse.ArgumentParser) -> None:
    """Give a parser `--completion SHELL`, which prints and ends."""
    completion = f"print a completion script for a shell: {', '.join(SHELLS)}"
    parser.add_argument("--completion", action=_Printed, choices=SHELLS, metavar="SHELL", help=completion)


def offer(parser: argparse.ArgumentParser, words: Mapping[str, Iterable[str]]) -> None:
    """Name words that completions offer as values of options; other values stay allowed. words: by setting, such as
    "detail"."""
    for action in parser._actions:
        if action.dest in words:
            action.offered = tuple(words[action.dest])  # type: ignore[attr-defined]


class _Printed(argparse.Action):
    """Print and end, as `--help` does."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        parser._print_message(completion(parser, str(values)), sys.stdout)
        parser.exit()


def completion(parser: argparse.ArgumentParser, shell: str) -> str:
    """Make the script that teaches a shell the options of a command and their values.

    Bash offers files where no word fits. The other shells offer words alone, or files alone for options that take some.

    parser: of the command, whose `prog` is the name that is completed. shell: one of `SHELLS`. Returns the script, for
    the shell to source.
    """
    import shtab

    for action in parser._actions:
        takes_files = re.search("FILE|PATH", str(action.metavar))
        if (shell == "bash" or not takes_files) and hasattr(action, "offered"):
            action.choices = action.offered  # the parser prints this script and ends
    if shell == "bash":
        # Values marked as files would hide, after an option that takes several, all other options: bash's own default
        # offers files where nothing else fits.
        function = re.sub(r"\W", "_", f"_shtab_{parser.prog}")
        return f"{shtab.complete(parser, shell)}\ncomplete -o default -F {function} {parser.prog}\n"
    for action in parser._actions:
        if action.nargs != 0 and not action.choices:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return shtab.complete(parser, shell) + "\n"
