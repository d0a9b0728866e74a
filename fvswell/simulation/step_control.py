"""How a case says that steps are chosen, as the integrator takes it."""

from __future__ import annotations

import numpy as np

from fvswell.case.case import Case
from fvswell.numerics.state import Control
from fvswell.numerics.tableaux import BACKWARD_EULER, ESDIRK43

__all__ = ["FIRST_STEP", "NEWTON_TOLERANCE", "SMALLEST_STRAIN", "error_control", "step_control"]

FIRST_STEP = 0.1  # after a jump, of the time in which the finest cell consolidates
SMALLEST_STRAIN = 1e-5  # that tolerances are relative to where nothing is expected to happen
NEWTON_TOLERANCE = (
    1e-14  # of Newton's method where the steps are given, as a mean over the body: fluxes on fine cells feel more
)


def step_control(case: Case, largest_strain: float, first_step: float) -> Control:
    """Settings of the integrator for a case.

    Parameters
    ----------
    case
        Whose time stepping is meant.
    largest_strain
        That is expected; the tolerance is relative to it, or to the largest seen.
    first_step
        Where loads jump, s.
    """
    time = case.time
    if time.fixed_steps is not None:
        every = case.output.every or 0
        return Control(
            *BACKWARD_EULER, NEWTON_TOLERANCE, largest_strain, np.inf, first_step, time.fixed_steps, every
        )  # fmt: skip
    max_step = np.inf if time.max_step is None else time.max_step
    return error_control(time.tolerance, largest_strain, first_step, max_step, case.output.every or 0)


def error_control(
    tolerance: float, largest_strain: float, first_step: float, max_step: float = np.inf, every: int = 0
) -> Control:
    """Settings of the integrator with steps chosen by the error."""
    return Control(*ESDIRK43, tolerance, largest_strain, max_step, first_step, 0, every)
