"""CONTRIBUTING.md, CHANGELOG.md and the glossary against the tree."""

import ast
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TREE = re.search(r"## The tree\n.*?```text\n(.*?)```", (ROOT / "CONTRIBUTING.md").read_text("utf-8"), re.DOTALL)[1]
PACKAGES = "splat2mesh", "relight", "scenes", "training", "scripts", "examples", "integrations", "docs"


def listed():
    """The folders that the tree names, as paths from the root."""
    found, above = set(), []
    for line in TREE.splitlines():
        indent = (len(line) - len(line.lstrip())) // 2
        names = re.findall(r"(?:^|  )([\w.]+)/(?=\s|$)", line)
        above = above[:indent]
        found |= {"/".join([*above, name]) for name in names}
        above.append(names[0])
    return found


def holds_files(folder):
    """Whether a folder holds a file that is no by-product."""
    return any(
        path.is_file() and path.suffix != ".pyc" and not any(part.startswith(".") for part in path.parts)
        for path in folder.iterdir()
    )


def folders(top):
    """Folders at and below `top` that hold files, as paths from the root."""
    every = [ROOT / top, *(path for path in (ROOT / top).rglob("*") if path.is_dir())]
    kept = [path for path in every if path.name != "__pycache__" and holds_files(path)]
    return {path.relative_to(ROOT).as_posix() for path in kept}


@pytest.mark.parametrize("package", PACKAGES)
def test_the_tree_names_every_folder_that_exists_and_no_other(package):
    named = {name for name in listed() if name.split("/")[0] == package}
    assert folders(package) == named


def test_tests_stand_in_the_rooms_of_what_they_test():
    rooms = {f"tests/{name}" for name in listed() if not name.startswith("tests")}
    assert folders("tests") - {name for name in listed() if name.startswith("tests")} - rooms == set()


def imports(package):
    """(path of a module as parts, full name of what it imports as parts) of every import in a package."""
    for path in sorted((ROOT / package).rglob("*.py")):
        module = path.relative_to(ROOT).with_suffix("").parts
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                yield from ((module, alias.name.split(".")) for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                above = module[: -node.level] if node.level else ()
                base = [*above, *(node.module.split(".") if node.module else ())]
                yield from ((module, [*base, alias.name]) for alias in node.names)


@pytest.mark.parametrize(
    ("package", "forbidden"),
    [
        ("splat2mesh", {"relight", "scenes", "training", "tests", "examples"}),
        ("relight", {"scenes", "training", "tests", "examples"}),
    ],
)
def test_no_arrow_runs_back(package, forbidden):
    assert [(module, name) for module, name in imports(package) if name[0] in forbidden] == []


ORDER = {
    "splat2mesh": "base options splats scene render views surface texture tiles proxy capture pipeline sequence layout "
    "summary info api cli",
    "relight": "sh light transfer lamps options planning albedo rooms engine splats quick gloss insert live texture "
    "output animation request tiles viewer jobs api arguments cli",
}
"""Rooms and top-level modules of each package: a module imports what stands before it, or its own room."""

COMMAND_LINES = {"cli", "arguments", "__main__"}
"""Top-level modules that no library module imports."""

FOR_COMMANDS = {"commandline", "completion", "requests"}
"""Modules of splat2mesh/base that only command lines import."""


@pytest.mark.parametrize("package", ORDER)
def test_every_module_imports_only_what_stands_before_it(package):
    order = ["__init__", *ORDER[package].split(), "__main__"]
    tops = {path.stem for path in (ROOT / package).iterdir() if path.suffix == ".py" or holds_python(path)}
    assert tops == set(order) - {"models"}
    back = set()
    for module, name in imports(package):
        if name[0] != package or len(name) < 2 or name[1] not in order:
            continue
        room = module[1]
        if name[1] != room and order.index(name[1]) >= order.index(room):
            back.add((".".join(module), ".".join(name)))
    assert back == set()


def holds_python(path):
    return path.is_dir() and any(path.glob("*.py"))


def test_no_library_module_imports_a_command_line():
    crossed = set()
    for package in ORDER:
        for module, name in imports(package):
            if module[1] in COMMAND_LINES:
                continue
            if name[0] in ORDER and len(name) > 1 and name[1] in COMMAND_LINES:
                crossed.add((".".join(module), ".".join(name)))
            if name[:2] == ["splat2mesh", "base"] and len(name) > 2 and name[2] in FOR_COMMANDS and module[1] != "base":
                crossed.add((".".join(module), ".".join(name)))
            if name[0] == "argparse" and module[2:3] not in [(each,) for each in FOR_COMMANDS]:
                crossed.add((".".join(module), "argparse"))
    assert crossed == set()


@pytest.mark.parametrize("package", ["splat2mesh", "relight"])
def test_a_room_imports_rooms_that_stand_above_it_in_the_tree(package):
    rooms = re.findall(r"^  (\w+)/", TREE.split(f"{package}/")[1], re.MULTILINE)
    rooms = rooms[: len([name for name in listed() if re.fullmatch(rf"{package}/\w+", name)])]
    below = {
        (".".join(module), ".".join(name))
        for module, name in imports(package)
        if name[0] == package and len(module) > 2 and len(name) > 1
        if name[1] in rooms and rooms.index(name[1]) > rooms.index(module[1])
    }
    assert below == set()


def test_where_did_x_go_leads_to_modules():
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    table = text.split("### Where did X go")[1]
    rows = re.findall(r"^\| `([\w.]+)` \| (.+) \|$", table, re.MULTILINE)
    assert len(rows) > 70
    new = {module for _, cell in rows for module in re.findall(r"`((?:relight|splat2mesh)\.[\w.]+)`", cell)}
    assert [module for module in sorted(new) if find_spec(module) is None] == []
