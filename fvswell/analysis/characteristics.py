"""Numbers that tell what to expect of a case before it is run: rest states, times and permeabilities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvswell.case.case import BlockCase, Case
from fvswell.physics.electrochemistry import ion_concentrations
from fvswell.physics.models import ELECTROCHEMICAL, MODELS
from fvswell.physics.permeability import open_circuit_ratio
from fvswell.physics.solid import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue
from fvswell.simulation.column_batch import ColumnBatch

__all__ = ["Characteristics", "RestStates", "characteristics", "salt_diffusivity"]


@dataclass(frozen=True)
class RestStates:
    """Where a model is at rest; nan where it has no water left."""

    initial_stretch: float  # height of the equilibrated sample over that of the stress-free solid
    initial_volume_ratio: float  # volume of the equilibrated sample over that of the stress-free solid
    equilibrium_strain: tuple[float, ...]  # of columns, under the loads that each phase ends with


@dataclass(frozen=True)
class Characteristics:
    """Derived numbers of a case."""

    rest: dict[str, RestStates]  # by model
    open_circuit_ratio: tuple[float, float]  # k_open/k of the equilibrated sample, least and largest
    drainage_length: float  # farthest way to the bath, mm: of columns the height of the equilibrated sample
    consolidation_time: float  # drainage length squared/(k H), s
    diffusion_time: float  # drainage length squared over the least salt diffusivity in the equilibrated sample, s


def characteristics(case: Case) -> Characteristics:
    """Derived numbers of a case.

    Raises
    ------
    SolverError
        If no state at rest is found for a block.
    """
    if isinstance(case, BlockCase):
        return _of_block(case)
    batches = {name: ColumnBatch.of([case], model) for name, model in MODELS.items()}
    full = batches[ELECTROCHEMICAL.name]
    tissue, J = full.cells.tissue, full.initial_volume_ratio
    ions = ion_concentrations(tissue, J, np.log(case.bath.concentration))
    ratio = open_circuit_ratio(tissue, J, *ions)
    diffusivity = salt_diffusivity(tissue, *ions).min()
    return Characteristics(
        rest={name: _rest_states(batch) for name, batch in batches.items()},
        open_circuit_ratio=(float(ratio.min()), float(ratio.max())),
        drainage_length=float(full.initial_height[0]),
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
    stretch = height / float(batch.grid.widths.sum())
    return RestStates(stretch, stretch, tuple(strain.tolist()))


def _of_block(case: BlockCase) -> Characteristics:
    from fvswell.simulation.block_run import BlockRun  # which columns need not wait for

    runs = {}
    for name in MODELS:
        changed = case.with_changes({"model": name})
        assert isinstance(changed, BlockCase)
        runs[name] = BlockRun(changed)
    full = runs[ELECTROCHEMICAL.name]
    tissue, J = full.tissue, full.initial_volume_ratio
    ions = ion_concentrations(tissue, J, np.log(full.case.bath.concentration))
    ratio = open_circuit_ratio(tissue, J, *ions)
    length = full.drainage_length
    slowest = (tissue.hydraulic_permeability * aggregate_modulus(tissue)).min()
    volumes = full.grid.volumes
    return Characteristics(
        rest={
            name: RestStates(run.initial_stretch, float(run.initial_volume_ratio[0] @ volumes / volumes.sum()), ())
            for name, run in runs.items()
        },
        open_circuit_ratio=(float(ratio.min()), float(ratio.max())),
        drainage_length=length,
        consolidation_time=float(length**2 / slowest),
        diffusion_time=float(length**2 / salt_diffusivity(tissue, *ions).min()),
    )
