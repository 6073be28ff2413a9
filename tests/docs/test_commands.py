"""Every command that the documents and the help show is one that the real parsers understand."""

import os
import re
import shlex
from pathlib import Path

import pytest

import relight.arguments
import relight.cli
import scenes.__main__
import splat2mesh.cli
from relight.tiles.city import check_city
from splat2mesh.base.errors import InputError
from splat2mesh.options import refuse_in_cities
from splat2mesh.tiles.city import KNOWN

ROOT = Path(__file__).parents[2]
DOCUMENTS = [
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").glob("**/*.md")),
    *sorted((ROOT / "integrations").glob("**/*.md")),
]
OURS = re.compile(r"(?:\$ )?((?:relight|splat2mesh|python -m (?:relight|splat2mesh|scenes)|scripts/\w+)(?: .*)?)$")


def shown():
    """(document, command line) of every command in a shell block, an indented line or backticks."""
    for document in DOCUMENTS:
        name, text = document.relative_to(ROOT).as_posix(), document.read_text("utf-8")
        lines = [
            line.strip() for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL) for line in block.splitlines()
        ]
        text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
        lines += [line.strip() for line in re.findall(r"^ {4}(\S.*)$", text, re.MULTILINE)]
        lines += [line for line in re.findall(r"`([^`\n]+)`", text) if " " in line or line.startswith("scripts/")]
        for line in lines:
            if found := OURS.match(line.split("#")[0].strip()):
                yield name, found[1]
    for module in (splat2mesh.cli, relight.arguments):
        for line in module.EXAMPLES.splitlines():
            command = re.split(r"\s{3,}", line.strip().removeprefix("then: "))[0]
            if OURS.match(command):
                yield f"{module.__name__} --help", command


COMMANDS = sorted(set(shown()))


MEANT = {"--kind": "garden"}
"""A value for the placeholder KIND, which no parser takes as it is."""


def words(command):
    """The arguments of a command line: of a usage without its optional groups and with the first of alternatives.

    Where only options are named, an input stands before them.
    """
    plain = re.sub(r"(\w+)(\|\w+)+", r"\1", re.sub(r"\[[^]]*\]", "", command)).removeprefix("python -m ")
    name, *arguments = shlex.split(plain)
    if name in PARSERS and (not arguments or arguments[0].startswith("-")):
        arguments.insert(0, "INPUT")
    for place, word in enumerate(arguments[:-1]):
        if word in MEANT and arguments[place + 1].isupper():
            arguments[place + 1] = MEANT[word]
    return [name, *arguments]


def understood(parser, understand, arguments):
    """Raise SystemExit or InputError where a command would end with exit code 2 for its words alone."""
    options = parser.parse_args(arguments)
    if understand:
        understand(options)
    return options


def check_relight(words):
    request = relight.cli.request_of(words)
    if words.scene == "CITY" or request.tiling is not None:
        check_city(request)


def check_splat2mesh(words):
    options, tiling = splat2mesh.cli.convert_options(words), splat2mesh.cli.tiling_options(words)
    if tiling is not None:
        refuse_in_cities(options, KNOWN)


PARSERS = {
    "relight": (relight.arguments.parser, check_relight),
    "splat2mesh": (splat2mesh.cli.parser, check_splat2mesh),
    "scenes": (scenes.__main__._parser, None),
}


def test_there_are_commands_of_every_kind():
    assert len(COMMANDS) >= 60
    named = {words(command)[0] for _, command in COMMANDS}
    assert {*PARSERS, "scripts/demo", "scripts/bench"} <= named
    assert len({document for document, _ in COMMANDS}) >= 15


@pytest.mark.parametrize(("document", "command"), COMMANDS, ids=lambda text: text.replace("/", "-"))
def test_a_command_that_is_shown_is_understood(document, command, capsys):
    command = command.removeprefix("python -m ")
    name, *arguments = words(command)
    if name in PARSERS:
        parser, understand = PARSERS[name]
        known = {option for action in parser()._actions for option in action.option_strings}
        used = set(re.findall(r"(?<![\w-])(--?[a-z][\w-]*)", re.sub(r"(?<=--up) -\w", "", command)))
        assert used <= known, (document, used - known)
        try:
            understood(parser(), understand, arguments)
        except SystemExit:
            pytest.fail(f"{document}: {command}: {capsys.readouterr().err}")
        except InputError as error:
            pytest.fail(f"{document}: {command}: {error}")
        return
    script = ROOT / name
    assert os.access(script, os.X_OK), f"{document}: {name} is no script that runs"
    text = script.read_text("utf-8")
    if name in ("scripts/bench", "scripts/frontier"):
        if name == "scripts/frontier":
            arguments.insert(0, "frontier")
        subject, *arguments = arguments
        if subject == "SUBJECT":
            return
        module = ROOT / "scripts" / "benchmarks" / f"{subject}.py"
        text = module.read_text("utf-8") + (ROOT / "scripts" / "benchmarks" / "harness.py").read_text("utf-8")
    for option in (each for each in arguments if each.startswith("--")):
        assert f'"{option}"' in text, f"{document}: {command}: {name} knows no {option}"


def test_a_command_that_is_wrong_would_be_found(capsys):
    for command in ("relight garden --enviroment noon", "splat2mesh a b", "relight g --format glb png --bands many"):
        name, *arguments = words(command)
        with pytest.raises(SystemExit):
            understood(PARSERS[name][0](), PARSERS[name][1], arguments)
    capsys.readouterr()
    for command in ("relight g --format gbl", "relight g --rotate 0:9", "splat2mesh a --up north"):
        name, *arguments = words(command)
        with pytest.raises(InputError):
            understood(PARSERS[name][0](), PARSERS[name][1], arguments)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_extras_that_are_to_be_installed_exist(document):
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 cannot read TOML")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    named = re.findall(r"pip install (?:-e )?[\"'](?:splat2mesh|\.)\[([\w,]+)\]", document.read_text("utf-8"))
    assert {extra for group in named for extra in group.split(",")} <= set(extras)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_files_that_are_to_be_copied_exist(document):
    for line in re.findall(r"^cp (.*)$", document.read_text("utf-8"), re.MULTILINE):
        for path in shlex.split(line, comments=True):
            if path.startswith("integrations/"):
                assert list(ROOT.glob(path)), f"{document.name}: cp {path}"
