"""A charged disc in unconfined relaxation against FEBio 4, a finite element code: the same equations, other methods.

`data/febio-charged-disc.csv` holds the force and the displacement of the rim that FEBio's triphasic material gives for
a wedge of the disc, 40 elements graded 10 toward the rim, backward Euler with steps of 1 s. Without hindrance, and
without volume of the ions, both codes solve the same equations.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from blocks import UNCONFINED, integrate, make_control, make_protocol, phase, uniform_block
from tissues import BATH, reference_tissue

from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.grid import block_grid
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.numerics.loads import Load
from fvswell.numerics.tableaux import BACKWARD_EULER
from fvswell.physics.models import ELECTROCHEMICAL

DATA = Path(__file__).parent / "data" / "febio-charged-disc.csv"
RADIUS, HEIGHT, STROKE, RAMP, END = 1.5, 0.5, 0.025, 20.0, 1000.0


def test_charged_disc_follows_febio() -> None:
    expected = np.genfromtxt(DATA, delimiter=",", names=True)
    grid = block_grid("axisymmetric", graded_nodes(RADIUS, 40, 10.0, ["end"]), graded_nodes(HEIGHT, 2))
    tissue = reference_tissue(hindrance_factor=0.0)._replace(thermal_energy=8.314 * 298.0)
    body, state = equilibrated_body(uniform_block(grid, UNCONFINED, ELECTROCHEMICAL, tissue))
    block = body.block
    rim, start = grid.edge_vertices("right")[0], block.positions(state.unknowns)
    top = float(state.loads[body.load_names.index("top.displacement")])
    np.testing.assert_allclose(start[0, rim] - RADIUS, expected["rim_radial_displacement_mm"][0], rtol=1e-5)
    np.testing.assert_allclose(top, expected["top_displacement_mm"][0], rtol=1e-5)

    loads = [phase(body, bath=BATH, top__displacement=Load(top - STROKE, RAMP))]
    control = make_control(BACKWARD_EULER, 1e-10, fixed_steps=int(END), every=1)
    run = integrate(body, state, make_protocol(loads, [END]), control)
    assert run.complete
    force = np.interp(expected["time_s"], run.filled("time"), run.load("top.force"))
    moved = np.array([block.positions(unknowns)[0, rim] - RADIUS for unknowns in run.filled("unknowns")])
    outward = np.interp(expected["time_s"], run.filled("time"), moved)
    after = expected["time_s"] > 0.0
    force_gap = np.abs(force - expected["force_N"])[after].max() / expected["force_N"].max()
    rim_gap = np.abs(outward - expected["rim_radial_displacement_mm"])[after].max()
    assert force_gap < 5e-4
    assert rim_gap < 5e-4 * expected["rim_radial_displacement_mm"].max()
