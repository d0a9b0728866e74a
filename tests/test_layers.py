"""The packages build on each other in one order, so that physics know no grid and numerics no case."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import fvswell

SOURCE = Path(fvswell.__file__).parent
LAYERS = (
    "physics", "exact", "numerics", "column", "block", "case", "results", "simulation", "prediction", "study",
    "analysis", "reporting", "cli",
)  # fmt: skip


def imported(path: Path) -> Iterator[str]:
    """Modules of fvswell that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("fvswell."):
            yield node.module


def test_every_package_has_its_place() -> None:
    assert {path.parent.name for path in SOURCE.glob("*/__init__.py")} == set(LAYERS)


@pytest.mark.parametrize("layer", LAYERS)
def test_a_package_builds_on_those_before_it(layer: str) -> None:
    above = LAYERS[LAYERS.index(layer) + 1 :]
    wrong = [
        f"{path.name} imports {module}"
        for path in (SOURCE / layer).glob("*.py")
        for module in imported(path)
        if module.split(".")[1] in above
    ]
    assert not wrong


def test_only_discretisations_know_fipy() -> None:
    knowing = {path.parent.name for path in SOURCE.rglob("*.py") if "import fipy" in (text := path.read_text()) or
               "from fipy" in text}  # fmt: skip
    assert knowing <= {"numerics", "column", "block"}
