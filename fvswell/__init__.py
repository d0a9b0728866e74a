"""fvswell: finite-volume swelling and compression of soft, charged, hydrated tissues."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from fvswell.version import __version__

if TYPE_CHECKING:
    from fvswell.analysis.comparison import compare
    from fvswell.case.case import Case, CaseError, load_case
    from fvswell.errors import OutputError, SolverError
    from fvswell.fitting.file import load_fit
    from fvswell.fitting.fit import fit
    from fvswell.physics.tissues import TISSUES as tissues
    from fvswell.reporting.tissue_figure import show
    from fvswell.results.file import read_result
    from fvswell.simulation.run import run

os.environ.setdefault("FIPY_SOLVERS", "scipy")  # FiPy chooses its solvers when it is imported

_HOMES = {
    "Case": "case.case", "CaseError": "case.errors", "load_case": "case.case", "compare": "analysis.comparison",
    "fit": "fitting.fit", "load_fit": "fitting.file",
    "run": "simulation.run", "read_result": "results.file", "OutputError": "errors", "SolverError": "errors",
    "show": "reporting.tissue_figure", "tissues": "physics.tissues",
}  # fmt: skip
_NAMES_THERE = {"tissues": "TISSUES"}  # where they are not the public ones
__all__ = [
    "Case", "CaseError", "OutputError", "SolverError", "__version__", "compare", "fit", "load_case", "load_fit",
    "read_result", "run", "show", "tissues",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    # imported when first asked for: FiPy takes most of a second, and not every use needs it
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"fvswell.{_HOMES[name]}"), _NAMES_THERE.get(name, name))
