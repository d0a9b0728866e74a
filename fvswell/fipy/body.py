"""Columns whose Newton steps are found by FiPy: by its matrices and its solvers.

Such a body has all that a compiled column has, and goes through the same time integrator and the same Newton iteration
in plain Python; only the step of the iteration comes from a sweep of FiPy equations.
"""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
from fipy import TransientTerm

from fvswell.block.body import BlockBody
from fvswell.column.balances import COLUMN_LOADS, HEIGHT
from fvswell.column.column import Column
from fvswell.column.stage import ColumnBody, find_electric_response, find_step
from fvswell.fipy.block_body import fipy_block_body
from fvswell.fipy.mesh import column_mesh
from fvswell.fipy.stock_terms import StockTerms
from fvswell.fipy.terms import ColumnFluxTerm, call_balances, contents_variable, direct_solver
from fvswell.numerics import body as numerics_body
from fvswell.numerics.integrator import march
from fvswell.physics.tissue import Array

__all__ = ["AssembledSetup", "ColumnEquation", "FipyColumnBody", "FluxTermEquation", "assembled", "fipy_body"]


class ColumnEquation(Protocol):
    """Balances of a column in FiPy's terms."""

    def sweep(
        self, contents: Array, base: Array, duration: float, loads: Array, pressure_rise: float,
        current_rise: float = 0.0,
    ) -> Array:  # fmt: skip
        """Contents (balances, cells) after one sweep, which is a Newton step.

        Parameters
        ----------
        contents, base
            What the balances are linearised about, and what they start from.
        duration
            Of the step, s.
        loads
            Values of `COLUMN_LOADS`.
        pressure_rise
            Applied above the pressure of the loads, MPa; the balances are linear in it.
        current_rise
            Above the current of the loads, A/mm2, of a column that finds its current; the same.
        """


class FipyColumnBody(SimpleNamespace):
    """A column whose Newton steps are those of ``equation``; all else is what a `ColumnBody` has, by the same names."""


for _name in numerics_body.__all__:
    # registered for Python alone: numba need not know of it, nor compile anew because of it
    _function = getattr(numerics_body, _name)
    _function.implementations[FipyColumnBody] = _function.implementations[ColumnBody]


def _find_step(body: Any, contents: Array, base: Array, duration: float, loads: Array) -> None:
    swept = body.equation.sweep(contents, base, duration, loads, 0.0)
    body.step[:] = swept - contents
    if not np.isnan(loads[HEIGHT]):
        body.response[:] = body.equation.sweep(contents, base, duration, loads, 1.0) - swept


def _find_electric_response(body: Any, contents: Array, base: Array, duration: float, loads: Array) -> None:
    swept, risen = (body.equation.sweep(contents, base, duration, loads, 0.0, rise) for rise in (0.0, 1.0))
    body.electric[:] = risen - swept


find_step.implementations[FipyColumnBody] = _find_step
find_electric_response.implementations[FipyColumnBody] = _find_electric_response


class FluxTermEquation:
    """The balances of a column as our `ColumnFluxTerm` beside FiPy's `TransientTerm`."""

    def __init__(self, column: Column, body: ColumnBody) -> None:
        start = np.ones((len(body.scale), len(body.widths)))
        self.variable = contents_variable(column_mesh(column.grid), start)
        self.fluxes = ColumnFluxTerm(body, self.variable, np.zeros(len(COLUMN_LOADS)))
        self.equation = TransientTerm(var=self.variable) + self.fluxes

    def set_iterate(
        self, contents: Array, base: Array, loads: Array, pressure_rise: float = 0.0, current_rise: float = 0.0
    ) -> None:
        """Put the equation where it is to be linearised."""
        self.fluxes.loads, self.fluxes.pressure_rise, self.fluxes.current_rise = loads, pressure_rise, current_rise
        self.variable.setValue(base)
        self.variable.updateOld()
        self.variable.setValue(contents)

    def sweep(
        self, contents: Array, base: Array, duration: float, loads: Array, pressure_rise: float,
        current_rise: float = 0.0,
    ) -> Array:  # fmt: skip
        """See `ColumnEquation`."""
        self.set_iterate(contents, base, loads, pressure_rise, current_rise)
        self.equation.sweep(dt=duration, solver=direct_solver())
        return np.array(self.variable.value)


def fipy_body(assembly: str, column: Column, initial_volume_ratio: Array) -> Any:
    """What the time integrator (`fvswell.numerics.integrator.march`, in plain Python) takes to run a column with FiPy.

    Parameters
    ----------
    assembly
        "fipy": one term, with matrix and residual from the compiled kernels; or "stock-terms": FiPy's own terms.
    column
        What is run.
    initial_volume_ratio
        As for `Column.body`.
    """
    body = column.body(initial_volume_ratio)
    equation: ColumnEquation = FluxTermEquation(column, body)
    if assembly == "stock-terms":
        equation = StockTerms(column, initial_volume_ratio)
    evaluate = partial(call_balances, body.evaluate)
    return FipyColumnBody(**body._replace(evaluate=evaluate)._asdict(), equation=equation)


class AssembledSetup:
    """What a run needs of a case (`fvswell.simulation.setup.Setup`), with a body that FiPy solves."""

    def __init__(self, setup: Any) -> None:
        self._setup = setup
        if isinstance(setup.body, BlockBody):
            self.body, self.march = fipy_block_body(setup.body), setup.march
        else:
            self.body = fipy_body(setup.case.assembly, setup.column, setup.initial_volume_ratio)
            self.march = march

    def __getattr__(self, name: str) -> Any:
        return getattr(self._setup, name)


def assembled(setup: Any) -> Any:
    """What a run needs of a case, assembled and solved as the case says."""
    return AssembledSetup(setup)
