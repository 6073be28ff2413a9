"""Completions for shells and manual pages, made from a command's parser, so they know every option."""

import argparse
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

SHELLS = ("bash", "zsh", "fish")


def add_manuals(parser: argparse.ArgumentParser) -> None:
    """Give a parser `--completion SHELL` and `--man`, which print and end."""
    completion = f"print a completion script for a shell: {', '.join(SHELLS)}"
    parser.add_argument("--completion", action=_Printed, choices=SHELLS, metavar="SHELL", help=completion)
    parser.add_argument("--man", action=_Printed, nargs=0, help="print the manual page; `man -l -` shows it")


def offer(parser: argparse.ArgumentParser, words: Mapping[str, Iterable[str]]) -> None:
    """Name words that completions offer as values of options; other values stay allowed.

    words: by option, such as "--detail".
    """
    for action in parser._actions:
        for option in {*action.option_strings} & {*words}:
            action.offered = tuple(words[option])  # type: ignore[attr-defined]


class _Printed(argparse.Action):
    """Print and end, as `--help` does."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        text = completion(parser, values) if isinstance(values, str) else manual(parser)
        parser._print_message(text, sys.stdout)
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


def manual(parser: argparse.ArgumentParser) -> str:
    """Make the manual page of a command, in troff's man macros.

    argparse-manpage makes one too, but leaves a line that begins with a full stop, such as ".exr or .hdr file", to be
    obeyed by troff, which drops it, and writes the day into it (`docs/decisions.md`).

    parser: of the command. Returns the page; the same parser gives the same text.
    """
    name = parser.prog
    usage = parser.format_usage().removeprefix("usage: ").strip()
    lines = [f'.TH {name.upper()} 1 "" "" "User commands"', ".SH NAME"]
    lines += [f"{name} \\- {_troff(parser.description or '')}", ".SH SYNOPSIS", _troff(" ".join(usage.split()))]
    for group in parser._action_groups:
        if group._group_actions:
            lines.append(f".SH {(group.title or 'options').upper()}")
        for action in group._group_actions:
            names = ", ".join(f"\\fB{_troff(text)}\\fR" for text in action.option_strings)
            value = action.metavar or "|".join(map(str, action.choices or [action.dest]))
            metavar = "" if action.nargs == 0 else f" \\fI{_troff(str(value))}\\fR"
            lines += [".TP", f"{names}{metavar}".strip(), _troff(_help(parser, action))]
    lines += [".SH EXAMPLES", ".nf", _troff((parser.epilog or "").removeprefix("examples:\n")), ".fi"]
    return "\n".join(lines) + "\n"


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    return parser._get_formatter()._expand_help(action) if action.help else ""


def _troff(text: str) -> str:
    """Text whose backslashes, hyphens and leading dots mean themselves."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return re.sub(r"(?m)^([.'])", r"\\&\1", text)
