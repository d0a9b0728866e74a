"""The modules build on each other in one order: no import leads upward, none in a circle."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import fvswell

SOURCE = Path(fvswell.__file__).parent
# each builds on those before it; names in one row do not know each other
LAYERS = (
    ("version", "errors", "compiled", "common_units"),
    ("physics",),
    ("boundary", "exact", "numerics"),
    ("column", "block"),
    ("units",),
    ("case",),
    ("results", "fipy"),
    ("simulation",),
    ("prediction",),
    ("study",),
    ("analysis",),
    ("fitting",),
    ("reporting",),
    ("paper",),
    ("cli",),
    ("__init__",),
    ("__main__",),
)


def modules() -> dict[str, Path]:
    """All modules by their names, without that of the package."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        name = ".".join(parts[:-1] if len(parts) > 1 and parts[-1] == "__init__" else parts)
        found[name] = path
    return found


def is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def nodes(tree: ast.AST, everywhere: bool) -> Iterator[ast.AST]:
    """Nodes that run; without ``everywhere``, only those that run when the module is imported."""
    for node in ast.iter_child_nodes(tree):
        if is_type_checking(node):
            continue
        if not everywhere and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        yield node
        yield from nodes(node, everywhere)


@cache
def imported(path: Path, everywhere: bool = True) -> frozenset[str]:
    """Modules that a file imports, as absolute names; what is imported from a package counts as its module."""
    found = set()
    for node in nodes(ast.parse(path.read_text(encoding="utf-8")), everywhere):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                is_module = inner.removeprefix("fvswell.") in modules()
                found.add(inner if is_module else str(node.module))
    return frozenset(found)


def own(path: Path, everywhere: bool = True) -> set[str]:
    """Modules of fvswell that a file imports, by their names within it."""
    found = {name.removeprefix("fvswell.") for name in imported(path, everywhere) if name.startswith("fvswell.")}
    return found | ({"__init__"} if "fvswell" in imported(path, everywhere) else set())


def layer_of(module: str) -> int:
    (index,) = (i for i, row in enumerate(LAYERS) if module.split(".")[0] in row)
    return index


def test_every_module_has_its_place() -> None:
    known = {name for row in LAYERS for name in row}
    assert {name.split(".")[0] for name in modules()} <= known


@pytest.mark.parametrize("row", LAYERS, ids=lambda row: "-".join(row))
def test_no_import_leads_upward(row: tuple[str, ...]) -> None:
    """Wherever it stands, in a function too; only the package's own lazy names may point anywhere."""
    wrong = []
    for name, path in modules().items():
        first = name.split(".")[0]
        if first not in row:
            continue
        for target in own(path):
            other = target.split(".")[0]
            if other != first and layer_of(target) >= layer_of(name):
                wrong.append(f"{name} imports {target}")
    assert not wrong


def test_no_import_leads_in_a_circle() -> None:
    graph = {name: own(path) & set(modules()) for name, path in modules().items() if name != "__init__"}
    done: set[str] = set()
    circles = []

    def visit(name: str, way: tuple[str, ...]) -> None:
        if name in way:
            circles.append(" -> ".join((*way[way.index(name) :], name)))
        elif name not in done:
            for target in sorted(graph.get(name, ())):
                visit(target, (*way, name))
            done.add(name)

    for name in sorted(graph):
        visit(name, ())
    assert not circles


def knowing(library: str, everywhere: bool = True) -> set[str]:
    """Modules that import a library."""
    return {
        name for name, path in modules().items()
        if any(module.split(".")[0] == library for module in imported(path, everywhere))
    }  # fmt: skip


def test_only_one_package_knows_fipy() -> None:
    assert {name.split(".")[0] for name in knowing("fipy")} == {"fipy"}


def test_only_one_package_knows_numba() -> None:
    assert {name.split(".")[0] for name in knowing("numba") | knowing("llvmlite")} == {"compiled"}


@pytest.mark.parametrize("module", ["fvswell.case.case", "fvswell.cli.main"])
def test_checking_a_case_loads_neither_numba_nor_fipy(module: str) -> None:
    code = f"import sys, {module}; print([name for name in ('numba', 'fipy', 'llvmlite') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("module", ["fvswell.column.column", "fvswell.block.block", "fvswell.simulation.run"])
def test_what_runs_a_case_knows_no_fipy(module: str) -> None:
    code = f"import sys, {module}; print('fipy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
