"""The problem of a fit: measured curves, and parameters of the cases that are to follow them.

It speaks the convention of PINTS (Clerx et al. 2019, doi:10.5334/jors.252) as well: an object with ``n_parameters()``,
``n_outputs()`` and ``simulate(parameters, times)``, so that PINTS, pyPESTO or a sampler of one's own can drive it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate

import numpy as np

from fvswell.case.case import Case
from fvswell.errors import SolverError
from fvswell.fitting.measurement import Measurement
from fvswell.fitting.parameters import Parameters
from fvswell.fitting.simulated import Experiment
from fvswell.physics.tissue import Array
from fvswell.version import __version__

__all__ = ["FitProblem", "Settings", "Span"]


@dataclass(frozen=True)
class Settings:
    """How the fit is done.

    Parameters
    ----------
    starts
        Number of searches: one from the given start, the others from the best of points spread over the bounds.
    seed
        Of these points, and of posterior samples.
    confidence
        Of the intervals, between 0 and 1.
    """

    starts: int = 4
    seed: int = 0
    confidence: float = 0.9


@dataclass(frozen=True)
class Span:
    """Where a measurement is found: in which experiment, at which of its times, and in the vector of all points."""

    experiment: int
    quantity: int
    times: Array  # indices into the times of the experiment
    points: slice


class FitProblem:
    """Measured curves and the parameters that are to follow them.

    Parameters
    ----------
    measurements
        One or more, with different names.
    parameters
        One or more, of which one or more are free.
    settings
        How the fit is done.
    title
        What is fitted, in a line.
    source
        What to call it in messages.
    """

    def __init__(
        self,
        measurements: Sequence[Measurement],
        parameters: Parameters,
        settings: Settings | None = None,
        title: str = "fit",
        source: str = "fit",
    ) -> None:
        self.measurements, self.parameters = tuple(measurements), parameters
        self.settings, self.title, self.source = settings or Settings(), title, source

    def n_parameters(self) -> int:
        """Number of free parameters."""
        return len(self.parameters)

    def n_outputs(self) -> int:
        """Number of measured quantities of the one experiment."""
        return len(self._only_experiment().quantities)

    def simulate(self, parameters: Sequence[float] | Array, times: Sequence[float] | Array) -> Array:
        """Histories of the measured quantities of the one experiment.

        Parameters
        ----------
        parameters
            Values of the free parameters in internal units, in the order of ``parameters.names``.
        times
            s since the run began, increasing, shape (times,).

        Returns
        -------
        array
            Shape ``(times,)``, or ``(times, n_outputs)`` where more than one quantity was measured.

        Raises
        ------
        ValueError
            If the measurements are of different experiments: take the problem of each by `of_measurement`.
        CaseError
            If the parameters make an impossible case.
        SolverError
            If the run has to stop.
        """
        experiment = replace(self._only_experiment(), times=np.asarray(times, dtype=float))
        values = experiment.histories(self.changes(np.asarray(parameters, dtype=float), 0)).T
        return values[:, 0] if values.shape[1] == 1 else values

    def of_measurement(self, name: str) -> FitProblem:
        """The problem with one of the measurements alone, and the same parameters."""
        chosen = [measurement for measurement in self.measurements if measurement.name == name]
        return FitProblem(chosen, self.parameters, self.settings, f"{self.title}: {name}", self.source)

    @cached_property
    def experiments(self) -> tuple[Experiment, ...]:
        """What is simulated: measurements of one case and one set of parameters share a run."""
        found = []
        for members in self._groups:
            own = [self.measurements[index] for index in members]
            times = np.unique(np.concatenate([measurement.times for measurement in own]))
            quantities = tuple(dict.fromkeys(measurement.quantity for measurement in own))
            found.append(Experiment.of(own[0].case, quantities, times))
        return tuple(found)

    @cached_property
    def spans(self) -> tuple[Span, ...]:
        """Where each measurement is found."""
        ends = list(accumulate(map(len, self.measurements)))
        found = []
        for index, measurement in enumerate(self.measurements):
            group = next(number for number, members in enumerate(self._groups) if index in members)
            experiment = self.experiments[group]
            times = np.searchsorted(experiment.times, measurement.times)
            points = slice(ends[index] - len(measurement), ends[index])
            found.append(Span(group, experiment.quantities.index(measurement.quantity), times, points))
        return tuple(found)

    @cached_property
    def data(self) -> Array:
        """All measured values, one measurement after the other, (points,)."""
        return np.concatenate([measurement.values for measurement in self.measurements])

    @cached_property
    def weights(self) -> Array:
        """How often each point counts, (points,)."""
        return np.concatenate([np.full(len(each), each.weight) for each in self.measurements])

    @property
    def noise_is_known(self) -> bool:
        """Whether the noise of all measurements is given."""
        return all(measurement.noise is not None for measurement in self.measurements)

    @property
    def degrees_of_freedom(self) -> float:
        """Points, as often as they count, less free parameters."""
        return float(self.weights.sum()) - self.n_parameters()

    def scales(self, noise: Sequence[float]) -> Array:
        """Noise of each point from that of each measurement, (points,)."""
        return np.concatenate([np.full(len(each), level) for each, level in zip(self.measurements, noise, strict=True)])

    def changes(self, values: Array, experiment: int) -> dict[str, float]:
        """What values of the free parameters change in the case of an experiment, by dotted key."""
        return self.parameters.changes(values, self.measurements[self._groups[experiment][0]].name)

    def case(self, values: Array, experiment: int) -> Case:
        """The case of an experiment with values of the free parameters."""
        return self.experiments[experiment].case.with_numbers(self.changes(values, experiment))

    def curves(self, histories: Sequence[Array]) -> Array:
        """Vector of all points from the histories of the experiments, (points,)."""
        return np.concatenate([histories[span.experiment][span.quantity, span.times] for span in self.spans])

    def check(self) -> Array:
        """Run it at its start; gives the curves there, (points,).

        Raises
        ------
        CaseError
            If the start cannot be, or a measured quantity is none of the case's histories.
        SolverError
            If a run has to stop.
        """
        start = self.parameters.values(self.parameters.start)
        histories = []
        for index, experiment in enumerate(self.experiments):
            try:
                histories.append(experiment.histories(self.changes(start, index)))
            except SolverError as error:
                raise SolverError(f"at the start of the fit: {error}") from None
        return self.curves(histories)

    @cached_property
    def sha256(self) -> str:
        """Checksum of all that the simulated curves depend on."""
        digest = hashlib.sha256(__version__.encode())
        for experiment in self.experiments:
            digest.update(experiment.case.to_toml().encode())
            digest.update(repr(experiment.quantities + experiment.durations).encode())
            digest.update(np.ascontiguousarray(experiment.times).tobytes())
        digest.update(repr(self.parameters.every).encode())
        digest.update(repr([(m.name, m.quantity, m.times.tobytes()) for m in self.measurements]).encode())
        return digest.hexdigest()

    @cached_property
    def _groups(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the measurements that share a run."""
        groups: dict[tuple[str, tuple[bool, ...]], list[int]] = {}
        for index, measurement in enumerate(self.measurements):
            own = tuple(parameter.belongs_to(measurement.name) for parameter in self.parameters.every)
            groups.setdefault((measurement.case.sha256, own), []).append(index)
        return tuple(tuple(members) for members in groups.values())

    def _only_experiment(self) -> Experiment:
        if len(self.experiments) > 1:
            names = ", ".join(measurement.name for measurement in self.measurements)
            raise ValueError(
                f"the measurements {names} are of different experiments: take each by of_measurement(name)"
            )
        return self.experiments[0]
