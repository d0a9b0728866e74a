"""From a table of a fit file and the columns of its data file to a measurement."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from fvswell.case.case import Case
from fvswell.case.errors import CaseError, Problem, nearest_name, shown
from fvswell.errors import SolverError
from fvswell.fitting.data_file import DataFile
from fvswell.fitting.measurement import Measurement, histories_of, history_dimension, history_unit
from fvswell.fitting.schema import MeasurementTable
from fvswell.physics.tissue import Array
from fvswell.simulation.relaxation import phase_durations
from fvswell.units import DIMENSIONS, PLAIN_NUMBER, QuantityError, number_or_text, parse

__all__ = ["measurement_of", "thinned"]

_FEWEST = 3
_SLACK = 1e-6  # of the run: times in files are rounded


def measurement_of(table: MeasurementTable, case: Case, data: DataFile, place: str = "measurement") -> Measurement:
    """A measurement, checked.

    Parameters
    ----------
    table
        What the fit file says of it.
    case
        What was done to the sample.
    data
        The data file.
    place
        What to call the table in messages.

    Raises
    ------
    CaseError
        With every problem that it has.
    """
    reading = _Reading(table, case, data, place)
    measurement = reading.measurement()
    if measurement is None:
        raise CaseError(reading.problems, data.source)
    return measurement


class _Reading:
    """One measurement under way, with the problems found so far."""

    def __init__(self, table: MeasurementTable, case: Case, data: DataFile, place: str) -> None:
        self.table, self.case, self.data, self.place = table, case, data, place
        self.problems: list[Problem] = []

    def measurement(self) -> Measurement | None:
        """The measurement, None if there are problems."""
        table = self.table
        quantity = self._quantity()
        time, value = (self._column(key) for key in ("time", "value"))
        phases = self._phases()
        seconds = self._factor("time_unit", time, "time") if time is not None else None
        factor = self._factor("unit", value, self._dimension(quantity)) if value is not None and quantity else None
        if self.problems or time is None or value is None or seconds is None or factor is None or quantity is None:
            return None
        times = self.data.columns[time] * seconds - table.start
        self._check_increasing(times, time)
        values = (self.data.columns[value] - table.zero) * (table.factor * factor)
        chosen = self._chosen(times, phases)
        if not self.problems and len(chosen) < _FEWEST:
            message = f"has {len(chosen)} rows in the phases that count: a fit needs at least {_FEWEST}"
            self._report("phases", shown(table.phases or [phase.name for phase in self.case.phase]), message)
        if self.problems:
            return None
        if table.points is not None:
            chosen = chosen[thinned(times[chosen], values[chosen], table.points)]
        noise = self._noise(quantity, values[chosen])
        if self.problems:
            return None
        return Measurement(
            table.name, self.case, quantity, times[chosen], values[chosen], noise, table.weight, self.data.source
        )

    def _report(self, key: str, given: str, message: str) -> None:
        self.problems.append(Problem(f"{self.place}.{key}", given, message))

    def _quantity(self) -> str | None:
        name = self.table.quantity
        known = histories_of(self.case)
        if name in known:
            return name
        near = nearest_name(name, known)
        hint = f"did you mean {near}?" if near else "see the histories of a result by fvswell info"
        self._report("quantity", shown(name), f"is no history of a result; {hint}")
        return None

    def _dimension(self, quantity: str) -> str:
        return history_dimension(histories_of(self.case)[quantity].units)

    def _column(self, key: str) -> str | None:
        name = getattr(self.table, key)
        if name is None:
            return next(iter(self.data.columns))
        try:
            return self.data.column(name)
        except ValueError as error:
            self._report(key, shown(name), str(error))
            return None

    def _factor(self, key: str, column: str, dimension: str) -> float | None:
        """From the unit of a column to the internal one."""
        given: str | None = getattr(self.table, key)
        unit = self.data.units[column] if given is None else given
        from_result = self.data.source.endswith(".nc")
        if not unit and dimension != PLAIN_NUMBER and not from_result:
            message = (
                f"missing; the heading {shown(column)} does not say the unit, such as {DIMENSIONS[dimension].unit}"
            )
            self._report(key, "", message)
            return None
        try:
            return parse(f"1 {unit}", dimension) if unit else 1.0
        except QuantityError as error:
            found = "" if given is not None else f"of the heading {shown(column)} "
            expected = DIMENSIONS[dimension].unit or "a plain number or %"
            message = (
                f"{found}{error}" if dimension == PLAIN_NUMBER else f"{found}is not a unit of {dimension}: {expected}"
            )
            self._report(key, shown(unit), message)
            return None

    def _phases(self) -> list[str]:
        names = [phase.name for phase in self.case.phase]
        for name in self.table.phases or ():
            if name not in names:
                near = nearest_name(name, names)
                hint = f"did you mean {shown(near)}?" if near else f"there are {', '.join(map(shown, names))}"
                self._report("phases", shown(name), f"the case has no such phase; {hint}")
        return list(self.table.phases or names)

    def _check_increasing(self, times: Array, column: str) -> None:
        back = np.flatnonzero(np.diff(times) <= 0.0)
        if len(back):
            line, later = self.data.lines[back[0] + 1], self.data.columns[column][back[0] : back[0] + 2]
            more = f", and {len(back) - 1} more times" if len(back) > 1 else ""
            message = f"times must increase, but in line {line} {later[1]:g} comes after {later[0]:g}{more}"
            self._report("time", shown(column), message)

    def _chosen(self, times: Array, phases: list[str]) -> Array:
        """Rows in the phases that count."""
        try:
            ends = np.cumsum([0.0, *phase_durations(self.case)])
        except SolverError as error:
            raise CaseError([Problem(f"{self.place}.case", "", str(error))], self.data.source) from None
        slack = _SLACK * ends[-1]
        within = np.zeros(len(times), dtype=bool)
        for index, (phase, (start, end)) in enumerate(zip(self.case.phase, pairwise(ends), strict=True)):
            if phase.name in phases:
                after = times >= start - slack if index == 0 else times > start + slack
                within |= after & (times <= end + slack)
        times[within] = np.clip(times[within], 0.0, ends[-1])
        return np.flatnonzero(within)

    def _noise(self, quantity: str, values: Array) -> float | None:
        given: Any = self.table.noise
        if given is None:
            return None
        try:
            if isinstance(given, str) and given.strip().endswith("%"):
                noise = parse(given, PLAIN_NUMBER) * float(np.ptp(values))
            else:
                noise = parse(number_or_text(given), self._dimension(quantity))
            if not noise > 0.0:
                raise ValueError(f"must be above 0 {history_unit(histories_of(self.case)[quantity].units)}".strip())
        except ValueError as error:
            self._report("noise", shown(given), str(error))
            return None
        return noise


def thinned(times: Array, values: Array, count: int) -> Array:
    """Rows to keep of a curve with too many, spread evenly over the time and over the way that the values go.

    Parameters
    ----------
    times, values
        Shape (rows,).
    count
        How many to keep at most.

    Returns
    -------
    array
        Indices, increasing; the first and the last row are among them.
    """
    if len(times) <= count:
        return np.arange(len(times))
    way = _way(values, count) + (times - times[0]) / (times[-1] - times[0])
    nearest = np.searchsorted(way, np.linspace(0.0, way[-1], count) - 1e-12 * way[-1])
    return np.unique(np.clip(nearest, 0, len(times) - 1))


def _way(values: Array, count: int) -> Array:
    """How far the values have gone up and down since the first, over all of it; of averages, which lose the noise."""
    width = max(len(values) // (2 * count), 1)
    starts = np.arange(0, len(values), width)
    means = np.add.reduceat(values, starts) / np.diff(np.append(starts, len(values)))
    centres = starts + 0.5 * (np.diff(np.append(starts, len(values))) - 1)
    gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(means)))])
    whole: Array = np.interp(np.arange(len(values)), centres, gone)
    return whole / whole[-1] if whole[-1] > 0.0 else np.zeros(len(values))
