"""The predictor for cases: which uniform columns, loads and durations they stand for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import lru_cache

import numpy as np

from fvswell.case.case import Case, CaseError
from fvswell.case.errors import Problem, shown
from fvswell.case.schema import ColumnGeometry
from fvswell.case.values import Ramp, RelaxationTimes, final_value
from fvswell.column.grid import ColumnGrid, column_grid
from fvswell.physics.electrochemistry import ion_concentrations
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.permeability import open_circuit_ratio
from fvswell.physics.tissue import Array, Tissue
from fvswell.prediction.predictor import Conditions, Prediction, predict

__all__ = ["bath_osmotic_coefficients", "conditions_of", "is_uniform", "mean_tissue", "predict_cases", "unpredictable"]


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
    first = cases[0]
    tissue, bath = mean_tissue(cases), bath_osmotic_coefficients(cases)
    told = [[phase.duration for phase in case.phase] for case in cases]
    return predict(
        tissue,
        _column([case.geometry.height for case in cases]),
        bath,
        conditions_of(cases),
        linearised_at,
        phase_duration=np.array([[d if isinstance(d, float) else np.nan for d in row] for row in told]),
        open_circuit_ratio=_constant_open_circuit_ratio(cases, tissue, bath),
        relaxation_times=np.array(
            [[d.multiple if isinstance(d, RelaxationTimes) else np.nan for d in row] for row in told]
        ),
        relaxation_fraction=first.time.relaxation_fraction,
        steps_per_phase=first.time.samples_per_phase,
    )


def unpredictable(case: Case) -> list[Problem]:
    """What of a case the predictor does not cover: it is for columns and for pressures of the piston."""
    if case.geometry.kind != "column":
        return [Problem("geometry.kind", shown(case.geometry.kind), "must be column: only columns can be predicted")]
    return [
        Problem(
            f"phase.{phase.name}.piston_displacement", "", "is prescribed: only phases with a pressure can be predicted"
        )
        for phase in case.phase
        if phase.piston_displacement is not None
    ]


def is_uniform(case: Case) -> bool:
    """Whether the tissue is the same at all depths."""
    tissue = case.tissue_at(_grid(case.geometry).centres)
    return all(np.size(getattr(tissue, f.name)) == 1 for f in fields(Tissue) if f.name != "solid")


def mean_tissue(cases: Sequence[Case]) -> Tissue:
    """Mean properties of the tissue of each case over its stress-free volume, arrays of shape ``(cases, 1)``."""
    tissues = [case.tissue_at(_grid(case.geometry).centres) for case in cases]
    names = [f.name for f in fields(Tissue) if f.name != "solid"]

    def mean(name: str) -> Array:
        values = [getattr(tissue, name) for tissue in tissues]
        return _column(
            [
                value.item() if value.size == 1 else value[0] @ _grid(case.geometry).widths / case.geometry.height
                for value, case in zip(values, cases, strict=True)
            ]
        )

    return Tissue(cases[0].tissue.solid, **{name: mean(name) for name in names})


def bath_osmotic_coefficients(cases: Sequence[Case]) -> Array:
    """phi_ext of each case, ``(cases, 1)``."""
    return _column([case.bath.osmotic_coefficient for case in cases])


def conditions_of(cases: Sequence[Case]) -> list[Conditions]:
    """Conditions before the first phase and in each phase, arrays of shape ``(cases, 1)``."""
    bath = _column([case.bath.concentration for case in cases])
    conditions = [Conditions(np.zeros_like(bath), bath)]
    for phases in zip(*(case.phase for case in cases), strict=True):
        pressures = [phase.piston_pressure for phase in phases]
        baths = [phase.bath_concentration for phase in phases]
        before = conditions[-1].bath_concentration
        after = _column([np.nan if value is None else final_value(value) for value in baths])
        conditions.append(
            Conditions(
                _column([np.nan if value is None else final_value(value) for value in pressures]),
                np.where(np.isnan(after), before, after),
                _column([value.over if isinstance(value, Ramp) else 0.0 for value in pressures]),
                _column([value.over if isinstance(value, Ramp) else 0.0 for value in baths]),
            )
        )
    return conditions


@lru_cache
def _grid(geometry: ColumnGeometry) -> ColumnGrid:
    return column_grid(geometry.height, geometry.cells, geometry.grading)


def _column(values: Sequence[float]) -> Array:
    return np.array(values, dtype=float)[:, None]


def _constant_open_circuit_ratio(cases: Sequence[Case], tissue: Tissue, bath: Array) -> Array | None:
    """k_open/k that the biphasic-swelling model keeps, None if it follows the state."""
    kept = cases[0].open_circuit_permeability
    if kept == "state":
        return None
    if kept == "none":
        return np.ones((len(cases), 1))
    concentration = _column([case.bath.concentration for case in cases])
    J = equilibrium_volume_ratio(tissue, 0.0, concentration, bath, swelling=True)
    ions = ion_concentrations(tissue, J, np.log(concentration))
    return open_circuit_ratio(tissue, J, *ions)
