"""A study cut into batches, and the work of one batch: runs of one protocol that march together in each model."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

import fvswell
from fvswell.case.case import Case
from fvswell.physics.tissue import Array
from fvswell.prediction.predictor import coefficient_of_determination
from fvswell.results.file import COMPLETE
from fvswell.simulation.relaxation import overlong_ramps, phase_durations, unrelaxed_phase
from fvswell.study.fields import STRAIN_CURVES
from fvswell.study.sampling import ModelHistory, model_history
from fvswell.study.study import Study

__all__ = ["LARGEST_BATCH", "Batch", "BatchResult", "plan", "run_batch"]

# Rows: a run costs half as much among 200 as among 50, and hardly less among 1000; but every core should have work.
LARGEST_BATCH = 200
_SMALL_BATCH, _FEWEST_BATCHES = 50, 4
_ROW_BY_ROW = ("tissue.", "bath.", "phase.", "time.relaxation_fraction")  # what rows of a batch may differ in

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
    """Cut the possible runs of a study into batches, the same ones whoever computes them.

    Runs of a batch share protocol, grid and time stepping, and there are at most ``LARGEST_BATCH`` of them; in a small
    study fewer, so that there is work for several cores.
    """
    shared = [i for i, p in enumerate(study.table.parameter) if any(not key.startswith(_ROW_BY_ROW) for key in p.key)]
    groups: dict[tuple[int, str], list[int]] = defaultdict(list)
    for run in range(len(study.runs)):
        if run not in study.impossible:
            groups[int(study.runs.protocol[run]), repr(study.runs.values[run, shared])].append(run)
    possible = len(study.runs) - len(study.impossible)
    rows = min(LARGEST_BATCH, max(_SMALL_BATCH, math.ceil(possible / _FEWEST_BATCHES)))
    parts = [
        (protocol, part)
        for (protocol, _), runs in groups.items()
        for part in np.array_split(runs, math.ceil(len(runs) / rows))
    ]
    texts = [case.to_toml() for case in study.cases]
    return [
        Batch(
            index, tuple(map(int, runs)), texts[protocol], tuple(study.changes(run) for run in runs),
            study.models, study.table.strain_curves, fvswell.__version__,
        )
        for index, (protocol, runs) in enumerate(parts)
    ]  # fmt: skip


def run_batch(batch: Batch) -> BatchResult:
    """Run both models for every parameter set of a batch.

    A run that fails in a model, or has no relaxation time, is told in ``run_status`` and leaves nan.

    Raises
    ------
    RuntimeError
        If this is another version of fvswell than the one that made the batch.
    """
    if batch.version != fvswell.__version__:
        raise RuntimeError(f"this worker has fvswell {fvswell.__version__}, but the study needs {batch.version}")
    base = Case.from_toml(batch.case_toml)
    cases = [base.with_changes(changes) for changes in batch.changes]
    duration = phase_durations(cases)
    status = np.array([_duration_status(*each) for each in zip(cases, duration, strict=True)], dtype=object)
    rows = np.flatnonzero(status == "")
    result = _nothing(len(cases), len(base.phase), base.time.samples_per_phase)
    result["phase_duration"] = duration
    if len(rows):
        histories = [model_history([cases[row] for row in rows], model, duration[rows]) for model in batch.models]
        for name, values in _compared(histories, duration[rows]).items():
            result[name][rows] = values
        for column, history in enumerate(histories):
            for name in ("equilibrium_strain", "initial_height", "balance_error"):
                result[name][rows, column] = getattr(history, name)
            result[STRAIN_CURVES][rows, column] = history.strain
            result["final_strain"][rows, column] = history.strain[..., -1]
        status[rows] = _statuses(batch.models, histories)
    if not batch.strain_curves:
        del result[STRAIN_CURVES]
    return result | {"run_status": status.astype(str)}


def _duration_status(case: Case, duration: Array) -> str:
    """What is wrong with the durations found for a run; nothing if it can be run."""
    return unrelaxed_phase(case, duration) or "; ".join(map(str, overlong_ramps(case, duration)))


def _nothing(rows: int, phases: int, samples: int) -> BatchResult:
    shapes = {
        "r_squared": (phases,), "largest_difference": (phases,), "time_of_largest_difference": (phases,),
        "equilibrium_strain": (2, phases), "final_strain": (2, phases), "initial_height": (2,), "balance_error": (2,),
        STRAIN_CURVES: (2, phases, samples),
    }  # fmt: skip
    return {name: np.full((rows, *shape), np.nan) for name, shape in shapes.items()}


def _compared(histories: list[ModelHistory], duration: Array) -> BatchResult:
    """How well the first model stands in for the second in each phase, ``(rows, phases)``."""
    judged, reference = histories
    difference = judged.strain - reference.strain
    samples = difference.shape[-1]
    farthest = np.argmax(np.abs(difference), axis=-1)
    largest = np.take_along_axis(difference, farthest[..., None], axis=-1)[..., 0]
    time = duration * (farthest + 1) / samples
    return {
        "r_squared": coefficient_of_determination(reference.strain, judged.strain),
        "largest_difference": largest,
        "time_of_largest_difference": np.where(np.isnan(largest), np.nan, time),
    }


def _statuses(models: tuple[str, str], histories: list[ModelHistory]) -> list[str]:
    """One line for every row."""
    rows = zip(*(history.problem for history in histories), strict=True)
    told = [
        "; ".join(f"{model}: {problem}" for model, problem in zip(models, problems, strict=True) if problem)
        for problems in rows
    ]
    return [text or COMPLETE for text in told]
