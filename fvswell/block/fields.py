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
    outputs, names = int(record.filled[0]), body.load_names
    rows = []
    for unknowns, values in zip(record.unknowns[:outputs], record.loads[:outputs], strict=True):
        loads = dict(zip(names, values, strict=True))
        rows.append(fields_at(body.block, unknowns, pressing_loads(body.block.parts, loads, body.block.concentration)))
    fields = {name: np.stack([row[name] for row in rows]) for name in rows[0]} if rows else {}
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
    positions, potentials, tissue = block.positions(unknowns), block.potentials(unknowns), block.cells
    transport = block.transport_at(unknowns, loads)
    J, osmotic = transport.volume_ratio, transport.osmotic[0]
    displacement = positions - block.grid.vertices
    F = deformation_gradient(block.solid, block.grid.section.slab, positions)
    stress = cell_stress(block.solid, block.solid_class, F)
    fields: Fields = {
        "bath_concentration": np.array(loads.bath_concentration[block.outside.reference]),
        "displacement_x": displacement[0],
        "displacement_y": displacement[1],
        "volume_ratio": J,
        "fluid_fraction": fluid_fraction(tissue, J),
        "fluid_pressure": potentials[0] + osmotic,
        "water_potential": potentials[0],
        **{f"effective_stress_{name}": value for name, value in stress._asdict().items()},
    }
    totals = np.zeros((len(block.balances), block.grid.face_cells.shape[1]))
    totals[:, block.diamonds.faces] = transport.fluxes
    means = cell_vectors(block, positions, totals)
    vectors = {"water_flux": means[0]}
    if block.model.swelling:
        charge = fixed_charge_density(tissue, J)
        cation, anion = ion_concentrations(tissue.osmotic, charge, transport.log_activity)
        psi = potentials[2] if block.model.transports_ions else np.zeros_like(J)
        fields |= {
            "osmotic_pressure": osmotic,
            "fixed_charge_density": charge,
            "cation_concentration": cation,
            "anion_concentration": anion,
            "virtual_concentration": virtual_concentration(tissue.osmotic, transport.log_activity),
            # F xi/(R T) = F psi~/(R T) - ln(gamma_int c+/a~), and gamma_int^2 c+ c- = a~^2
            "electric_potential": tissue.thermal_energy / FARADAY * (psi - 0.5 * np.log(cation / anion)),
        }
        if block.model.transports_ions:
            anions, current = means[1:]
            vectors |= {"cation_flux": anions + current, "anion_flux": anions, "current_density": FARADAY * current}
            vectors |= _ion_flux_parts(block, positions, transport, (cation, anion), vectors)
    for name, vector in vectors.items():
        fields[f"{name}_x"], fields[f"{name}_y"] = vector
    return fields


def _ion_flux_parts(
    block: Block, positions: Array, transport: Transport, ions: tuple[Array, Array], fluxes: Fields
) -> Fields:
    """Convection, diffusion and migration in the cells, ``(2, cells)`` each."""
    tissue, faces = block.cells, block.faces
    # at the boundary the laws take J of the cell inside
    J = transport.volume_ratio[block.diamonds.cells[0]]
    outside = ion_concentrations(faces.osmotic, fixed_charge_density(faces, J), transport.face_activity)
    gradients = cell_gradients(block, positions, np.stack(ions), np.stack(outside))
    fields: Fields = {}
    for name, inside, gradient, diffusivity in (
        ("cation", ions[0], gradients[0], tissue.cation_diffusivity),
        ("anion", ions[1], gradients[1], tissue.anion_diffusivity),
    ):
        parts = ion_flux_parts(
            tissue, transport.volume_ratio, inside, diffusivity, fluxes[f"{name}_flux"], fluxes["water_flux"], gradient
        )
        fields |= {f"{name}_flux_{part}": value for part, value in parts._asdict().items()}
    return fields
