"""The laws of a case's tissue as curves, and where on them the case works."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fvswell.case.case import Case
from fvswell.case.equilibrium_states import equilibrium_states
from fvswell.case.reference_state import stress_free
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.fibres import ground_and_families
from fvswell.physics.models import ELECTROCHEMICAL
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations, osmotic_pressure_difference
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import cauchy_stress
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density

__all__ = ["BATHS", "TissueCurves", "WorkingPoint", "tissue_curves"]

BATHS = np.geomspace(5e-6, 2e-3, 121)  # mmol/mm3
_DRAWN_BATHS = (1.5e-5, 1.5e-4, 1e-3)
_POINTS = 161
_MARGIN = 0.15  # of J around the working points
_NEAREST_TO_DRY = 0.02  # of the water in the stress-free solid
_LOADS = 61


@dataclass(frozen=True)
class WorkingPoint:
    """An equilibrium of the case's protocol, as a column would have it."""

    name: str  # of the phase, or "start"
    volume_ratio: float
    pressure: float  # of the piston, MPa
    bath: float  # mmol/mm3


@dataclass(frozen=True)
class TissueCurves:
    """Curves of a tissue; of one that varies, those of its mean properties.

    Stretches are along one axis, the others held, so that J is the stretch. Arrays over J are ``(points,)``, over baths
    ``(BATHS,)``; dictionaries are by bath (mmol/mm3), by load (MPa) or by direction ("y" is the axis).
    """

    tissue: Tissue
    volume_ratio: Array
    ground_stress: Array  # MPa, tension positive
    fibre_stress: dict[str, Array]  # by direction; nothing without fibres
    swelling_pressure: dict[float, Array]  # pi - pi_bath over J, by bath
    swelling_by_bath: dict[float, Array]  # over BATHS, by J
    permeability: Array  # over J
    open_circuit_permeability: dict[float, Array]  # over J, by bath
    loads: Array  # MPa
    equilibrium_by_load: dict[float, Array]  # J over loads, by bath
    equilibrium_by_bath: dict[float, Array]  # J over BATHS, by load
    partition: tuple[Array, Array]  # c+ and c- over the bath's, over BATHS, at the J of the start
    working_points: tuple[WorkingPoint, ...]
    varies: bool


def tissue_curves(case: Case) -> TissueCurves:
    """Curves of the tissue of a case about the states that its protocol comes to."""
    tissue = _mean_tissue(case)
    working = _working_points(case, tissue)
    ratios = np.array([point.volume_ratio for point in working])
    dry = float(1.0 - tissue.fluid_fraction)
    low, high = np.nanmin([*ratios, 1.0]) - _MARGIN, np.nanmax([*ratios, 1.0]) + _MARGIN
    J = np.linspace(max(low, dry + _NEAREST_TO_DRY * (1.0 - dry)), high, _POINTS)
    baths = sorted({point.bath for point in working} | {b for b in _DRAWN_BATHS if _apart(b, working)})
    start = working[0]
    pressures = sorted({point.pressure for point in working})
    largest = max(
        *map(abs, pressures), float(osmotic_pressure_difference(tissue, start.volume_ratio, start.bath)), 0.05
    )
    loads = np.linspace(min(0.0, *pressures), 1.2 * largest, _LOADS)
    levels = pressures if len(pressures) > 1 else [pressures[0], 0.5 * largest]
    ground, families = ground_and_families(tissue.solid)
    axes = ("y",) if case.geometry.kind == "column" else ("x", "y")
    with np.errstate(all="ignore"):  # where there is no equilibrium, there is no curve
        return TissueCurves(
            tissue=tissue,
            volume_ratio=J,
            ground_stress=_stress(ground, tissue, J, "y"),
            fibre_stress={
                axis: _stress(tissue.solid, tissue, J, axis) - _stress(ground, tissue, J, axis) for axis in axes
            }
            if families
            else {},
            swelling_pressure={bath: osmotic_pressure_difference(tissue, J, bath) for bath in baths},
            swelling_by_bath={
                float(at): osmotic_pressure_difference(tissue, at, BATHS) for at in _distinct([*ratios, 1.0])
            },
            permeability=np.broadcast_to(hydraulic_permeability(tissue, J), J.shape),
            open_circuit_permeability={bath: _open_circuit(tissue, J, bath) for bath in baths},
            loads=loads,
            equilibrium_by_load={bath: equilibrium_volume_ratio(tissue, loads, bath) for bath in baths},
            equilibrium_by_bath={load: equilibrium_volume_ratio(tissue, load, BATHS) for load in levels},
            partition=_partition(tissue, start.volume_ratio),
            working_points=working,
            varies=bool(case.tissue.profiles),
        )


def _mean_tissue(case: Case) -> Tissue:
    """Stress-free tissue with the mean of every number over evenly spread points."""
    points = case.geometry.sample_points(list(case.tissue.profiles.values()))
    tissue, _ = stress_free(case, case.tissue_at(points), ELECTROCHEMICAL)

    def mean(part: Any) -> Any:
        return type(part)(*map(mean, part)) if isinstance(part, tuple) else float(np.mean(part))

    found: Tissue = mean(tissue)
    return found


def _working_points(case: Case, tissue: Tissue) -> tuple[WorkingPoint, ...]:
    """States that the protocol comes to, each once; those that no column comes to are left out."""
    points: dict[tuple[float, float], WorkingPoint] = {}
    for state in equilibrium_states(case):
        J = float(equilibrium_volume_ratio(tissue, state.pressure, state.bath))
        if not np.isnan(J):
            points.setdefault((state.pressure, state.bath), WorkingPoint(state.name, J, state.pressure, state.bath))
    return tuple(points.values())


def _apart(bath: float, working: tuple[WorkingPoint, ...]) -> bool:
    """Whether a bath is not nearly one of the case."""
    return all(abs(np.log(bath / point.bath)) > 0.3 for point in working)


def _distinct(ratios: list[float]) -> list[float]:
    """Volume ratios of which no two are nearly alike."""
    found: list[float] = []
    for ratio in ratios:
        if all(abs(ratio - other) > 0.02 for other in found):
            found.append(ratio)
    return found


def _stress(solid: Any, tissue: Tissue, stretch: Array, axis: str) -> Array:
    """Cauchy stress along an axis that alone is stretched."""
    one, none = np.ones_like(stretch), np.zeros_like(stretch)
    along_x = axis == "x"
    F = (stretch if along_x else one, none, none, one if along_x else stretch, one)
    sigma = cauchy_stress(solid, tissue.fluid_fraction, F)
    value: Array = sigma.xx if along_x else sigma.yy
    return value


def _open_circuit(tissue: Tissue, J: Array, bath: float) -> Array:
    ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), bath_log_activity(tissue.osmotic, bath))
    value: Array = hydraulic_permeability(tissue, J) * open_circuit_ratio(tissue, J, *ions)
    return value


def _partition(tissue: Tissue, J: float) -> tuple[Array, Array]:
    charge = fixed_charge_density(tissue, J)
    cation, anion = ion_concentrations(tissue.osmotic, charge, bath_log_activity(tissue.osmotic, BATHS))
    return cation / BATHS, anion / BATHS
