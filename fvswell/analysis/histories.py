"""Histories and profiles of results at times of common interest.

Results of different models have outputs at different times. A history is interpolated within a phase, over the square
root of the time since it began; nothing is read off across a change of phase.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import xarray as xr

from fvswell.case.time_stepping import STEPS_PER_PHASE
from fvswell.physics.tissue import Array
from fvswell.prediction.determination import NO_VARIATION
from fvswell.results.file import SAME_TIME

__all__ = [
    "FEWEST_OUTPUTS",
    "all_histories",
    "common_times",
    "has_outputs",
    "history_at",
    "is_known",
    "local_strain",
    "phase_histories",
    "profile_at",
    "rounding_of",
]

FEWEST_OUTPUTS = 2  # in a phase: fewer make no history
_NO_CHANGE = 1e-6


def has_outputs(results: Iterable[xr.Dataset], start: float, end: float) -> bool:
    """Whether each result has outputs enough in a phase to compare histories there."""
    return all(len(_within(result["time"].values, start, end)) >= FEWEST_OUTPUTS for result in results)


def rounding_of(result: xr.Dataset, quantity: str) -> float:
    """Variation of a history in a phase below which nothing happens: a millionth of its size in the whole run."""
    return max(NO_VARIATION, _NO_CHANGE * float(np.nanmax(np.abs(result[quantity].values))))


def phase_histories(
    results: Mapping[str, xr.Dataset], quantity: str, start: float, end: float
) -> tuple[Array, dict[str, Array]]:
    """Common times in a phase and the history of a quantity there in each result."""
    times = {name: result["time"].values for name, result in results.items()}
    at = common_times(list(times.values()), start, end)
    return at, {name: history_at(times[name], result[quantity].values, start, at) for name, result in results.items()}


def all_histories(
    results: Mapping[str, xr.Dataset], quantity: str, start: float, end: float
) -> tuple[Array, dict[str, Array]]:
    """Histories in a phase at the times of `phase_histories` and at all outputs of any result.

    They begin where every result has an output: before it a jump at the start of the phase would be interpolated.
    """
    times = [result["time"].values for result in results.values()]
    own = [_within(each, start, end) for each in times]
    every = np.unique(np.concatenate([common_times(times, start, end), *own]))
    begun = every >= max((each[0] for each in own if each.size), default=start)
    every = every[begun & (np.diff(every, append=np.inf) > SAME_TIME * end)]
    return every, {
        name: history_at(result["time"].values, result[quantity].values, start, every)
        for name, result in results.items()
    }


def common_times(times: Sequence[Array], start: float, end: float) -> Array:
    """Times in a phase at which histories are compared, so that R^2 gives all times the same weight.

    The ends of 50 equal steps where all have outputs there; else the output times after ``start`` up to ``end``, s, if
    they are the same in all of ``times``; else those ends again, between outputs.
    """
    slack = SAME_TIME * end
    even = start + (end - start) * np.arange(1, STEPS_PER_PHASE + 1) / STEPS_PER_PHASE
    within = [_within(each, start, end) for each in times]
    first = within[0]
    if all(_contains(each, even, slack) for each in within):
        return even
    if first.size and all(
        each.shape == first.shape and np.allclose(each, first, rtol=0.0, atol=slack) for each in within
    ):
        return first
    return even


def _contains(times: Array, wanted: Array, slack: float) -> bool:
    """Whether all wanted times are among increasing ones."""
    if not times.size:
        return False
    after = np.searchsorted(times, wanted).clip(max=len(times) - 1)
    before = np.maximum(after - 1, 0)
    return bool(np.all(np.minimum(np.abs(times[after] - wanted), np.abs(times[before] - wanted)) <= slack))


def history_at(time: Array, values: Array, start: float, at: Array) -> Array:
    """A history at given times of a phase; nan beyond its ends.

    Between its own times it is interpolated, by a monotone cubic over the square root of the time since the
    phase began: what follows a jump is about linear in that root.

    Parameters
    ----------
    time, values
        The history, shape ``(times,)``, s.
    start
        When the phase began, s.
    at
        Times wanted, s, none before ``start``.
    """
    slack = SAME_TIME * float(np.max(at))
    nearest = np.abs(time[:, None] - at).argmin(axis=0)
    if np.all(np.abs(time[nearest] - at) <= slack):
        return values[nearest]
    own = (time >= start - slack) & (time <= at.max() + slack)
    if own.sum() < 2:
        return np.full(at.shape, np.nan)
    from scipy.interpolate import PchipInterpolator  # a tenth of a second, which not every comparison needs

    root, last = np.sqrt(np.maximum(time[own] - start, 0.0)), time[own][-1]
    inside = PchipInterpolator(root, values[own])(np.sqrt(np.minimum(at, last) - start))
    return np.where(at <= last + slack, inside, np.nan)


def is_known(result: xr.Dataset, at: float) -> bool:
    """Whether a result has an output at a time, s, or outputs of one phase before and after it.

    The state at the start of a phase is not of the phase: loads may jump there.
    """
    times, ends = result["time"].values, result["phase_end"].values
    slack = SAME_TIME * times[-1]
    if at > times[-1] + slack:
        return False
    before, after = times[times <= at + slack].max(), times[times >= at - slack].min()
    starts = np.append(0.0, ends)
    return not ((starts >= before - slack) & (starts < after - slack)).any()


def profile_at(result: xr.Dataset, values: Array, at: float) -> Array:
    """A profile of a result at a time, linear between its outputs, nan where it is not known (`is_known`).

    Parameters
    ----------
    result
        With the times of the outputs and the ends of the phases.
    values
        The profiles at the outputs, ``(times, points)``.
    at
        Time wanted, s.
    """
    if not is_known(result, at):
        return np.full(values.shape[1], np.nan)
    time = result["time"].values
    upper = int(np.searchsorted(time, at).clip(max=len(time) - 1))
    lower = max(upper - 1, 0)
    share = np.clip((at - time[lower]) / (time[upper] - time[lower]), 0.0, 1.0) if upper > lower else 0.0
    return values[lower] + share * (values[upper] - values[lower])


def local_strain(result: xr.Dataset) -> Array:
    """Strain of each cell from the equilibrated sample, ``(times, cells)``."""
    J = result["volume_ratio"].values
    return J / J[0] - 1.0


def _within(times: Array, start: float, end: float) -> Array:
    """Those of the times that lie after the start of a phase and not behind its end."""
    slack = SAME_TIME * end
    return times[(times > start + slack) & (times <= end + slack)]
