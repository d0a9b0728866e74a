"""A study cut into batches, and the work of one batch: runs of one protocol, one after the other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fvswell.case.case import Case
from fvswell.case.errors import CaseError
from fvswell.errors import SolverError
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array
from fvswell.prediction.determination import coefficient_of_determination
from fvswell.results.layout import COMPLETE
from fvswell.simulation.column_run import ColumnRun
from fvswell.simulation.relaxation import phase_durations
from fvswell.simulation.settling import ends_on_rate
from fvswell.study.fields import STRAIN_CURVES
from fvswell.study.sampling import ModelHistory, model_history
from fvswell.version import __version__

if TYPE_CHECKING:
    from fvswell.study.study import Study

__all__ = ["LARGEST_BATCH", "Batch", "BatchResult", "plan", "run_batch"]

LARGEST_BATCH = 50  # runs: some tenths of a second of work, so that little is lost and every core has its share

BatchResult = dict[str, Array]  # by name of a field of the result, the runs along the first axis


@dataclass(frozen=True)
class Batch:
    """Work that stands by itself: made of texts and numbers, so that it can be sent anywhere."""

    index: int
    runs: tuple[int, ...]
    case_toml: str
    changes: tuple[dict[str, float], ...]
    models: tuple[str, str]
    strain_curves: bool
    version: str


def plan(study: Study) -> list[Batch]:
    """Cut the possible runs of a study into batches of one protocol, the same ones whoever computes them."""
    texts = [case.to_toml() for case in study.cases]
    parts = []
    for protocol in range(len(study.cases)):
        possible = np.array([run not in study.impossible for run in range(len(study.runs))])
        runs = np.flatnonzero(possible & (study.runs.protocol == protocol))
        if len(runs):
            parts += [(protocol, part) for part in np.array_split(runs, math.ceil(len(runs) / LARGEST_BATCH))]
    return [
        Batch(
            index, tuple(map(int, runs)), texts[protocol], tuple(study.changes(run) for run in runs),
            study.models, study.table.strain_curves, __version__,
        )
        for index, (protocol, runs) in enumerate(parts)
    ]  # fmt: skip


def run_batch(batch: Batch) -> BatchResult:
    """Run both models for every parameter set of a batch.

    A run that fails in a model, or has no relaxation time, says so in ``run_status`` and leaves nan.

    Raises
    ------
    RuntimeError
        If this is another version of fvswell than the one that made the batch.
    """
    if batch.version != __version__:
        raise RuntimeError(f"this worker has fvswell {__version__}, but the study needs {batch.version}")
    base = Case.from_toml(batch.case_toml)
    result = _nothing(len(batch.changes), len(base.phase), base.time.samples_per_phase)
    status = np.empty(len(batch.changes), dtype=object)
    for row, changes in enumerate(batch.changes):
        case = base.with_numbers(changes, checked=True)
        status[row] = _run(case, batch.models, {name: values[row] for name, values in result.items()})
    if not batch.strain_curves:
        del result[STRAIN_CURVES]
    return result | {"run_status": status.astype(str)}


def _run(case: Case, models: tuple[str, str], result: BatchResult) -> str:
    """Run both models of a case and fill its row of the result; gives its status."""
    try:
        first = ColumnRun(case, MODELS[models[0]])
        reference = case.with_changes({"model": models[1]}) if ends_on_rate(case) else case
        durations = phase_durations(reference, first)
        result["phase_duration"][:] = durations
        runs = (first, ColumnRun(case, MODELS[models[1]], like=first))
        histories = [model_history(run, durations) for run in runs]
    except CaseError as error:
        return "; ".join(map(str, error.problems))
    except SolverError as error:
        return str(error).removeprefix(f"{case.source}: ")
    for name, values in _compared(histories[0], histories[1], np.array(durations)).items():
        result[name][:] = values
    for column, history in enumerate(histories):
        for name in ("equilibrium_strain", "initial_height", "balance_error"):
            result[name][column] = getattr(history, name)
        result[STRAIN_CURVES][column] = history.strain
        result["final_strain"][column] = history.strain[:, -1]
    problems = [f"{model}: {each.problem}" for model, each in zip(models, histories, strict=True) if each.problem]
    return "; ".join(problems) or COMPLETE


def _nothing(rows: int, phases: int, samples: int) -> BatchResult:
    shapes = {
        "phase_duration": (phases,), "r_squared": (phases,),
        "largest_difference": (phases,), "time_of_largest_difference": (phases,),
        "equilibrium_strain": (2, phases), "final_strain": (2, phases), "initial_height": (2,), "balance_error": (2,),
        STRAIN_CURVES: (2, phases, samples),
    }  # fmt: skip
    return {name: np.full((rows, *shape), np.nan) for name, shape in shapes.items()}


def _compared(judged: ModelHistory, reference: ModelHistory, duration: Array) -> BatchResult:
    """How well the first model stands in for the second in each phase, ``(phases,)``."""
    difference = judged.strain - reference.strain
    samples = difference.shape[-1]
    farthest = np.argmax(np.abs(difference), axis=-1)
    largest = np.take_along_axis(difference, farthest[:, None], axis=-1)[:, 0]
    time = duration * (farthest + 1) / samples
    return {
        "r_squared": coefficient_of_determination(reference.strain, judged.strain),
        "largest_difference": largest,
        "time_of_largest_difference": np.where(np.isnan(largest), np.nan, time),
    }
