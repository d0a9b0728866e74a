"""Values of a case that are legal and hardly meant, such as a wrong unit, and what each implies.

All limits stand in `RANGES`, with their sources.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from fvswell.case.case import Case
from fvswell.case.column_checks import longest
from fvswell.case.equilibrium_states import EquilibriumState, equilibrium_states
from fvswell.case.errors import Finding, Location, Problem
from fvswell.case.geometry import BlockGeometry
from fvswell.case.loads import extremes, final_value, in_length
from fvswell.case.profiles import DepthProfile, PlaneProfile
from fvswell.case.reading import problems_of, value_type
from fvswell.case.reference_state import stress_free
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS
from fvswell.physics.osmotic import osmotic_pressure_difference
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue
from fvswell.physics.tissue import fixed_charge_density as charge_density

__all__ = ["RANGES", "Range", "warnings_of"]

_DRAWS_OUT = -1e-6  # MPa: a swelling pressure below this is not rounding


class Range(NamedTuple):
    """What values are usually within, in internal units, and who says so."""

    low: float
    high: float
    source: str

    def holds(self, value: float) -> bool:
        """Whether a value is as usual."""
        return self.low <= value <= self.high


_STIFFNESS = Range(1e-5, 1e3, "from brain tissue and soft gels (below 1 kPa) to tendon (hundreds of MPa)")
RANGES: dict[str, Range] = {  # by key of the case, or by what is derived from it
    "bath.concentration": Range(1e-8, 6.2e-3, "sodium chloride dissolves up to 6.1 M at 25 degC (CRC Handbook)"),
    "bath.temperature": Range(273.15, 333.0, "water freezes at 273.15 K, and collagen denatures from about 333 K on"),
    "tissue.youngs_modulus": _STIFFNESS,
    "tissue.shear_modulus": _STIFFNESS,
    "tissue.hydraulic_permeability": Range(
        1e-8, 1e2, "cartilage has 1e-4 to 1e-2 mm^4/(N s) (Mow & Guo 2002), loose gels and clots up to 1e2"
    ),
    "tissue.permeability_coefficient": Range(1e-8, 1e2, "as the permeability of cartilage, of discs and of gels"),
    "tissue.fixed_charge_density": Range(0.0, 1e-3, "cartilage and discs have 0.02 to 0.5 M (Maroudas 1979)"),
    "tissue.cation_diffusivity": Range(1e-7, 1e-2, "small ions in water have 1e-3 to 2e-3 mm^2/s, in tissue less"),
    "tissue.anion_diffusivity": Range(1e-7, 1e-2, "small ions in water have 1e-3 to 2e-3 mm^2/s, in tissue less"),
    "strain": Range(-0.6, 0.6, "the laws of the solid are fitted to tests of up to about 50 %"),
    "consolidation time": Range(1e-3, 3.156e7, "tests last from milliseconds to months"),
}


def warnings_of(case: Case) -> list[Problem]:
    """What is legal in a case and hardly meant, each with what it implies."""
    with np.errstate(all="ignore"):  # absurd numbers may overflow
        findings = list(_findings(case))
    return problems_of(type(case), case.content, findings)


def _findings(case: Case) -> Iterator[Finding]:
    yield from _unusual_values(case)
    points = case.geometry.sample_points(list(case.tissue.profiles.values()))
    tissue, swollen = stress_free(case, case.tissue_at(points), MODELS[case.model])
    yield from _unusual_consolidation(case, tissue)
    states = list(equilibrium_states(case))
    J = [np.atleast_1d(equilibrium_volume_ratio(tissue, state.pressure, state.bath)) for state in states]
    yield from _unusual_strains(states, J, np.atleast_1d(swollen))
    yield from _unusual_displacements(case)
    if MODELS[case.model].swelling:
        yield from _drawn_out(tissue, states, J)


def _unusual_values(case: Case) -> Iterator[Finding]:
    """Keys outside their ranges."""
    for name in ("bath", "tissue"):
        table = getattr(case, name)
        for key, value in table:
            usual = RANGES.get(f"{name}.{key}")
            numbers = _numbers(value)
            if usual is None or all(map(usual.holds, numbers)):
                continue
            reader = value_type(type(table).model_fields[key])
            unit = reader.unit if reader is not None else ""
            worst = next(number for number in numbers if not usual.holds(number))
            yield Finding(
                (name, key),
                f"is {worst:.4g} {unit}, and usual are {usual.low:g} to {usual.high:g} {unit}: {usual.source}; is the "
                "unit as meant?",
            )
    usual = RANGES["bath.concentration"]
    for phase, each in enumerate(case.phase):
        baths: dict[Location, Any] = {("bath_concentration",): each.bath_concentration}
        baths |= {(name, "bath_concentration"): loads.bath_concentration for name, loads in each.part_loads()}
        for place, load in baths.items():
            value = np.nan if load is None else final_value(load, longest(each))
            if load is not None and not usual.holds(value):
                yield Finding(
                    ("phase", phase, *place),
                    f"is {value:.4g} mmol/mm^3, and usual are {usual.low:g} to {usual.high:g} mmol/mm^3: "
                    f"{usual.source}; is the unit as meant?",
                )


def _numbers(value: Any) -> tuple[float, ...]:
    """All numbers of a value that may vary in space."""
    if isinstance(value, DepthProfile):
        return value.value
    if isinstance(value, PlaneProfile):
        return tuple(number for row in value.value for number in row)
    return (value,) if isinstance(value, float) else ()


def _extent(case: Case) -> tuple[float, ...]:
    geometry: Any = case.geometry
    return geometry.extent if isinstance(geometry, BlockGeometry) else (geometry.height,)


def _unusual_consolidation(case: Case, tissue: Tissue) -> Iterator[Finding]:
    """Samples that give way at once, or never."""
    mobility = hydraulic_permeability(tissue, 1.0) * aggregate_modulus(tissue.solid, tissue.fluid_fraction)
    time, usual = min(_extent(case)) ** 2 / float(np.max(mobility)), RANGES["consolidation time"]
    if not usual.holds(time):
        yield Finding(
            ("geometry", "height"),
            f"with this permeability and stiffness the sample consolidates in h^2/(k H) = {time:.3g} s; {usual.source}",
        )


def _unusual_strains(states: list[EquilibriumState], ratios: list[Array], swollen: Array) -> Iterator[Finding]:
    """Equilibria far from the first one, and a first one far from the stress-free solid."""
    usual = RANGES["strain"]
    for state, J in zip(states, ratios, strict=True):
        first = state is states[0]
        strain = J / swollen - 1.0 if first else J / ratios[0] - 1.0
        worst = float(strain[np.argmax(np.abs(strain))])
        if usual.holds(worst):
            continue
        of = "stress-free solid" if first else "sample in its first bath"
        yield Finding(
            state.location,
            f"leads to a strain of {100.0 * worst:+.0f} % in equilibrium, over the {of}; {usual.source}",
        )


def _unusual_displacements(case: Case) -> Iterator[Finding]:
    """Displacements that are large beside the sample."""
    usual, extent = RANGES["strain"], _extent(case)
    edges = {part.name: part.edge for part in case.parts}
    for index, phase in enumerate(case.phase):
        for name, load in phase.loads().items():
            part, _, kind = name.partition(".")
            if kind != "displacement":
                continue
            axis = 0 if edges.get(part) in ("left", "right") else -1
            moved = extremes(in_length(load, extent[axis]), longest(phase), 0.0)
            strain = max(moved, key=abs) / extent[axis]
            if not usual.holds(strain):
                yield Finding(
                    ("phase", index),
                    f"the {part} moves by {100.0 * strain:+.0f} % of the sample; {usual.source}",
                )


def _drawn_out(tissue: Tissue, states: list[EquilibriumState], ratios: list[Array]) -> Iterator[Finding]:
    """Baths in which the ions draw water out of the tissue, at the state before they come and at that after."""
    seen: set[float] = set()
    for index, (state, J) in enumerate(zip(states, ratios, strict=True)):
        worst, at = 0.0, 0.0
        for ratio in (J, ratios[max(index - 1, 0)]):
            difference = np.atleast_1d(osmotic_pressure_difference(tissue, ratio, state.bath))
            charge = np.broadcast_to(charge_density(tissue, ratio), difference.shape)
            place = int(np.nanargmin(difference)) if not np.isnan(difference).all() else 0
            if difference[place] < worst:
                worst, at = float(difference[place]), float(charge[place])
        if worst < _DRAWS_OUT and state.bath not in seen:
            seen.add(state.bath)
            yield Finding(
                state.location,
                f"pi - pi_bath is {worst:.3g} MPa where the fixed charge is {1e3 * at:.3g} M in this bath of "
                f"{1e3 * state.bath:.3g} M: by these osmotic coefficients the charge draws water out instead of in, "
                f"down to J = {float(np.nanmin(J)):.3f}. They hold about the charge and the baths they were fitted to; "
                'osmotic = "activity" holds in any',
            )
