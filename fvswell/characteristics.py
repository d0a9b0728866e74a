"""Numbers that tell what to expect of a case before it is run: rest states, times and permeabilities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvswell.case import Case
from fvswell.column_batch import ColumnBatch
from fvswell.electrochemistry import ion_concentrations
from fvswell.models import ELECTROCHEMICAL, MODELS
from fvswell.permeability import hydraulic_permeability, open_circuit_permeability
from fvswell.tissue import Array, Tissue

__all__ = ["Characteristics", "RestStates", "characteristics", "salt_diffusivity"]


@dataclass(frozen=True)
class RestStates:
    """Where a model is at rest; nan where it has no water left."""

    initial_stretch: float  # height of the equilibrated sample over that of the stress-free solid
    equilibrium_strain: tuple[float, ...]  # under the loads that each phase ends with


@dataclass(frozen=True)
class Characteristics:
    """Derived numbers of a case."""

    rest: dict[str, RestStates]  # by model
    open_circuit_ratio: tuple[float, float]  # k_open/k of the equilibrated sample, least and largest
    consolidation_time: float  # h^2/(k H), s
    diffusion_time: float  # h^2 over the least salt diffusivity in the equilibrated sample, s


def characteristics(case: Case) -> Characteristics:
    """Derived numbers of a case."""
    batches = {name: ColumnBatch.of([case], model) for name, model in MODELS.items()}
    full = batches[ELECTROCHEMICAL.name]
    tissue, J = full.cells.tissue, full.initial_volume_ratio
    ions = ion_concentrations(tissue, J, np.log(case.bath.concentration))
    ratio = open_circuit_permeability(tissue, J, *ions) / hydraulic_permeability(tissue, J)
    diffusivity = salt_diffusivity(tissue, *ions).min()
    return Characteristics(
        rest={name: _rest_states(batch) for name, batch in batches.items()},
        open_circuit_ratio=(float(ratio.min()), float(ratio.max())),
        consolidation_time=float(full.consolidation_time()[0]),
        diffusion_time=float(full.initial_height[0] ** 2 / diffusivity),
    )


def salt_diffusivity(tissue: Tissue, cation: Array, anion: Array) -> Array:
    """Diffusivity of salt in charged tissue where no current flows and the solid is held, mm2/s.

    D = (c+ + c-) D+ D-/(c+ D+ + c- D-): the slower ion is pulled along by the faster one, and the co-ion,
    being the scarce one, counts most.
    """
    D_cation, D_anion = tissue.cation_diffusivity, tissue.anion_diffusivity
    return (cation + anion) * D_cation * D_anion / (cation * D_cation + anion * D_anion)


def _rest_states(batch: ColumnBatch) -> RestStates:
    height = float(batch.initial_height[0])
    strain = batch.equilibrium_heights()[0] / height - 1.0
    return RestStates(height / float(batch.grid.widths.sum()), tuple(strain.tolist()))
