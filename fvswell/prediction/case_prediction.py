"""The predictor for cases: which uniform columns, loads and durations they stand for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from fvswell.boundary.parts import CONDUCTING
from fvswell.case.acting_loads import acting_loads
from fvswell.case.case import Case, CaseError
from fvswell.case.column_checks import piston_pressure
from fvswell.case.errors import Problem, shown
from fvswell.case.geometry import ColumnGeometry
from fvswell.case.reference_state import stress_free
from fvswell.case.values import Ramp, RelaxationTimes, final_value
from fvswell.column.grid import ColumnGrid, column_grid
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import ELECTROCHEMICAL
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations
from fvswell.physics.permeability import open_circuit_ratio
from fvswell.physics.tissue import Array, Tissue, first_rows, fixed_charge_density, tissue_at, tissue_parameters
from fvswell.prediction.conditions import Conditions, Course, ramp_to
from fvswell.prediction.predictor import Prediction, predict

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
        electrode="anion" if first.parts[1].electrode == "anion" else "cation",
    )


def unpredictable(case: Case) -> list[Problem]:
    """What of a case the predictor does not know: it is for columns that water leaves through the filter alone."""
    if not isinstance(case.geometry, ColumnGeometry):
        return [Problem("geometry.kind", shown(case.geometry.kind), "must be column: only columns can be predicted")]
    filter_end, piston = case.parts
    problems = [
        Problem(f"boundary.{part.name}.{key}", shown(value), f"is not known of: {known}")
        for part, key, value, known, wrong in (
            (filter_end, "bath", "closed", "only a filter that is open can be predicted", not filter_end.open),
            (piston, "bath", "open", "only a piston that is closed can be predicted", piston.open),
            *(
                (part, "electrical", part.electrical, "only a current that is given can be predicted", True)
                for part in (filter_end, piston)
                if _conducts(case) and (part.electrical in ("potential", "floating") or not _current_names(case))
            ),
        )
        if wrong
    ]
    for phase, acting in zip(case.phase, acting_loads(case), strict=True):
        bath_pressure = acting.get("filter.bath_pressure", 0.0)
        if isinstance(bath_pressure, Ramp) or bath_pressure:
            message = "is not known of: only baths without a hydrostatic pressure can be predicted"
            problems.append(Problem(f"phase.{phase.name}.filter.bath_pressure", "", message))
    return problems


def _conducts(case: Case) -> bool:
    """Whether a current can pass the column."""
    _, piston = case.parts
    return piston.electrical in CONDUCTING


def _current_names(case: Case) -> list[str]:
    """Loads that give the current through the column, at one of its ends."""
    return [f"{part.name}.current" for part in case.parts if part.electrical == "current" and _conducts(case)]


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
        pressures = [piston_pressure(case, each) for case, each in zip(cases, acting, strict=True)]
        held = pressures[0] is None
        conditions.append(
            Conditions(
                0.0 if held else _course(pressures),
                _course([each["filter.bath_concentration"] for each in acting]),
                _course([each.get("piston.displacement", 0.0) for each in acting]) if held else None,
                _current(cases[0], acting),
            )
        )
    return conditions


def _current(case: Case, acting: Sequence[Mapping[str, float | Ramp]]) -> Course | float:
    """Current along the column, from the filter to the piston."""
    for name in _current_names(case):
        course = _course([each[name] for each in acting])
        return course if name == "filter.current" else Course(course.times, -course.values)
    return 0.0


def _course(loads: Sequence[float | Ramp | None]) -> Course:
    """The course of one load in several cases."""
    given = [load for load in loads if load is not None]
    return ramp_to(
        np.array([final_value(load) for load in given]),
        np.array([load.over if isinstance(load, Ramp) else 0.0 for load in given]),
    )


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
