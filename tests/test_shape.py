"""The shape of both packages: short files, few parameters, one meaning a name, and arrows without circles."""

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = "splat2mesh", "relight"

MOST_LINES = 350
MOST_PARAMETERS = 8
"""Of a function that is no kernel: what belongs together is a frozen value with a name."""

KERNELS = {"kernel", "njit", "vectorize", "guvectorize"}
"""Decorators: that of splat2mesh/base/kernels.py, and Numba's own."""

PUBLIC: set[str] = set()
"""Functions of the public API that may have more, as "module.function": their keywords are documented. None so far."""


@cache
def modules():
    """Name of each module -> (path, syntax tree)."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = path, ast.parse(path.read_text("utf-8"))
    return found


def names_in(node):
    """Every plain name and attribute in a piece of syntax."""
    return {each.id if isinstance(each, ast.Name) else each.attr for each in ast.walk(node)
            if isinstance(each, (ast.Name, ast.Attribute))}  # fmt: skip


def compilers(tree):
    """Names by which a module decorates kernels: Numba's, and what it makes of them for itself."""
    own = {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign) and names_in(node.value) & KERNELS
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    return own | KERNELS


def parameters(function):
    """How many a function has, `self` too; those that gather the rest count not."""
    given = function.args
    return len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs)


def imported(name, path, tree):
    """Modules of the packages that a module imports before any of its functions runs, for types alone too."""
    inside = {id(each) for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) for each in ast.walk(node)}
    found = set()
    for node in ast.walk(tree):
        if id(node) in inside:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            home = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
            base = home[: len(home) - node.level + 1] if node.level else []
            base = [*base, *(node.module.split(".") if node.module else [])]
            for alias in node.names:
                whole = ".".join([*base, alias.name])
                found.add(whole if whole in modules() else ".".join(base))
    return (found & set(modules())) - {name}


def test_no_file_is_long():
    lines = {str(path.relative_to(ROOT)): path.read_text("utf-8").count("\n") for path, _ in modules().values()}
    assert {name: count for name, count in lines.items() if count > MOST_LINES} == {}


def test_no_function_but_kernels_has_many_parameters():
    many, public = {}, set()
    for name, (_, tree) in modules().items():
        kernels = compilers(tree)
        for node in ast.walk(tree):
            if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) or parameters(node) <= MOST_PARAMETERS:
                continue
            if any(names_in(decorator) & kernels for decorator in node.decorator_list):
                continue
            if f"{name}.{node.name}" in PUBLIC:
                public.add(f"{name}.{node.name}")
            else:
                many[f"{name}.{node.name}"] = parameters(node)
    assert (many, public) == ({}, PUBLIC)


def test_no_class_name_has_two_meanings():
    homes = defaultdict(list)
    for name, (_, tree) in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(name)
    assert {name: found for name, found in homes.items() if len(found) > 1} == {}


def circles(arrows):
    """The sets of names that reach one another along arrows, a dict of name -> names: Tarjan's components."""
    number, low, path, found = {}, {}, [], []

    def visit(name):
        number[name] = low[name] = len(number)
        path.append(name)
        for other in arrows[name]:
            if other not in number:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in path:
                low[name] = min(low[name], number[other])
        if low[name] == number[name]:
            start = path.index(name)
            found.append(set(path[start:]))
            del path[start:]

    for name in arrows:
        if name not in number:
            visit(name)
    return [each for each in found if len(each) > 1]


def test_no_import_leads_back_to_where_it_began():
    assert circles({name: imported(name, *module) for name, module in modules().items()}) == []


@pytest.mark.parametrize(
    ("arrows", "expected"),
    [
        ({"a": {"b"}, "b": {"c"}, "c": set()}, []),
        ({"a": {"b"}, "b": {"c"}, "c": {"b"}}, [{"b", "c"}]),
        ({"a": {"b", "c"}, "b": {"d"}, "c": {"d"}, "d": set()}, []),
        ({"a": {"b"}, "b": {"a"}, "c": {"d"}, "d": {"c", "a"}}, [{"a", "b"}, {"c", "d"}]),
    ],
)
def test_circles_are_found(arrows, expected):
    assert circles(arrows) == expected
