"""Why a model cannot follow a curve, where that is known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fvswell.case.case import Case
from fvswell.case.loads import settled
from fvswell.fitting.fit import FitResult
from fvswell.fitting.measurement import Measurement
from fvswell.physics.tissue import Array

__all__ = ["PEAK_MISFIT", "diagnoses", "peak_ratios"]

PEAK_MISFIT = 0.05  # of a peak: a curve that misses it by more does not follow it
_MOST_OF_ISOTROPIC = 1.5  # peak over equilibrium of an isotropic disc, Armstrong et al. (1984)
_FEWEST = 5  # points of a phase


def diagnoses(result: FitResult) -> list[str]:
    """What is to be said of measurements whose peaks the curves miss."""
    found = []
    for measurement, span in zip(result.problem.measurements, result.problem.spans, strict=True):
        durations = result.problem.experiments[span.experiment].durations
        curve = result.best.curves[span.points]
        for phase, at in _relaxations(measurement, durations):
            peak = at[np.argmax(np.abs(measurement.values[at] - measurement.values[at[0]]))]
            gap = (curve[peak] - measurement.values[peak]) / measurement.values[peak]
            if abs(gap) <= PEAK_MISFIT:
                continue
            side = "below" if gap < 0.0 else "above"
            text = (
                f"the model cannot follow the peak of {measurement.name} in {phase}: {100.0 * abs(gap):.0f} % {side} it"
            )
            ratio = _ratio(measurement.values[at])
            if _is_isotropic_disc(measurement.case) and gap < 0.0 and ratio > _MOST_OF_ISOTROPIC:
                text += (
                    f"; its rise is {ratio:.1f} times what is left in equilibrium, and isotropic solids have "
                    f"peak/equilibrium at most {_MOST_OF_ISOTROPIC}: give the tissue fibres"
                )
            found.append(text)
    return found


def peak_ratios(measurement: Measurement, durations: tuple[float, ...]) -> dict[str, float]:
    """Rise to the peak over the rise that is left at the end, in each phase in which a plate is moved and held."""
    return {phase: _ratio(measurement.values[at]) for phase, at in _relaxations(measurement, durations)}


def _ratio(values: Array) -> float:
    rises = values - values[0]
    peak = rises[np.argmax(np.abs(rises))]
    return float(peak / rises[-1]) if rises[-1] else float("inf")


def _relaxations(measurement: Measurement, durations: tuple[float, ...]) -> list[tuple[str, Array]]:
    """Phases with a ramp of a displacement that is held, in which pressure or force was measured, and their points."""
    if not measurement.quantity.endswith(("_pressure", "_force")):
        return []
    found = []
    for phase, (start, end) in zip(measurement.case.phase, pairwise(np.cumsum([0.0, *durations])), strict=True):
        ramps = [load for name, load in phase.loads().items() if name.endswith(".displacement")]
        held = any(0.0 < settled(load) < end - start for load in ramps)
        at = np.flatnonzero((measurement.times >= start) & (measurement.times <= end))
        if held and len(at) >= _FEWEST:
            found.append((phase.name, at))
    return found


def _is_isotropic_disc(case: Case) -> bool:
    return case.geometry.kind == "axisymmetric" and not getattr(case.tissue, "fibres", ())
