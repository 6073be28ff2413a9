"""The documents: every option is described, every link leads somewhere, nothing names one machine's folders."""

import re
from pathlib import Path

import pytest

import relight.cli
import splat2mesh.cli
from relight.viewer.controls import CONTROLS, MOUSE, key_name

ROOT = Path(__file__).parents[2]
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("**/*.md"))]


def long_options(parser):
    return [option for action in parser._actions for option in action.option_strings if option.startswith("--")]


OPTIONS = [
    (command, option)
    for command, module in (("splat2mesh", splat2mesh.cli), ("relight", relight.cli))
    for option in long_options(module.parser())
]


REFERENCE = (ROOT / "docs" / "options.md").read_text(encoding="utf-8")


def section(heading):
    """The part of docs/options.md under `## heading`, up to the next heading of that level."""
    match = re.search(rf"^## {heading}$(.*?)(?=^## |\Z)", REFERENCE, re.MULTILINE | re.DOTALL)
    assert match, f"docs/options.md has no section '## {heading}'"
    return match[1]


def named(text):
    """The long options that a text names."""
    return set(re.findall(r"(?<![\w-])--[a-z][\w-]*", text))


@pytest.mark.parametrize(("command", "option"), OPTIONS)
def test_every_option_has_a_row_in_its_commands_section(command, option):
    first_cells = re.findall(r"^\| (`(?:[^|\\]|\\\|)*) \| ", section(command), re.MULTILINE)
    assert option in named(" ".join(first_cells)), f"docs/options.md, section {command}: {option} has no row"


@pytest.mark.parametrize("command", ["splat2mesh", "relight"])
def test_no_section_names_an_option_that_does_not_exist(command):
    assert named(section(command)) - {option for name, option in OPTIONS if name == command} == set()


def test_the_session_lists_its_keys():
    text = section("The session")
    listed = dict(re.findall(r"\| `([^`]+)` \| ([^|]+) (?=\|)", text))
    assert listed == {key_name(control): control.text for control in CONTROLS}
    assert all(f"{button}: {meaning}" in text for button, meaning in MOUSE)


def test_the_readme_is_short_and_names_no_option_that_does_not_exist():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert named(text) - {option for _, option in OPTIONS} == set()
    assert len(text.splitlines()) <= 150


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_relative_link_and_picture_leads_to_a_file(document):
    text = document.read_text(encoding="utf-8")
    targets = re.findall(r"\]\(<?([^)\s>]+)", text) + re.findall(r"(?:src|href)=\"([^\"]+)\"", text)
    files = [target.split("#")[0] for target in targets if not re.match(r"[a-z]+:|#", target)]
    assert [name for name in files if not (document.parent / name).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_link_to_a_heading_of_the_same_page_finds_it(document):
    text = document.read_text(encoding="utf-8")
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    assert set(re.findall(r"\]\(#([^)]+)\)", text)) - anchors == set()


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_no_folder_of_one_machine_is_named(document):
    text = document.read_text(encoding="utf-8")
    assert re.findall(r"(?<![\w.])/(?:work|root|tmp|home)\b[^\s`)]*", text) == []
