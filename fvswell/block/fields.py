"""Fields of a block at its outputs."""

from __future__ import annotations

import numpy as np

from fvswell.block.block import Block
from fvswell.block.body import BlockBody
from fvswell.block.mechanics import cell_stress, deformation_gradient
from fvswell.block.part_loads import PartLoads, pressing_loads
from fvswell.block.reconstruction import cell_gradients, cell_vectors
from fvswell.block.transport import Transport
from fvswell.numerics.conservation import balance_errors
from fvswell.numerics.state import Record
from fvswell.physics.constants import FARADAY
from fvswell.physics.fluxes import ion_flux_parts
from fvswell.physics.osmotic import ion_concentrations, virtual_concentration
from fvswell.physics.tissue import Array, fixed_charge_density, fluid_fraction

__all__ = ["block_fields", "fields_at"]

Fields = dict[str, Array]


def block_fields(body: BlockBody, record: Record) -> Fields:
    """Every field that the model of a block has, by name; the first axis is that of the outputs.

    See `fields_at`; mismatches of the balances come on top.
    """
    outputs, block = int(record.filled[0]), body.block
    values = (dict(zip(body.load_names, each, strict=True)) for each in record.loads[:outputs])
    loads = [pressing_loads(block.parts, each, block.concentration) for each in values]
    fields = _fields(block, record.unknowns[:outputs], loads) if outputs else {}
    return fields | balance_errors(record, body.block.model.transports_ions)


def fields_at(block: Block, unknowns: Array, loads: PartLoads) -> Fields:
    """Fields in one state.

    Returns
    -------
    dict
        At vertices ``displacement_x``, ``displacement_y`` (mm, from the stress-free solid); in cells, ``(cells,)``:
        volume ratio, pressures, effective stresses (means over the cell; zz is out of the plane, or the hoop),
        concentrations, potential, and fluxes per current area as vectors (``water_flux_x``, ...), those of ions in
        parts too (``cation_flux_diffusion_x``, ...); and the concentration of the reference bath. What is measured at
        the parts of the boundary is in `fvswell.block.histories`.
    """
    fields = _fields(block, unknowns[None], [loads])
    return {name: values[0] for name, values in fields.items()}


def _fields(block: Block, unknowns: Array, loads: list[PartLoads]) -> Fields:
    """Fields in several states, ``(outputs, ...)``, together: most of the work of one is the interpreter's."""
    positions, potentials = (np.stack([at(u) for u in unknowns]) for at in (block.positions, block.potentials))
    states = [block.transport_at(*each) for each in zip(unknowns, loads, strict=True)]
    tissue, J = block.cells, np.stack([state.volume_ratio for state in states])
    osmotic = np.stack([state.osmotic[0] for state in states])
    displacement = positions - block.grid.vertices
    F = deformation_gradient(block.solid, block.grid.section.slab, positions)
    stress = cell_stress(block.solid, block.solid_class, F)
    fields: Fields = {
        "bath_concentration": np.array([each.bath_concentration[block.outside.reference] for each in loads]),
        "displacement_x": displacement[:, 0],
        "displacement_y": displacement[:, 1],
        "volume_ratio": J,
        "fluid_fraction": fluid_fraction(tissue, J),
        "fluid_pressure": potentials[:, 0] + osmotic,
        "water_potential": potentials[:, 0],
        **{f"effective_stress_{name}": value for name, value in stress._asdict().items()},
    }
    means = _mean_vectors(block, positions, states)
    vectors = {"water_flux": means[0]}
    if block.model.swelling:
        charge = fixed_charge_density(tissue, J)
        activity = np.stack([state.log_activity for state in states])
        cation, anion = ion_concentrations(tissue.osmotic, charge, activity)
        psi = potentials[:, 2] if block.model.transports_ions else np.zeros_like(J)
        fields |= {
            "osmotic_pressure": osmotic,
            "fixed_charge_density": charge,
            "cation_concentration": cation,
            "anion_concentration": anion,
            "virtual_concentration": virtual_concentration(tissue.osmotic, activity),
            # F xi/(R T) = F psi~/(R T) - ln(gamma_int c+/a~), and gamma_int^2 c+ c- = a~^2
            "electric_potential": tissue.thermal_energy / FARADAY * (psi - 0.5 * np.log(cation / anion)),
        }
        if block.model.transports_ions:
            anions, current = means[1:]
            vectors |= {"cation_flux": anions + current, "anion_flux": anions, "current_density": FARADAY * current}
            vectors |= _ion_flux_parts(block, positions, states, np.stack([cation, anion]), vectors)
    for name, vector in vectors.items():
        fields[f"{name}_x"], fields[f"{name}_y"] = vector
    return fields


def _mean_vectors(block: Block, positions: Array, states: list[Transport]) -> Array:
    """Mean vectors of all fluxes in the cells, ``(fluxes, 2, outputs, cells)``."""
    totals = np.zeros((len(states), len(block.balances), block.grid.face_cells.shape[1]))
    totals[:, :, block.diamonds.faces] = [state.fluxes for state in states]
    means = np.stack([cell_vectors(block, *each) for each in zip(positions, totals, strict=True)])
    return np.moveaxis(means, 0, 2)


def _ion_flux_parts(block: Block, positions: Array, states: list[Transport], ions: Array, fluxes: Fields) -> Fields:
    """Convection, diffusion and migration in the cells, ``(2, outputs, cells)`` each; ions ``(2, outputs, cells)``."""
    tissue, faces = block.cells, block.faces
    J = np.stack([state.volume_ratio for state in states])
    # at the boundary the laws take J of the cell inside
    at_faces = J[:, block.diamonds.cells[0]]
    activity = np.stack([state.face_activity for state in states])
    outside = np.stack(ion_concentrations(faces.osmotic, fixed_charge_density(faces, at_faces), activity))
    each = zip(positions, np.moveaxis(ions, 1, 0), np.moveaxis(outside, 1, 0), strict=True)
    gradients = np.moveaxis(np.stack([cell_gradients(block, *state) for state in each]), 0, 2)
    fields: Fields = {}
    for name, inside, gradient, diffusivity in (
        ("cation", ions[0], gradients[0], tissue.cation_diffusivity),
        ("anion", ions[1], gradients[1], tissue.anion_diffusivity),
    ):
        parts = ion_flux_parts(tissue, J, inside, diffusivity, fluxes[f"{name}_flux"], fluxes["water_flux"], gradient)
        fields |= {f"{name}_flux_{part}": value for part, value in parts._asdict().items()}
    return fields
