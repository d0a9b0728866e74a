"""What the commands say of fits: what the data can tell, what was found, how sure it is, how good the curves are."""

from __future__ import annotations

import numpy as np

from fvswell.case.reading import value_type
from fvswell.fitting.diagnosis import diagnoses
from fvswell.fitting.fit import FitResult
from fvswell.fitting.identifiability import Identifiability
from fvswell.fitting.measurement import history_unit
from fvswell.fitting.model_comparison import TELLS, ModelFit, same_to_the_data
from fvswell.fitting.problem import FitProblem
from fvswell.fitting.reduced_model import FITTED_MODEL, ReducedFit
from fvswell.reporting.console import TextTable, percent
from fvswell.reporting.reports import quantity_text, words

__all__ = [
    "fit_lines", "fit_tables", "identifiability_lines", "model_table", "problem_lines", "reduced_fit_report",
    "width_text",
]  # fmt: skip

_CORRELATED = 0.95


def problem_lines(problem: FitProblem) -> list[str]:
    """What is fitted to what."""
    lines = [problem.title]
    for measurement in problem.measurements:
        span = f"{measurement.times[0]:.4g} to {measurement.times[-1]:.4g} s"
        lines.append(
            f"  measurement  {measurement.name}: {words(measurement.quantity)}, {len(measurement)} points, {span}, "
            f"{measurement.case.model} model"
        )
    for parameter in problem.parameters.every:
        if parameter.fixed:
            lines.append(f"  fixed        {words(parameter.name)}: {quantity_text(parameter.start, parameter.unit)}")
            continue
        bounds = " to ".join(quantity_text(value, parameter.unit) for value in (parameter.low, parameter.high))
        start = quantity_text(parameter.start, parameter.unit)
        lines.append(f"  parameter    {words(parameter.name)}: from {start}, within {bounds}")
    return lines


def identifiability_lines(found: Identifiability) -> list[str]:
    """What the data can tell, in words."""
    noise = "with the noise that is given" if found.noise_is_known else "if the noise is 1 % of each curve"
    lines = [f"What the data can tell at the start, {noise}:"]
    for index, name in enumerate(found.names):
        alone, together = (width_text(values[index], found.is_log[index]) for values in (found.alone, found.together))
        verdict = "told" if found.told[index] else "not told" if np.isinf(found.together[index]) else "hardly told"
        lines.append(f"  {words(name)}: {verdict}; to {together} beside the others, {alone} if they were known")
    if found.combined:
        names = [words(name) for name in found.combined]
        listed = f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
        lines.append(
            f"  {listed} trade off against each other (collinearity {found.collinearity:.0f}): the data tell them in "
            "combination better than each by itself"
        )
    return lines


def width_text(half_width: float, is_log: bool) -> str:
    """Half the width of an interval: in percent of a positive quantity, else in its unit."""
    if not np.isfinite(half_width):
        return "nothing"
    if not is_log:
        return f"+-{half_width:.3g}"
    return f"+-{100.0 * half_width:.2g} %" if half_width < 0.3 else f"a factor of {np.exp(min(half_width, 50.0)):.3g}"


def fit_tables(result: FitResult) -> list[TextTable]:
    """The parameters with their intervals, and the measurements with their misfit."""
    return [_parameter_table(result), _measurement_table(result)]


def _parameter_table(result: FitResult) -> TextTable:
    best, confidence = result.best, result.problem.settings.confidence
    errors = best.standard_errors
    rows = []
    for index, parameter in enumerate(result.problem.parameters.free):
        low, high = result.intervals.get(parameter.name, (np.nan, np.nan))
        error = errors[index] * (100.0 if parameter.log else 1.0)
        interval = ["-", "-"] if not result.profiles else [
            _end(low, parameter.unit, "below", parameter.low), _end(high, parameter.unit, "above", parameter.high)
        ]  # fmt: skip
        rows.append(
            [words(parameter.name), quantity_text(float(best.values[index]), parameter.unit), *interval,
             "-" if np.isnan(error) else f"{error:.2g} %" if parameter.log else f"{error:.3g}"]
        )  # fmt: skip
    title = f"Best values, with {100.0 * confidence:g} % intervals by profile likelihood"
    return TextTable(title, ["parameter", "best", "from", "to", "standard error"], rows)


def _end(value: float, unit: str, side: str, bound: float) -> str:
    return f"open {side} ({bound:.3g})" if np.isnan(value) else quantity_text(value, unit)


def _measurement_table(result: FitResult) -> TextTable:
    rows = []
    measured = zip(result.problem.measurements, result.best.noise, result.residual_tests, strict=True)
    for measurement, noise, test in measured:
        given = "given" if measurement.noise is not None else f"{100.0 * noise / measurement.size:.2g} % of the curve"
        unit = history_unit(measurement.units)
        rows.append(
            [measurement.name, str(len(measurement)), f"{noise:.3g} {unit}".strip(), given,
             f"{test.runs} of {test.expected_runs:.0f}", f"{test.autocorrelation:+.2f}",
             f"{100.0 * test.relative:+.2g} %"]
        )  # fmt: skip
    header = ["measurement", "points", "noise", "", "runs of one sign", "autocorrelation", "systematic misfit"]
    return TextTable("Residuals", header, rows)


def fit_lines(result: FitResult) -> list[str]:
    """What else is to be said of a fit."""
    best, parameters = result.best, result.problem.parameters
    lines = []
    for name, bound, parameter in zip(parameters.names, best.at_bound, parameters.free, strict=True):
        if bound:
            at = parameter.low if bound == "low" else parameter.high
            lines.append(
                f"{words(name)} lies at its {'lower' if bound == 'low' else 'upper'} bound, "
                f"{quantity_text(at, parameter.unit)}: a better value may lie beyond"
            )
    lines += _correlation_lines(result)
    for test in result.residual_tests:
        if test.structured:
            lines.append(
                f"the misfit of {test.measurement} is not noise: {test.runs} runs of one sign where noise has "
                f"{test.expected_runs:.0f}, up to {100.0 * abs(test.relative):.2g} % of the curve at {test.time:.4g} "
                "s; the model does not follow it, and intervals are too narrow"
            )
    lines += diagnoses(result)
    if len(best.searches) > 1:
        ended = sum(search.converged for search in best.searches)
        given_up = f"; {len(best.searches) - ended} were given up on their way" if ended < len(best.searches) else ""
        lines.append(f"{best.agreeing} of {len(best.searches)} searches came there{given_up}")
    if result.samples is not None:
        lines += _sample_lines(result)
    failed = sum(result.failed.values())
    lines.append(
        f"{result.runs} parameter sets, {result.seconds:.1f} s" + f", {failed} could not be run" * bool(failed)
    )
    return lines


def _correlation_lines(result: FitResult) -> list[str]:
    names, correlations = result.problem.parameters.names, result.best.correlations
    return [
        f"{words(names[i])} and {words(names[j])} are correlated by {correlations[i, j]:+.3f}"
        for i in range(len(names))
        for j in range(i)
        if abs(correlations[i, j]) > _CORRELATED
    ]


def _sample_lines(result: FitResult) -> list[str]:
    samples = result.samples
    assert samples is not None
    lines = [
        f"posterior of {words(parameter.name)}: {quantity_text(low, parameter.unit)} to "
        f"{quantity_text(high, parameter.unit)}"
        for parameter, (low, high) in zip(result.problem.parameters.free, samples.intervals, strict=True)
    ]
    if not samples.long_enough:
        lines.append(
            f"the chain of {samples.steps} steps is short for its autocorrelation time of "
            f"{samples.autocorrelation:.0f}: take more, 50 times it"
        )
    return lines


def model_table(models: tuple[ModelFit, ...]) -> tuple[TextTable, list[str]]:
    """Models fitted to the same data, and what that says."""
    known = [each.aicc for each in models if np.isfinite(each.aicc)]
    least, lowest = min(known, default=np.nan), min((m.bic for m in models if np.isfinite(m.bic)), default=np.nan)
    rows = []
    for each in models:
        squares = "-" if each.result is None else f"{each.result.best.squares:.6g}"
        count = "-" if each.result is None else str(each.result.problem.n_parameters())
        rows.append([each.model, count, squares, _difference(each.aicc - least), _difference(each.bic - lowest)])
    alike = same_to_the_data(models)
    lines = [f"{each.model}: {each.reason}" for each in models if each.reason]
    lines += [f"{each.model} does not have {', '.join(map(words, each.idle))}" for each in models if each.idle]
    if len(alike) > 1:
        lines.append(f"the data cannot tell {' and '.join(alike)} apart (AICc within 2)")
    elif alike:
        others = [each.model for each in models if each.aicc - least > TELLS]
        clear = f"; {' and '.join(others)} follow{'s' * (len(others) == 1)} clearly worse" if others else ""
        lines.append(f"{alike[0]} follows best for its parameters{clear}")
    header = ["model", "parameters", "sum of squares", "AICc above the least", "BIC above the least"]
    return TextTable("Models fitted to the same data", header, rows), lines


def _difference(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"


def reduced_fit_report(fit: ReducedFit) -> tuple[list[str], TextTable]:
    """The best value with what it is to be judged by, and a table of how well the model follows."""
    problem = fit.problem
    reader = value_type(type(problem.case.tissue).model_fields[problem.parameter])
    unit = reader.unit if reader is not None else ""
    lines = [
        f"best {words(problem.parameter)}: {quantity_text(fit.best, unit)}, {fit.ratio:.4f} of the case's "
        f"{quantity_text(problem.present, unit)} ({percent(fit.ratio - 1.0)})",
    ]
    if fit.at_limit:
        lines.append("this is an end of the range that was searched: a better value may lie beyond")
    lines.append(f"{fit.result.runs} runs of the fitted model, 1 of {problem.reference}, {fit.seconds:.0f} s")
    rows = [
        [phase, words(quantity), f"{old:.6f}", f"{new:.6f}"]
        for phase, quantity, old, new in zip(problem.phases, fit.quantities, fit.before, fit.after, strict=True)
    ]
    title = f"R^2 of the {FITTED_MODEL} model to {problem.reference}"
    return lines, TextTable(title, ["phase", "history", "with the case's value", "with the best"], rows)
