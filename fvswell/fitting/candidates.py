"""Candidate protocols of a plan: cases, and what is varied in them, made into problems without data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from fvswell.case.case import Case, parse_setting
from fvswell.case.errors import CaseError, Problem, nearest_name, shown
from fvswell.fitting.measurement import Measurement, histories_of, history_dimension, history_unit
from fvswell.fitting.parameters import Parameters
from fvswell.fitting.problem import FitProblem, Settings
from fvswell.fitting.schema import ParameterTable
from fvswell.fitting.sought import parameter_of
from fvswell.simulation.relaxation import phase_durations
from fvswell.study.schema import varied_quantity
from fvswell.units import QuantityError, number_or_text, parse

__all__ = ["candidate_problems", "read_variation", "varied_cases"]

_POINTS = 200  # of a protocol, where no interval is given
_MOST_POINTS = 400  # that are simulated; more are counted by weight


def read_variation(text: str) -> tuple[str, list[Any]]:
    """Key and values of "KEY=V1,V2,..."; text in double quotes may hold commas."""
    key, _ = parse_setting(text)
    values = [part.strip() for part in text.partition("=")[2].split(",")]
    if not all(values):
        raise CaseError(
            [Problem("--vary", text, 'must be KEY=VALUE,VALUE,..., such as "bath.concentration=0.1 M,1 M"')], "plan"
        )
    return key, [number_or_text(value) for value in values]


def varied_cases(cases: Mapping[str, Case], variations: Sequence[tuple[str, Sequence[Any]]]) -> dict[str, Case]:
    """Every case with every combination of varied values, by a name that says them.

    Raises
    ------
    CaseError
        With all that is wrong with any of them.
    """
    found, problems = {}, []
    for name, case in cases.items():
        for values in product(*(each for _, each in variations)):
            changes = dict(zip((key for key, _ in variations), values, strict=True))
            told = [] if len(cases) == 1 and changes else [name]
            label = ", ".join([*told, *(f"{_short(key)} {value}" for key, value in changes.items())])
            try:
                found[label] = case.with_changes(changes) if changes else case
            except CaseError as error:
                problems += [Problem(each.key, each.given, f"{label}: {each.message}") for each in error.problems]
    if problems:
        raise CaseError(problems, "plan")
    return found


def candidate_problems(
    cases: Mapping[str, Case],
    parameters: Sequence[ParameterTable],
    quantities: Sequence[str],
    noise: Sequence[str],
    every: float | None,
    confidence: float,
) -> list[FitProblem]:
    """A problem for each candidate, with the noise and the number of points that it would have.

    Parameters
    ----------
    cases
        By name.
    parameters
        What is to be found; their starts are the values at which the plan is made.
    quantities
        Histories that are measured.
    noise
        Standard deviation of each.
    every
        Time between points, s; without it 200 points of each protocol.
    confidence
        Of the intervals.

    Raises
    ------
    CaseError
        With all that is wrong.
    """
    problems: list[Problem] = []
    found = []
    for name, case in cases.items():
        try:
            sought = Parameters([parameter_of(table, [case]) for table in parameters])
            measurements = [
                _measured(case, quantity, level, every) for quantity, level in zip(quantities, noise, strict=True)
            ]
            found.append(FitProblem(measurements, sought, Settings(confidence=confidence), name, name))
        except CaseError as error:
            problems += error.problems
    if problems:
        raise CaseError(list(dict.fromkeys(problems)), "plan")
    return found


def _measured(case: Case, quantity: str, noise: str, every: float | None) -> Measurement:
    """A measurement whose values do not matter."""
    known = histories_of(case)
    if quantity not in known:
        near = nearest_name(quantity, known)
        hint = f"did you mean {near}?" if near else f"there are {', '.join(known)}"
        raise CaseError([Problem("quantity", shown(quantity), f"is no history of this case; {hint}")], case.source)
    units = known[quantity].units
    try:
        level = parse(number_or_text(noise), history_dimension(units))
        if not level > 0.0:
            raise QuantityError(f"must be above 0 {history_unit(units)}".strip())
    except QuantityError as error:
        raise CaseError([Problem("noise", shown(noise), str(error))], case.source) from None
    end = float(sum(phase_durations(case)))
    count = _POINTS if every is None else max(int(end / every), 3)
    simulated = min(count, _MOST_POINTS)
    times = end * np.arange(1, simulated + 1) / simulated
    return Measurement(quantity, case, quantity, times, np.zeros(simulated), level, count / simulated)


def _short(key: str) -> str:
    """The last parts of a key, enough to know it by."""
    quantity = key.split(".")
    varied_quantity(key)
    return " ".join(quantity[-2:]).replace("_", " ")
