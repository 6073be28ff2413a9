"""The shape of both packages: one meaning a name, arrows without circles, and counts that may only fall."""

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = "splat2mesh", "relight"

LAZY, BRANCHY, WIDE = 97, 0, 23
"""Imports inside functions, functions with more than MANY_BRANCHES, and with MANY_PARAMETERS or more. A change that
brings one down writes the lower number here; none writes a higher one."""

MANY_BRANCHES, MANY_PARAMETERS = 15, 7
"""Of functions that are no kernels."""

SHARED_ALIASES = {"AnyPath": 2, "Camera": 2, "Lamp": 2}
"""Names of types, or of classes and types, that stand for more than one thing: how many."""

BRANCH = (
    *(ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.comprehension, ast.BoolOp, ast.Assert),
    *((ast.Match,) if hasattr(ast, "Match") else ()),
)

KERNELS = {"kernel", "njit", "vectorize", "guvectorize"}
"""Decorators: that of splat2mesh/base/kernels.py, and Numba's own."""


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


def functions():
    """Every function that is no kernel, as "module.function" -> its syntax."""
    found = {}
    for name, (_, tree) in modules().items():
        kernels = compilers(tree)
        for node in ast.walk(tree):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                if not any(names_in(decorator) & kernels for decorator in node.decorator_list):
                    found[f"{name}.{node.name}:{node.lineno}"] = node
    return found


def branches(function):
    """How many conditions and loops a function has, those of functions inside it too."""
    return sum(isinstance(node, BRANCH) for node in ast.walk(function))


def lazy(tree):
    """The imports inside functions, each once."""
    inside = {id(each): each for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
              for each in ast.walk(node) if isinstance(each, (ast.Import, ast.ImportFrom))}  # fmt: skip
    return list(inside.values())


def aliases(tree):
    """Names that a module gives to types, and those of its classes."""
    typed = ("tuple", "Callable", "NDArray", "Sequence", "Mapping", "list", "dict", "Literal")
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.AnnAssign) and "TypeAlias" in names_in(node.annotation):
            yield node.target.id
        elif isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript):
            if isinstance(node.value.value, ast.Name) and node.value.value.id in typed:
                yield node.targets[0].id


def test_imports_inside_functions_become_fewer():
    found = {name: len(lazy(tree)) for name, (_, tree) in modules().items()}
    assert sum(found.values()) <= LAZY, dict(sorted(found.items(), key=lambda pair: -pair[1])[:20])


def test_functions_with_many_branches_become_fewer():
    found = {name: branches(node) for name, node in functions().items() if branches(node) > MANY_BRANCHES}
    assert len(found) <= BRANCHY, found


def test_functions_with_many_parameters_become_fewer():
    found = {name: parameters(node) for name, node in functions().items() if parameters(node) >= MANY_PARAMETERS}
    assert len(found) <= WIDE, found


def test_no_name_of_a_type_gains_a_meaning():
    homes = defaultdict(list)
    for name, (_, tree) in modules().items():
        for alias in aliases(tree):
            homes[alias].append(name)
    shared = {alias: len(found) for alias, found in homes.items() if len(found) > 1}
    assert {alias: count for alias, count in shared.items() if count > SHARED_ALIASES.get(alias, 1)} == {}


def test_the_counts_see_what_they_count():
    code = """
import a
Own = tuple[int, int]
Named: TypeAlias = int
number: int = 3

def outer(x, y):
    import b
    def inner():
        from c import d
    return [e for e in x if e] if x and y else None
"""
    tree = ast.parse(code)
    outer = tree.body[-1]
    assert len(lazy(tree)) == 2 and list(aliases(tree)) == ["Own", "Named"]
    assert branches(outer) == 3 and parameters(outer) == 2


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


@pytest.mark.parametrize("folder", ["relight/jobs", "relight/insert"])
def test_nothing_writes_the_attributes_of_another_object_past_its_names(folder):
    for path in sorted((ROOT / folder).glob("*.py")):
        text = path.read_text("utf-8")
        assert "__dict__" not in text and "vars(other).update" not in text, path.name
