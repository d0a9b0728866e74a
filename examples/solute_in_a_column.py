"""A neutral solute in a column under compression: an equation of one's own, in FiPy's stock terms.

The solute diffuses, is dragged along by the water with a hindrance of its own, and is consumed at a first-order rate.
It enters from the bath through the filter. Nothing of it acts back on the tissue, so the tissue is run step by step
and the solute follows in every step, on the mesh that moves with the solid.

    python examples/solute_in_a_column.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from fipy import CellVariable, CentralDifferenceConvectionTerm, DiffusionTerm, ImplicitSourceTerm, TransientTerm

import fvswell
from fvswell.fipy import MovingColumn, direct_solver
from fvswell.simulation.setup import make_setup

DIFFUSIVITY = 3e-4  # mm2/s, of the solute in the water of the tissue
DRAG = 0.7  # share of the water's velocity that it is dragged with
RATE = 1e-3  # 1/s, at which it is consumed
BATH = 1.0  # concentration, in any unit

CASE = Path(__file__).parent.parent / "cases" / "confined_compression.toml"


def solute(column: MovingColumn) -> tuple[np.ndarray, np.ndarray]:
    """Run the column; concentration at the end, and in each step time, amount, what has entered and been consumed."""
    mesh, n_f, q = column.mesh, column.fluid_fraction, column.water_flux
    c = CellVariable(mesh=mesh, value=BATH, hasOld=True)
    c.constrain(BATH, mesh.facesLeft)
    entered = consumed = 0.0
    history = [(0.0, float((column.water * c.value).sum()), entered, consumed)]
    for step in column:
        c.updateOld()
        at_filter = DRAG * q * BATH * mesh.facesLeft  # FiPy's convection would take half of the cell's concentration
        equation = (
            TransientTerm(coeff=n_f, var=c)
            + CentralDifferenceConvectionTerm(coeff=DRAG * q * mesh.interiorFaces, var=c)
            + at_filter.divergence
            - DiffusionTerm(coeff=DIFFUSIVITY * n_f.faceValue, var=c)
            + ImplicitSourceTerm(coeff=RATE * n_f, var=c)
        )
        equation.solve(dt=step.dt, solver=direct_solver())
        flux = DRAG * q * c.faceValue - DIFFUSIVITY * n_f.faceValue * c.faceGrad
        entered += step.dt * float(flux.value[0, 0])
        consumed += step.dt * RATE * float((column.water * c.value).sum())
        history.append((step.time, float((column.water * c.value).sum()), entered, consumed))
    return np.array(c.value), np.array(history)


if __name__ == "__main__":
    case = fvswell.load_case(CASE).with_changes({"geometry.cells": 20, "time.tolerance": 1e-3})
    concentration, history = solute(MovingColumn(make_setup(case)))
    for time, amount, entered, consumed in history[::8]:
        print(f"{time:8.1f} s   amount {amount:.4f}   entered {entered:+.4f}   consumed {consumed:.4f}")
    error = np.abs(history[:, 1] - history[0, 1] - history[:, 2] + history[:, 3]).max()
    print(f"conserved to {error:.1e}; concentration at the piston {concentration[-1]:.3f} of the bath's")
