"""From the loads of a case to those of the integrator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fvswell.case.loads import Ramp, Shape, Sine, TableLoad
from fvswell.numerics import loads as numerics

__all__ = ["measured_load", "numeric_load"]


def numeric_load(load: Shape | None, shift: float = 0.0) -> numerics.AnyLoad | None:
    """A load as the integrator takes it, plus an amount; None for one that is found."""
    if isinstance(load, Ramp):
        return numerics.Load(load.ramp_to + shift, load.over)
    if isinstance(load, TableLoad):
        return numerics.TableLoad(np.array(load.times), np.array(load.values) + shift)
    if isinstance(load, Sine):
        return numerics.Sine(load.mean + shift, load.amplitude, load.period)
    return None if load is None else numerics.Load(load + shift)


def measured_load(names: Sequence[str], part: str | None) -> int:
    """Index of the pressure of a part that is moved among the loads of a body; `STRAIN` where none is moved."""
    return numerics.STRAIN if part is None else list(names).index(f"{part}.pressure")
