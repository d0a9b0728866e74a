"""Fields of a block: vectors and gradients in cells, ion fluxes in parts, and what charged tissue has to obey."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import GLUED, acting, distorted_vertices, one_stage, rough_grid, uniform_block
from tissues import BATH

from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.fields import fields_at
from fvswell.block.geometry import edge_area_vectors
from fvswell.block.grid import block_grid, shaped_block_grid
from fvswell.block.reconstruction import cell_gradients, cell_vectors
from fvswell.physics.constants import FARADAY
from fvswell.physics.models import ELECTROCHEMICAL
from fvswell.physics.osmotic import ion_concentrations
from fvswell.physics.tissue import fixed_charge_density

by_kind = pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])


@by_kind
def test_fields(kind: str) -> None:
    """Vectors in cells recover a uniform flux; charged fields obey electroneutrality and Donnan."""
    block = uniform_block(rough_grid(kind), GLUED, ELECTROCHEMICAL)
    state = equilibrated_body(block)[1]
    grid, positions = block.grid, block.positions(state.unknowns)
    uniform = np.array([0.0 if kind == "axisymmetric" else 0.3, -0.2])
    totals = uniform @ np.stack(edge_area_vectors(grid.section, *positions[:, grid.face_vertices]))
    vectors = cell_vectors(block, positions, totals[None])[0]
    np.testing.assert_allclose(vectors, np.broadcast_to(uniform[:, None], vectors.shape), rtol=0, atol=1e-13)
    fields = fields_at(block, state.unknowns, block.unloaded)
    c_plus, c_minus = fields["cation_concentration"], fields["anion_concentration"]
    np.testing.assert_allclose(c_plus - c_minus, fields["fixed_charge_density"], rtol=1e-12)
    np.testing.assert_allclose(c_plus * c_minus, BATH**2, rtol=1e-12)
    np.testing.assert_allclose(fields["fluid_pressure"], fields["osmotic_pressure"] + fields["water_potential"])
    assert np.abs(fields["displacement_y"][grid.edge_vertices("bottom")]).max() == 0.0


@by_kind
def test_gradients_are_exact_for_linear_values(kind: str) -> None:
    block = uniform_block(rough_grid(kind), GLUED, ELECTROCHEMICAL)
    positions = block.grid.vertices + 0.05 * np.sin(3.0 * block.grid.vertices[::-1])
    slope = np.array([0.7, -1.3])
    centres = positions[:, block.grid.cell_vertices].mean(axis=1)
    middles = positions[:, block.grid.face_vertices[:, block.diamonds.faces]].mean(axis=1)
    gradients = cell_gradients(block, positions, (slope @ centres)[None], (slope @ middles)[None])[0]
    np.testing.assert_allclose(gradients, np.broadcast_to(slope[:, None], gradients.shape), rtol=1e-12)


def test_gradients_along_a_single_row_of_cells_have_no_part_across_it() -> None:
    block = uniform_block(block_grid("plane-strain", np.arange(5.0), np.arange(2.0)), GLUED, ELECTROCHEMICAL)
    place = block.grid.centres[:1] + block.grid.centres[1:]
    middles = block.grid.face_centres[:, block.diamonds.faces].sum(axis=0)[None]
    gradients = cell_gradients(block, block.grid.vertices, place, middles)[0]
    np.testing.assert_allclose(gradients, [[1.0] * 4, [0.0] * 4], atol=1e-14)


@by_kind
def test_parts_of_ion_fluxes(kind: str) -> None:
    """They add up, and what is called migration is that in the gradient of the electric potential; to first order."""
    gaps, bath = [], 0.7 * BATH
    for n in (8, 16, 32):
        block = uniform_block(shaped_block_grid(kind, distorted_vertices(2 * n, n)), GLUED, ELECTROCHEMICAL)
        _, done = one_stage(block, 400.0, bath=bath, top__pressure=0.05)
        fields, tissue = fields_at(block, done.unknowns, acting(block, bath)), block.cells
        for axis in ("x", "y"):
            for ion in ("cation", "anion"):
                parts = [fields[f"{ion}_flux_{part}_{axis}"] for part in ("convection", "diffusion", "migration")]
                total = fields[f"{ion}_flux_{axis}"]
                np.testing.assert_allclose(sum(parts), total, rtol=1e-12, atol=1e-12 * np.abs(parts[1]).max())
        charge = fixed_charge_density(tissue, fields["volume_ratio"][block.diamonds.cells[0]])
        outside = ion_concentrations(tissue.osmotic, charge, np.log(bath))
        xi_outside = -tissue.thermal_energy / FARADAY * np.log(outside[0] / bath)
        potential = fields["electric_potential"][None]
        slope = cell_gradients(block, block.positions(done.unknowns), potential, xi_outside[None])[0]
        mobility = fields["fluid_fraction"] * tissue.cation_diffusivity * FARADAY / tissue.thermal_energy
        expected = -mobility * fields["cation_concentration"] * slope
        found = np.stack([fields["cation_flux_migration_x"], fields["cation_flux_migration_y"]])
        scale = np.abs([fields["cation_flux_diffusion_x"], fields["cation_flux_diffusion_y"]]).max()
        gaps.append(np.sqrt(((found - expected) ** 2).mean()) / scale)
    assert gaps[0] > 1.8 * gaps[1] > 1.8**2 * gaps[2], gaps
    assert gaps[2] < 0.01
