"""Completions for shells and manual pages, made from a command's parser, so that they know every option."""

import argparse
import re
import sys

SHELLS = ("bash", "zsh", "fish")


def add_manuals(parser: argparse.ArgumentParser) -> None:
    """Give a parser `--completion SHELL` and `--man`, which print and end."""
    completion = f"print what makes a shell complete this command's options: {', '.join(SHELLS)}"
    parser.add_argument("--completion", action=_Printed, choices=SHELLS, metavar="SHELL", help=completion)
    parser.add_argument("--man", action=_Printed, nargs=0, help="print the manual page; `man -l -` shows it")


class _Printed(argparse.Action):
    """Print and end, as `--help` does."""

    def __call__(self, parser, namespace, values, option_string=None):
        text = completion(parser, values) if isinstance(values, str) else manual(parser)
        parser._print_message(text, sys.stdout)
        parser.exit()


def completion(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script, text, that tells a shell of SHELLS the options of a command; files complete everything else."""
    name, function = parser.prog, re.sub(r"\W", "_", parser.prog)
    options = [option for action in parser._actions for option in action.option_strings]
    if shell == "bash":
        return (
            f"_{function}() {{\n"
            '    local word="${COMP_WORDS[COMP_CWORD]}"\n'
            f'    [[ $word == -* ]] && COMPREPLY=($(compgen -W "{" ".join(options)}" -- "$word"))\n'
            "}\n"
            f"complete -o default -F _{function} {name}\n"
        )
    if shell == "zsh":
        lines = [f"#compdef {name}", "_arguments \\"]
        lines += [f"    '{each}[{_plain(action, 'zsh')}]{_value(action)}' \\" for action, each in _each(parser)]
        return "\n".join([*lines, "    '*:file:_files'"]) + "\n"
    lines = []
    for action in parser._actions:
        flags = " ".join(
            f"-l {text[2:]}" if text.startswith("--") else f"-s {text[1:]}" for text in action.option_strings
        )
        if flags:
            takes = "" if action.nargs == 0 else " -r"
            lines.append(f"complete -c {name} {flags}{takes} -d '{_plain(action, 'fish')}'")
    return "\n".join(lines) + "\n"


def manual(parser: argparse.ArgumentParser) -> str:
    """The manual page of a command, in troff's man macros."""
    name = parser.prog
    usage = parser.format_usage().removeprefix("usage: ").strip()
    lines = [f'.TH {name.upper()} 1 "" "" "User commands"', ".SH NAME"]
    lines += [f"{name} \\- {_troff(parser.description or '')}", ".SH SYNOPSIS", _troff(" ".join(usage.split()))]
    for group in parser._action_groups:
        if group._group_actions:
            lines.append(f".SH {(group.title or 'options').upper()}")
        for action in group._group_actions:
            names = ", ".join(f"\\fB{_troff(text)}\\fR" for text in action.option_strings)
            metavar = "" if action.nargs == 0 else f" \\fI{_troff(str(action.metavar or action.dest))}\\fR"
            lines += [".TP", f"{names}{metavar}".strip(), _troff(_help(parser, action))]
    lines += [".SH EXAMPLES", ".nf", _troff((parser.epilog or "").removeprefix("examples:\n")), ".fi"]
    return "\n".join(lines) + "\n"


def _each(parser):
    return [(action, option) for action in parser._actions for option in action.option_strings]


def _help(parser, action):
    return parser._get_formatter()._expand_help(action) if action.help else ""


def _plain(action, shell):
    """The first words of an option's help, without what its shell would take for signs."""
    text = re.split(r" \(default|;", (action.help or "").replace("%%", "%"))[0]
    text = text.replace("'", "").replace("[", "(").replace("]", ")")
    return text.replace(":", "\\:") if shell == "zsh" else text


def _value(action):
    return "" if action.nargs == 0 else f":{(action.metavar or action.dest).lower().replace(':', '-')}:_files"


def _troff(text):
    """Text whose backslashes, hyphens and leading dots mean themselves."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return re.sub(r"(?m)^([.'])", r"\\&\1", text)
