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


def section(text, heading):
    """The part of a document under `## heading`, up to the next heading of that level."""
    match = re.search(rf"^## {heading}$(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    assert match, f"README.md has no section '## {heading}'"
    return match[1]


@pytest.mark.parametrize(("command", "option"), OPTIONS)
def test_every_option_is_in_its_commands_section_of_the_readme(command, option):
    text = section((ROOT / "README.md").read_text(encoding="utf-8"), command)
    assert re.search(rf"(?<![\w-]){option}(?![\w-])", text), f"README.md, section {command}: {option} is missing"


def test_the_readme_names_no_option_that_does_not_exist():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for command in ("splat2mesh", "relight"):
        known = {option for name, option in OPTIONS if name == command}
        assert set(re.findall(r"(?<![\w-])--[a-z][\w-]*", section(text, command))) - known == set()


def test_the_readme_lists_the_keys_of_the_session():
    text = section((ROOT / "README.md").read_text(encoding="utf-8"), "The session")
    listed = dict(re.findall(r"\| `([^`]+)` \| ([^|]+) (?=\|)", text))
    assert listed == {key_name(control): control.text for control in CONTROLS}
    assert all(f"{button}: {meaning}" in text for button, meaning in MOUSE)


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
