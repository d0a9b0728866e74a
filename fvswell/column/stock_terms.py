"""The balances of a column written with FiPy's stock terms: the readable specification of the coupled term.

One Newton step at the iterate (V, mu_f, ln c~, psi~), V being the current widths of the cells, reads for each balance

    storage           TransientTerm(dm/dV, var=V) + TransientTerm(dm/d ln c~, var=ln c~)  + (m - base)/dt
    flux by gradient  - DiffusionTerm(L_mu, var=mu_f) - DiffusionTerm(L_c, var=ln c~) - DiffusionTerm(L_psi, var=psi~)
    flux by state     + CentralDifferenceConvectionTerm(dF/dV, var=V) + the same for ln c~, less their values now

set to zero, and coupled with ``&`` to the momentum balance mu_f = sigma_s(J) + P - pi. It lives on the reference mesh:
the motion of the grid is in the coefficients (gradients over the stretch of the faces). Some hundred times slower than
`CoupledTransportTerm`, and equal to it to rounding.
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
)
from fipy.solvers.scipy import LinearLUSolver

from fvswell.column.linearisation import NewtonStep
from fvswell.column.transport_term import Balance, CoupledTransportTerm, Interval
from fvswell.physics.tissue import Array

__all__ = ["StockTermsTransport"]


class _AlwaysImplicitSourceTerm(ImplicitSourceTerm):
    """FiPy's own goes explicit, cell by cell, where the sign of its coefficient would weaken the diagonal."""

    def _getWeight(self, var: Any, transientGeomCoeff: Any = None, diffusionGeomCoeff: Any = None) -> Any:
        zero = np.zeros(var.shape)
        return {"diagonal": zero + 1.0, "old value": zero, "b vector": zero, "new value": zero}


class StockTermsTransport(CoupledTransportTerm):
    """`CoupledTransportTerm` with matrix and residual from FiPy's stock terms; for a single column."""

    def balance(self, unknowns: Array, interval: Interval) -> Balance:
        """As of the coupled term, the residual being that of the stock terms."""
        balance = super().balance(unknowns, interval)
        equations, _ = self._equations(unknowns, interval, balance)
        vector = np.array(equations.justResidualVector(dt=float(interval.duration[0, 0]), solver=LinearLUSolver()))
        V = len(unknowns)
        residual = interval.duration[0, 0] * vector.reshape(V + 1, -1)[:V]  # the last is momentum: exactly zero
        return balance._replace(residual=residual[:, None])

    def newton_step(self, unknowns: Array, interval: Interval, balance: Balance, with_pressure: bool) -> NewtonStep:
        """As of the coupled term, from the matrix of the stock terms."""
        matrix, by_pressure = self.matrix(unknowns, interval, balance)
        sides = np.stack([balance.residual.ravel(), by_pressure], axis=1)
        steps = -np.linalg.solve(matrix, sides).T.reshape(2, *unknowns.shape)
        return NewtonStep(steps[0], steps[1] if with_pressure else None)

    def matrix(self, unknowns: Array, interval: Interval, balance: Balance) -> tuple[Array, Array]:
        """Jacobian of the residual, and its derivative by the applied pressure, ordered variable by variable."""
        equations, by_unknowns = self._equations(unknowns, interval, balance)
        equations.cacheMatrix()
        dt = float(interval.duration[0, 0])
        equations.justResidualVector(dt=dt, solver=LinearLUSolver())
        V, _, n = unknowns.shape
        blocks = np.array(equations.matrix.numpyArray).reshape(V + 1, n, V + 1, n)[:V]
        matrix = dt * np.einsum("ejvk,vuk->ejuk", blocks, by_unknowns)
        return matrix.reshape(V * n, V * n), dt * blocks[:, :, 1].sum(axis=-1).ravel()

    def _equations(self, unknowns: Array, interval: Interval, now: Balance) -> tuple[Any, Array]:
        """The coupled equations, and the derivative of (V, mu_f, ln c~, psi~) by the unknowns, per cell."""
        loads, S, mesh, widths = interval.loads, self.laws.state_size, self.grid.mesh, self.grid.widths
        water_slopes = self.laws.water_potential_derivatives(now.cells)[:, 0]
        storage = self.laws.cells.content_derivatives(now.cells)[:, :, 0]
        potentials = unknowns[:, 0].copy()
        potentials[0] = self.laws.water_potential(now.cells, loads)[0]
        bath = interval.filter_potentials

        volume = CellVariable(mesh=mesh, name="V", value=unknowns[0, 0] * widths, hasOld=True)
        driving = []
        for name, value, at_filter in zip(("mu_f", "ln c", "psi"), potentials, bath[:, 0, 0], strict=False):
            variable = CellVariable(mesh=mesh, name=name, value=value, hasOld=True)
            variable.constrain(at_filter, mesh.facesLeft)
            driving.append(variable)
        state = [volume, *driving[1:S]]
        per_volume = np.concatenate([1.0 / widths[None], np.ones((S - 1, len(widths)))])

        mobility, flux_slopes = self._flux_coefficients(now)
        equations = None
        for e in range(len(unknowns)):
            gained = now.contents[e, 0] - interval.base[e, 0]
            balance = CellVariable(mesh=mesh, value=gained / interval.duration[0, 0])
            for variable, slope, scale in zip(state, storage[e], per_volume, strict=True):
                balance = balance + TransientTerm(coeff=CellVariable(mesh=mesh, value=slope * scale), var=variable)
            for variable, coefficient in zip(driving, mobility[e], strict=True):
                balance = balance - DiffusionTerm(coeff=FaceVariable(mesh=mesh, value=coefficient), var=variable)
            for variable, coefficient in zip(state, flux_slopes[e], strict=True):
                balance = balance + self._flux_by_state(coefficient, variable)
            equations = balance if equations is None else equations & balance
        momentum = _AlwaysImplicitSourceTerm(coeff=1.0, var=driving[0]) - CellVariable(mesh=mesh, value=potentials[0])
        for variable, slope, scale in zip(state, water_slopes, per_volume, strict=True):
            coefficient = CellVariable(mesh=mesh, value=slope * scale)
            momentum = momentum - _AlwaysImplicitSourceTerm(coeff=coefficient, var=variable)
            momentum = momentum + coefficient * variable.value

        by_unknowns = np.zeros((len(unknowns) + 1, len(unknowns), len(widths)))
        by_unknowns[0, 0] = widths
        by_unknowns[1, :S] = water_slopes
        for variable in range(1, len(unknowns)):
            by_unknowns[variable + 1, variable] = 1.0
        # FiPy keeps the variables in a set: without a given order the columns of the matrix change from run to run
        return (equations & momentum)([volume, *driving]), by_unknowns

    def _flux_coefficients(self, now: Balance) -> tuple[Array, Array]:
        """At all faces: L, minus flux by reference gradient (e, p, faces), and flux by (V, ln c~) (e, s, faces)."""
        by_state, by_gradient = self.laws.flux_derivatives(now.faces, now.gradients, now.fluxes[..., :-1])
        by_state[:, 0] /= self.grid.distances  # a face's stretch is the mean of the V beside it over their distance
        piston = ((0, 0), (0, 0), (0, 1))  # nothing passes there
        return np.pad(-by_gradient[:, :, 0], piston), np.pad(by_state[:, :, 0], piston)

    def _flux_by_state(self, coefficient: Array, variable: Any) -> Any:
        """Change of a flux's divergence with the state at the faces, as terms that vanish at the iterate.

        At the filter the state is half the first cell's V (the bath's ln c~ does not change): a source in that cell,
        for the stock convection term treats faces with a given value differently.
        """
        mesh = self.grid.mesh
        inner = np.where(mesh.interiorFaces.value, coefficient, 0.0)
        term = CentralDifferenceConvectionTerm(coeff=FaceVariable(mesh=mesh, value=inner[None], rank=1), var=variable)
        values = variable.value
        crossing = inner.copy()
        crossing[1:-1] *= 0.5 * (values[1:] + values[:-1])
        term = term - CellVariable(mesh=mesh, value=np.diff(crossing) / self.grid.widths)
        if variable.name == "V":
            source = np.zeros(len(values))
            source[0] = -0.5 * coefficient[0] / self.grid.widths[0]
            source_variable = CellVariable(mesh=mesh, value=source)
            term = term + _AlwaysImplicitSourceTerm(coeff=source_variable, var=variable) - source_variable * values
        return term
