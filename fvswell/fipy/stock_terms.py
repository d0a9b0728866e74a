"""The balances of a column written with FiPy's stock terms: a readable specification, independent of the kernels.

One Newton step at the iterate (V, s), V being the present widths of the cells, reads for each balance

    storage            TransientTerm(var=V), TransientTerm(var=s), none for the charge
    flux by gradient   - DiffusionTerm(L_mu, var=mu_f) - DiffusionTerm(L_a, var=ln a~) - DiffusionTerm(L_psi, var=psi~)
    flux by state      + CentralDifferenceConvectionTerm(dF/dV, var=V) + the same for ln a~, less what they are now

and the potentials follow from the contents cell by cell, which couples two local equations with ``&``:

    mu_f = sigma_s(J) + P - pi(J, s)        ln a~ = ln a~(J, s)

The equations live on the mesh of the stress-free solid: the motion of the grid is in the coefficients (gradients over
the stretch of the faces). Derivatives come from dual numbers. Matrix, residual and step equal those of the kernels to
rounding, some thousand times more slowly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from fipy import (
    CellVariable,
    CentralDifferenceConvectionTerm,
    DiffusionTerm,
    FaceVariable,
    ImplicitSourceTerm,
    TransientTerm,
    Variable,
)

from fvswell.column.column import Column
from fvswell.fipy.column_laws import CellPotentials, FaceFluxes, cell_potentials, end_potentials, face_fluxes
from fvswell.fipy.mesh import column_mesh
from fvswell.fipy.terms import direct_solver
from fvswell.physics.tissue import Array

__all__ = ["AlwaysImplicitSourceTerm", "StockTerms"]


class AlwaysImplicitSourceTerm(ImplicitSourceTerm):
    """FiPy's own goes explicit, cell by cell, where the sign of its coefficient would weaken the diagonal."""

    def _getWeight(self, var: Any, transientGeomCoeff: Any = None, diffusionGeomCoeff: Any = None) -> Any:
        zero = np.zeros(var.shape)
        return {"diagonal": zero + 1.0, "old value": zero, "b vector": zero, "new value": zero}


class StockTerms:
    """Newton's method on the balances of a column with FiPy's stock terms.

    Parameters
    ----------
    column
        What is solved.
    initial_volume_ratio
        J of the equilibrated column, (cells,).

    Raises
    ------
    ValueError
        If the current follows from potentials: here it has to be given.
    """

    def __init__(self, column: Column, initial_volume_ratio: Array) -> None:
        if column.current_is_found:
            raise ValueError(
                'stock terms cannot find a current from the potentials of both ends; use assembly = "fipy"'
            )
        self.column, self.initial_ratio = column, column.open_circuit_ratio(initial_volume_ratio)
        self.widths, self.mesh = column.grid.widths, column_mesh(column.grid)
        self.ions = column.model.transports_ions
        names = ["mu_f", "ln a~", "psi~"] if self.ions else ["mu_f"]
        self.volume = self._cell_variable("V")
        self.contents = [self.volume, self._cell_variable("s")] if self.ions else [self.volume]
        self.potentials = [self._cell_variable(name) for name in names]
        self.at_ends = [[self._constrained(variable, end) for end in (0, 1)] for variable in self.potentials]
        balances, local = len(names), len(self.contents)
        self.mobility = [[FaceVariable(mesh=self.mesh) for _ in names] for _ in range(balances)]
        self.by_state = [[FaceVariable(mesh=self.mesh, rank=1) for _ in range(local)] for _ in range(balances)]
        self.by_end = [CellVariable(mesh=self.mesh) for _ in range(balances)]
        self.constant = [CellVariable(mesh=self.mesh) for _ in range(balances + local)]
        self.slopes = [[CellVariable(mesh=self.mesh) for _ in range(local)] for _ in range(local)]
        self.equations = self._equations()

    # ---- the equations -----------------------------------------------------------------------------------

    def _equations(self) -> Any:
        """All equations, coupled; what changes from sweep to sweep is in the variables that they hold."""
        equations = []
        states = [self.volume, *self.potentials[1:2]]
        for balance, constant in enumerate(self.constant[: len(self.potentials)]):
            equation: Any = AlwaysImplicitSourceTerm(coeff=self.by_end[balance], var=self.volume) + constant
            for coefficient, potential in zip(self.mobility[balance], self.potentials, strict=True):
                equation = equation - DiffusionTerm(coeff=coefficient, var=potential)
            for coefficient, state in zip(self.by_state[balance], states, strict=True):
                equation = equation + CentralDifferenceConvectionTerm(coeff=coefficient, var=state)
            if balance == 0:
                per_volume = CellVariable(mesh=self.mesh, value=1.0 / self.widths)
                equation = equation + TransientTerm(coeff=per_volume, var=self.volume)
            elif balance == 1:
                equation = equation + TransientTerm(var=self.contents[1])
            equations.append(equation)
        for potential, slopes, constant in zip(
            self.potentials, self.slopes, self.constant[len(self.potentials) :], strict=False
        ):
            equation = AlwaysImplicitSourceTerm(coeff=1.0, var=potential) + constant
            for slope, content in zip(slopes, self.contents, strict=True):
                equation = equation - AlwaysImplicitSourceTerm(coeff=slope, var=content)
            equations.append(equation)
        coupled = equations[0]
        for equation in equations[1:]:
            coupled = coupled & equation
        # FiPy keeps the variables in a set: without a given order the columns of the matrix change from run to run.
        # In this order no entry on the diagonal is zero.
        return coupled([*self.contents, *self.potentials[2:], *self.potentials[:2]])

    def sweep(
        self, contents: Array, base: Array, duration: float, loads: Array, pressure_rise: float,
        current_rise: float = 0.0,
    ) -> Array:  # fmt: skip
        """Contents after one sweep from given ones, the pressure risen above that of the loads; no current rises."""
        self.set_iterate(contents, base, loads, pressure_rise)
        self.equations.sweep(dt=duration, solver=direct_solver())
        values = np.array([variable.value for variable in self.contents])
        values[0] /= self.widths
        return values

    # ---- their coefficients ------------------------------------------------------------------------------

    def set_iterate(self, contents: Array, base: Array, loads: Array, pressure_rise: float = 0.0) -> None:
        """Linearise about contents (balances, cells); base is what they were before the step."""
        column = self.column
        cells, at_ends = cell_potentials(column, contents, loads), end_potentials(column, loads)
        potentials = np.concatenate([at_ends[:, :1], cells.values, at_ends[:, 1:]], axis=1)
        gradients = np.diff(potentials, axis=1) / column.grid.metric[0]
        faces = face_fluxes(column, self.initial_ratio, contents, potentials, gradients, loads)
        if self.ions:
            psi = np.pad(faces.potential, 1, mode="edge")
            psi[0 if column.parts[0].open else -1] = 0.0
            gradients = np.vstack([gradients, np.diff(psi) / column.grid.metric[0]])
        for variable, value in zip(self.potentials, (*cells.values, faces.potential), strict=False):
            variable.setValue(value)
        for variable, new, old in zip(self.contents, contents, base, strict=True):
            scale = self.widths if variable is self.volume else 1.0
            variable.setValue(old * scale)
            variable.updateOld()
            variable.setValue(new * scale)
        for pair, given in zip(self.at_ends, at_ends, strict=False):
            for end in (0, 1):
                pair[end].setValue(given[end])
        self._set_balances(faces, gradients[: len(self.potentials)], cells)
        self._set_local(cells, contents, pressure_rise)

    def _set_local(self, cells: CellPotentials, contents: Array, pressure_rise: float) -> None:
        """Coefficients of the equations that give the potentials of the cells."""
        per_volume = np.ones(contents.shape)
        per_volume[0] = 1.0 / self.widths
        for row, slopes in enumerate(self.slopes):
            remainder = -cells.values[row] - (pressure_rise if row == 0 else 0.0)
            for content, slope in enumerate(slopes):
                slope.setValue(cells.by_contents[row, content] * per_volume[content])
                remainder = remainder + cells.by_contents[row, content] * contents[content]
            self.constant[len(self.potentials) + row].setValue(remainder)

    def _set_balances(self, faces: FaceFluxes, gradients: Array, cells: CellPotentials) -> None:
        """Coefficients of the balances."""
        n = len(self.widths)
        states = [self.volume.value, *cells.values[1:2]]
        for balance in range(len(self.potentials)):
            explicit = faces.fluxes[balance] - np.einsum("pf,pf->f", faces.by_gradient[balance], gradients)
            for potential, coefficient in enumerate(self.mobility[balance]):
                coefficient.setValue(-faces.by_gradient[balance, potential])
            for index, coefficient in enumerate(self.by_state[balance]):
                slope = faces.by_state[balance, index].copy()
                if index == 0:
                    slope /= self.column.grid.metric[0]  # the stretch is the mean V beside a face over the distance
                slope[[0, n]] = 0.0
                coefficient.setValue(slope[None])
                explicit[1:n] -= slope[1:n] * 0.5 * (states[index][1:] + states[index][:-1])
            by_end = np.zeros(n)  # at an open end the stretch is that of the cell, and ln a~ is given
            by_end[0] -= faces.by_state[balance, 0, 0] / self.widths[0]
            by_end[-1] += faces.by_state[balance, 0, n] / self.widths[-1]
            self.by_end[balance].setValue(by_end / self.widths)
            self.constant[balance].setValue((np.diff(explicit) - by_end * self.volume.value) / self.widths)

    # ---- variables ---------------------------------------------------------------------------------------

    def _cell_variable(self, name: str) -> Any:
        return CellVariable(mesh=self.mesh, name=name, value=1.0, hasOld=True)

    def _constrained(self, variable: Any, end: int) -> Any:
        """The value that a potential has at an open end, as a variable; that of psi~ stays zero at the first."""
        value = Variable(0.0)
        grounded = 0 if self.column.parts[0].open else 1
        if self.column.parts[end].open and (variable.name != "psi~" or end == grounded):
            variable.constrain(value, self.mesh.facesLeft if end == 0 else self.mesh.facesRight)
        return value
