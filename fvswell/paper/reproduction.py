"""The runs that the figures of Wilson, van Donkelaar & Huyghe (2005) need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import xarray as xr

from fvswell.analysis.comparison import Comparison, compare
from fvswell.analysis.rules import CurveFit, paper_fits
from fvswell.case.case import Case, CaseError
from fvswell.case.errors import Problem, shown
from fvswell.fitting.reduced_model import ReducedFit, fit_reduced_model, reduced_problem
from fvswell.prediction.case_prediction import conditions_of
from fvswell.prediction.conditions import kind_of_change
from fvswell.study.file import read_study
from fvswell.study.points import CURVES, PAPER_MODELS, StudyPoints, study_points
from fvswell.study.run import StudyProgress, run_study
from fvswell.study.study import Study
from fvswell.version import __version__

__all__ = ["PaperResults", "paper_results"]


@dataclass(frozen=True)
class PaperResults:
    """Everything that the paper's figures show."""

    compression: Comparison
    swelling: Comparison
    sweep: xr.Dataset
    points: StudyPoints  # of the sweep
    fits: dict[str, CurveFit]
    block: ReducedFit  # of the permeability, to the displacement of the probe in the last phase


def paper_results(
    compression: Case,
    swelling: Case,
    block: Case,
    sweep: Study,
    path: Path,
    processes: int | None = None,
    report: Callable[[StudyProgress], None] | None = None,
) -> PaperResults:
    """Run what the paper's figures need.

    Parameters
    ----------
    compression, swelling
        The two protocols of a column, each with a phase of loading and one of unloading.
    block
        The two-dimensional case, with a phase of swelling and one of compression.
    sweep
        The study over tissue properties.
    path
        File of its result. One that exists already is reused if it is of the same study and program.
    processes
        Number of processes for the sweep.
    report
        Called with the sweep's progress.

    Raises
    ------
    CaseError
        If a case is not of a column or block with two phases, or the sweep lacks compression or swelling.
    OutputError
        If files cannot be written.
    SolverError
        If a run of the cases had to stop.
    """
    _check(compression, swelling, block, sweep)
    pressed, swollen = compare(compression), compare(swelling)
    fitted = fit_reduced_model(
        reduced_problem(block, "hydraulic_permeability", PAPER_MODELS[1], [block.phase[-1].name])
    )
    dataset = _finished_sweep(sweep, path)
    if dataset is None:
        run_study(sweep, path, processes=processes, replace=True, report=report)
        dataset = read_study(path)
    points = study_points(dataset)
    return PaperResults(pressed, swollen, dataset, points, paper_fits(points), fitted)


def _check(compression: Case, swelling: Case, block: Case, sweep: Study) -> None:
    """Refuse what the figures cannot be drawn from."""
    for case, kind in ((compression, "column"), (swelling, "column"), (block, "plane-strain")):
        if case.geometry.kind != kind or len(case.phase) != 2:
            message = f"must be of geometry {kind} with two phases, as in the paper"
            raise CaseError([Problem("phase", shown([phase.name for phase in case.phase]), message)], case.source)
    kinds = {kind_of_change(*pair).item() for case in sweep.cases for pair in pairwise(conditions_of([case]))}
    missing = [curve for index, curve in enumerate(CURVES) if index not in kinds]
    if missing:
        raise CaseError([Problem("protocol", "", f"the sweep needs phases of {'; '.join(missing)}")], sweep.source)


def _finished_sweep(sweep: Study, path: Path) -> xr.Dataset | None:
    """The result of the sweep if it exists already."""
    if not path.exists():
        return None
    dataset = read_study(path)
    same = dataset.attrs["study_sha256"] == sweep.sha256
    return dataset if same and dataset.attrs["source"].startswith(f"fvswell {__version__},") else None
