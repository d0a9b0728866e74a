"""What keeps checkerboards out of the pressure just after a load jumps: enough of it, and no more."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import GLUED, one_stage, uniform_block
from tissues import reference_tissue

from fvswell.block.grid import block_grid
from fvswell.block.stabilisation import STRENGTH, alternating_storage
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.physics.models import BIPHASIC
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array


def sudden_load(n: int, share: float, strength: float = STRENGTH) -> tuple[Array, float]:
    """Pressure (rows, columns) of a glued block under 0.1 MPa after a share of its consolidation time, and how far its
    plate has gone."""
    tissue = reference_tissue(youngs_modulus=1.0)
    grid = block_grid("plane-strain", graded_nodes(10.0, n), graded_nodes(5.0, n))
    block = uniform_block(grid, GLUED, BIPHASIC, tissue, stabilisation=strength)
    step = share * 10.0**2 / (aggregate_modulus(tissue.solid, tissue.fluid_fraction) * 1e-3)
    _, result = one_stage(block, step, top__pressure=0.1)
    plate = result.unknowns[block.degrees_of_freedom.normal[list(GLUED).index("top")]]
    return block.potentials(result.unknowns)[0].reshape(n, n), float(plate)


def checkerboard(pressure: Array) -> float:
    """Largest alternating part around a vertex away from the right edge, whose glued corner is a singularity."""
    part = pressure[:-1, :-1] - pressure[1:, :-1] - pressure[:-1, 1:] + pressure[1:, 1:]
    return float(np.abs(part[:, : 3 * len(part) // 4]).max() / 4.0)


@pytest.mark.parametrize("share", [1e-4, 1e-6, 1e-8])
def test_no_checkerboard_after_a_sudden_load(share: float) -> None:
    smooth = checkerboard(sudden_load(20, share)[0])
    assert smooth < 0.012 * 0.1
    if share < 1e-5:  # and there would be one
        assert checkerboard(sudden_load(20, share, strength=0.0)[0]) > 5.0 * smooth


def test_it_vanishes_with_the_grid() -> None:
    gaps = [abs(sudden_load(n, 1e-2)[1] - sudden_load(n, 1e-2, strength=0.0)[1]) for n in (8, 16, 32)]
    assert gaps[0] < 1e-4
    assert (np.log2(np.array(gaps[:-1]) / gaps[1:]) > 2.0).all(), gaps


def test_it_is_strong_enough_and_no_stronger() -> None:
    """What it changes is proportional to its strength, and seen at a hundred times the strength in use."""
    without = sudden_load(16, 1e-2, strength=0.0)[1]
    changes = {times: abs(sudden_load(16, 1e-2, times * STRENGTH)[1] / without - 1.0) for times in (1.0, 10.0, 100.0)}
    assert changes[1.0] < 2e-6
    assert changes[10.0] == pytest.approx(10.0 * changes[1.0], rel=0.1)
    assert changes[100.0] > 1e-4
    used, stronger, weaker = (checkerboard(sudden_load(20, 1e-8, times * STRENGTH)[0]) for times in (1.0, 100.0, 0.25))
    assert stronger > 2.0 * used  # the pressure of a smooth field is no longer its own
    assert weaker > 10.0 * used


def test_storage_is_symmetric_positive_and_stores_nothing_in_total_or_of_linear_fields() -> None:
    grid = block_grid("plane-strain", graded_nodes(2.0, 5), graded_nodes(1.0, 4))
    storage = alternating_storage(grid, np.full(grid.cells, 0.5)).toarray()
    np.testing.assert_allclose(storage, storage.T, atol=1e-18)
    assert np.linalg.eigvalsh(storage).min() > -1e-16
    np.testing.assert_allclose(storage.sum(axis=0), 0.0, atol=1e-16)
    np.testing.assert_allclose(storage @ (np.array([0.3, -0.7]) @ grid.centres), 0.0, atol=1e-16)
