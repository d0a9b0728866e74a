"""The predictor for cases: which uniform columns, loads and durations they stand for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from fvswell.boundary.parts import CONDUCTING
from fvswell.case.acting_loads import acting_loads
from fvswell.case.case import Case, CaseError
from fvswell.case.column_checks import piston_pressure
from fvswell.case.errors import Problem, shown
from fvswell.case.geometry import ColumnGeometry
from fvswell.case.loads import AnyLoad, Ramp, Shape, Sine, StrainLoad, TableLoad, final_value, shape_of
from fvswell.case.reference_state import stress_free
from fvswell.case.values import RelaxationTimes
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
    return [*_unknown_boundary(case), *_unknown_phases(case)]


def _unknown_boundary(case: Case) -> Iterator[Problem]:
    filter_end, piston = case.parts
    if not filter_end.open:
        yield Problem("boundary.filter.bath", shown("closed"), "only a filter that is open can be predicted")
    if piston.open:
        yield Problem("boundary.piston.bath", shown("open"), "only a piston that is closed can be predicted")
    elif _conducts(case) and not _current_names(case):
        message = "only a current that is given can be predicted"
        yield Problem("boundary.piston.electrical", shown(piston.electrical), message)


def _unknown_phases(case: Case) -> Iterator[Problem]:
    for phase, acting in zip(case.phase, acting_loads(case), strict=True):
        place = f"phase.{phase.name}"
        if acting.get("filter.bath_pressure", 0.0) != 0.0:
            message = "only baths without a hydrostatic pressure can be predicted"
            yield Problem(f"{place}.filter.bath_pressure", "", message)
        if phase.until is not None:
            yield Problem(f"{place}.until", "", "only phases of given durations can be predicted")
        turning = any(isinstance(shape_of(load), TableLoad | Sine) for load in acting.values())
        if turning and isinstance(phase.duration, RelaxationTimes):
            message = "tables and sines can be predicted only in a phase whose duration is in s"
            yield Problem(f"{place}.duration", shown(str(phase.duration)), message)


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
    """Conditions before the first phase and in each phase, arrays of shape ``(cases,)``.

    Raises
    ------
    ValueError
        If loads of the cases differ in more than numbers.
    """
    bath = np.array([case.bath.concentration for case in cases])
    conditions = [Conditions(np.zeros_like(bath), bath)]
    for acting in zip(*(acting_loads(case) for case in cases), strict=True):
        pressures = [piston_pressure(case, each) for case, each in zip(cases, acting, strict=True)]
        given = [pressure for pressure in pressures if pressure is not None]
        held = None if given else [_displacement(case, each) for case, each in zip(cases, acting, strict=True)]
        conditions.append(
            Conditions(
                _course(given) if given else 0.0,
                _course([shape_of(each["filter.bath_concentration"]) for each in acting]),
                None if held is None else _course(held),
                _current(cases[0], acting),
            )
        )
    return conditions


def _displacement(case: Case, acting: Mapping[str, AnyLoad]) -> Shape:
    """Displacement of the piston from the equilibrated sample, mm; 0 of one that is fixed."""
    load = acting.get("piston.displacement", 0.0)
    if not isinstance(load, StrainLoad):
        return load
    stretch = equilibrium_volume_ratio(mean_tissue([case]), 0.0, case.bath.concentration)
    return load.of(float(stress_free_heights([case]).item() * stretch.item()))


def _current(case: Case, acting: Sequence[Mapping[str, AnyLoad]]) -> Course | float:
    """Current along the column, from the filter to the piston."""
    for name in _current_names(case):
        course = _course([shape_of(each[name]) for each in acting])
        if name == "filter.current":
            return course
        return replace(course, values=-course.values, amplitude=-course.amplitude)
    return 0.0


def _course(loads: Sequence[Shape]) -> Course:
    """The course of one load in several cases."""
    tables = [load for load in loads if isinstance(load, TableLoad)]
    sines = [load for load in loads if isinstance(load, Sine)]
    if (tables and len(tables) < len(loads)) or (sines and len(sines) < len(loads)):
        raise ValueError("tables and sines cannot be predicted together with other loads in their place")
    if tables:
        times, values = np.array([load.times for load in tables]), np.array([load.values for load in tables])
        still = np.full((len(tables), 1), np.nan)  # until the first point
        return Course(np.concatenate([0.0 * times[:, :1], times], axis=1), np.concatenate([still, values], axis=1))
    if sines:
        if len({load.period for load in sines}) > 1:
            raise ValueError("sines of different periods cannot be predicted together")
        amplitude = np.array([load.amplitude for load in sines])
        return Course(np.zeros(1), np.array([[load.mean] for load in sines]), amplitude, sines[0].period)
    return ramp_to(
        np.array([final_value(load) for load in loads]),
        np.array([load.over if isinstance(load, Ramp) else 0.0 for load in loads]),
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
