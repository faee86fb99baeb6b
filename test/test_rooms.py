"""The large scale: every file in a room, no circle of files, aids below navigators, annotations everywhere but in kernels."""

import ast
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = "lowcostnav_ros"
Graph = dict[str, frozenset[str]]


@cache
def trees() -> dict[str, ast.Module]:
    """Syntax tree of every module, by its name within the package; a folder's ``__init__`` has the folder's name."""
    found = {}
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        parts = path.relative_to(ROOT / PACKAGE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = ast.parse(path.read_text())
    return found


def imported(tree: ast.Module, modules: frozenset[str]) -> frozenset[str]:
    """Modules of the package that a module imports anywhere: at its top, in a function or for the type checker alone."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if _inner(name) in modules else node.module for name in names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        found |= {_inner(name) for name in names if name.partition(".")[0] == PACKAGE}
    return frozenset(found & modules)


def _inner(name: str) -> str:
    return name.partition(".")[2]


def package_graph() -> Graph:
    """Which module imports which."""
    modules = frozenset(trees())
    return {name: imported(tree, modules) - {name} for name, tree in trees().items()}


def reached(graph: Graph, start: str) -> frozenset[str]:
    """Every module that a module imports, directly or not."""
    seen: set[str] = set()
    waiting = list(graph[start])
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting += graph[name]
    return frozenset(seen)


def circles(graph: Graph) -> set[frozenset[str]]:
    """Sets of modules each of which needs all the others (strongly connected components)."""
    below = {name: reached(graph, name) for name in graph}
    return {frozenset(other for other in below[name] if name in below[other]) for name in graph if name in below[name]}


def test_no_circle_of_files():
    found = circles(package_graph())
    assert not found, "These files import each other in a circle: " + "; ".join(", ".join(sorted(circle)) for circle in found)


def test_circles_are_found():
    graph = {name: frozenset(reads) for name, reads in {"a": "b", "b": "ce", "c": "a", "d": "a", "e": ""}.items()}
    assert circles(graph) == {frozenset("abc")}


@pytest.mark.parametrize(
    "line",
    [
        "from lowcostnav_ros.base import units",
        "from lowcostnav_ros.base.units import FOOT",
        "import lowcostnav_ros.base.units",
        "def f():\n    from lowcostnav_ros.base.units import FOOT",
        "if TYPE_CHECKING:\n    from lowcostnav_ros.base.units import FOOT",
    ],
)
def test_every_form_of_import_is_seen(line):
    assert imported(ast.parse(line), frozenset({"base", "base.units"})) == {"base.units"}


def test_the_package_root_holds_the_glossary_alone():
    assert [path.name for path in (ROOT / PACKAGE).glob("*.py")] == ["__init__.py"]


def test_no_aid_imports_a_navigator():
    up = {
        name: sorted(target for target in targets if target.startswith("navigators"))
        for name, targets in package_graph().items()
        if name.startswith("aids") and any(target.startswith("navigators") for target in targets)
    }
    assert not up, "An aid knows no navigator, only what its host offers: " + "; ".join(f"{n} imports {up[n]}" for n in sorted(up))


def unannotated(tree: ast.Module) -> list[ast.FunctionDef]:
    """Functions with arguments and no annotation at all, methods' ``self`` and ``cls`` apart; the type checker refuses half of one."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return [f for f in functions if f.returns is None and not any(a.annotation for a in (*f.args.args, *f.args.kwonlyargs))]


def unchecked_rooms() -> tuple[str, ...]:
    """Rooms that the type checker leaves out for now."""
    overrides = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["overrides"]
    return tuple(_inner(name).removesuffix("*") for entry in overrides if entry.get("ignore_errors") for name in entry["module"])


def test_only_kernels_are_without_annotations():
    found = [
        f"{name}.{function.name}"
        for name, tree in trees().items()
        for function in unannotated(tree)
        if not name.startswith(unchecked_rooms()) and "kernel" not in [getattr(d, "id", "") for d in function.decorator_list]
    ]
    assert not found, "Annotate these, or make them kernels: " + ", ".join(found)
