"""The predictor for cases: which uniform columns, loads and durations they stand for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from fvswell.case.acting_loads import acting_loads
from fvswell.case.boundary import ColumnBoundary
from fvswell.case.case import Case, CaseError
from fvswell.case.column_checks import piston_pressure
from fvswell.case.errors import Problem, shown
from fvswell.case.geometry import ColumnGeometry
from fvswell.case.loads import Ramp, Shape, Sine, TableLoad, final_value, shape_of
from fvswell.case.reference_state import stress_free
from fvswell.case.values import RelaxationTimes
from fvswell.column.grid import ColumnGrid, column_grid
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import ELECTROCHEMICAL
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations
from fvswell.physics.permeability import open_circuit_ratio
from fvswell.physics.tissue import Array, Tissue, first_rows, fixed_charge_density, tissue_at, tissue_parameters
from fvswell.prediction.predictor import Conditions, Prediction, predict

__all__ = ["conditions_of", "is_uniform", "mean_tissue", "predict_cases", "stress_free_heights", "unpredictable"]


def predict_cases(cases: Sequence[Case], linearised_at: Array | float | None = None) -> Prediction:
    """Predict what the models do in cases that share their phases, as `fvswell.prediction.predictor.predict` does.

    Tissue that varies with depth is taken to be uniform, with its mean properties.

    Raises
    ------
    CaseError
        If a case is `unpredictable`.
    """
    for case in cases:
        if problems := unpredictable(case):
            raise CaseError(problems, case.source)
    first, tissue = cases[0], mean_tissue(cases)
    given = [[phase.duration for phase in case.phase] for case in cases]
    return predict(
        tissue,
        stress_free_heights(cases),
        conditions_of(cases),
        linearised_at,
        phase_duration=np.array([[d if isinstance(d, float) else np.nan for d in row] for row in given]),
        open_circuit_ratio=_kept_open_circuit_ratio(cases, tissue),
        relaxation_times=np.array(
            [[d.multiple if isinstance(d, RelaxationTimes) else np.nan for d in row] for row in given]
        ),
        relaxation_fraction=first.time.relaxation_fraction,
        steps_per_phase=first.time.samples_per_phase,
    )


def unpredictable(case: Case) -> list[Problem]:
    """What of a case the predictor does not cover: it is for columns and for pressures of the piston."""
    if not isinstance(case.geometry, ColumnGeometry):
        return [Problem("geometry.kind", shown(case.geometry.kind), "must be column: only columns can be predicted")]
    if case.parts != ColumnBoundary().parts():
        return [Problem("boundary", "", "has another open end or a current: only a closed piston can be predicted")]
    problems = []
    for phase, acting in zip(case.phase, acting_loads(case), strict=True):
        place = f"phase.{phase.name}"
        if "piston.displacement" in acting:
            problems.append(
                Problem(f"{place}.piston.displacement", "", "is prescribed: only pressures can be predicted")
            )
        for name, load in acting.items():
            if isinstance(load, TableLoad | Sine):
                problems.append(
                    Problem(f"{place}.{name}", "", "is a table or a sine: only steps and ramps can be predicted")
                )
        if phase.until is not None:
            problems.append(Problem(f"{place}.until", "", "only phases of given durations can be predicted"))
    return problems


def is_uniform(case: Case) -> bool:
    """Whether the tissue is the same at all points."""
    return not case.tissue.profiles


def mean_tissue(cases: Sequence[Case]) -> Tissue:
    """Mean properties of the tissue of each column over its stress-free volume, arrays of shape ``(cases,)``."""
    means = []
    for case in cases:
        tissue, widths = _stress_free_column(case)
        means.append(tissue_parameters(tissue, len(widths)) @ (widths / widths.sum()))
    laws = type(tissue.solid), type(tissue.permeability), type(tissue.osmotic)
    mean: Tissue = tissue_at(*laws, first_rows(*laws), np.stack(means, axis=1), slice(None))
    return mean


def stress_free_heights(cases: Sequence[Case]) -> Array:
    """Height of each column without stress, mm, ``(cases,)``."""
    return np.array([_stress_free_column(case)[1].sum() for case in cases])


def _stress_free_column(case: Case) -> tuple[Tissue, Array]:
    """Tissue in the cells of a column, and their widths without stress, mm."""
    grid = _grid(case.geometry)
    tissue, swollen = stress_free(case, case.tissue_at(grid.centres), ELECTROCHEMICAL)
    return tissue, grid.widths / swollen


def conditions_of(cases: Sequence[Case]) -> list[Conditions]:
    """Conditions before the first phase and in each phase, arrays of shape ``(cases,)``."""
    bath = np.array([case.bath.concentration for case in cases])
    conditions = [Conditions(np.zeros_like(bath), bath)]
    for acting in zip(*(acting_loads(case) for case in cases), strict=True):
        pairs = [
            (piston_pressure(case, each), shape_of(each["filter.bath_concentration"]))
            for case, each in zip(cases, acting, strict=True)
        ]
        targets = (np.array([_target(load) for load in loads]) for loads in zip(*pairs, strict=True))
        ramps = (np.array([_duration(load) for load in loads]) for loads in zip(*pairs, strict=True))
        conditions.append(Conditions(*targets, *ramps))
    return conditions


def _target(load: Shape | None) -> float:
    return np.nan if load is None else final_value(load)


def _duration(load: Shape | None) -> float:
    return load.over if isinstance(load, Ramp) else 0.0


@lru_cache
def _grid(geometry: ColumnGeometry) -> ColumnGrid:
    return column_grid(geometry.height, geometry.cells, geometry.grading)


def _kept_open_circuit_ratio(cases: Sequence[Case], tissue: Tissue) -> Array | float | None:
    """k_open/k that the biphasic-swelling model keeps, None if it follows the state."""
    kept = cases[0].open_circuit_permeability
    if kept == "state":
        return None
    if kept == "none":
        return 1.0
    bath = np.array([case.bath.concentration for case in cases])
    J = equilibrium_volume_ratio(tissue, 0.0, bath)
    activity = bath_log_activity(tissue.osmotic, bath)
    ratio: Array = open_circuit_ratio(
        tissue, J, *ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
    )
    return ratio
