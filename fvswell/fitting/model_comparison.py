"""Models compared on the same data: which follows best for its number of parameters, and whether the data can tell.

By the information criteria of Akaike, corrected for few data (AICc), and of Schwarz (BIC), for Gaussian noise
(Burnham & Anderson 2002, Model Selection and Multimodel Inference, sections 2.2 and 2.4). Their differences count,
not their sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fvswell.case.errors import CaseError, Problem
from fvswell.errors import SolverError
from fvswell.fitting.evaluator import FitProgress
from fvswell.fitting.fit import FitResult, fit
from fvswell.fitting.parameters import Parameters
from fvswell.fitting.problem import FitProblem

__all__ = ["ModelFit", "compare_models", "criteria", "same_to_the_data"]

TELLS = 10.0  # difference of AICc from which a model has hardly any support
UNDECIDED = 2.0  # up to which two models are alike


@dataclass(frozen=True)
class ModelFit:
    """A model fitted to the data, or why it cannot be."""

    model: str
    result: FitResult | None
    idle: tuple[str, ...]  # parameters that it does not have
    aicc: float
    bic: float
    reason: str = ""

    @property
    def row(self) -> dict[str, Any]:
        """In short."""
        values = {} if self.result is None else self.result.values
        squares = None if self.result is None else self.result.best.squares
        return {"model": self.model, "aicc": self.aicc, "bic": self.bic, "sum_of_squares": squares, "values": values,
                "without_effect": list(self.idle), "reason": self.reason}  # fmt: skip


def compare_models(
    problem: FitProblem,
    models: Sequence[str],
    processes: int | None = None,
    scheduler: str | None = None,
    report: Callable[[FitProgress], None] | None = None,
) -> tuple[ModelFit, ...]:
    """Fit each model to the data of a problem; parameters that a model does not have are left out for it.

    Raises
    ------
    CaseError
        If a model is unknown.
    """
    found = []
    for model in models:
        cases = {each.name: each.case.with_changes({"model": model}) for each in problem.measurements}
        measurements = [replace(each, case=cases[each.name]) for each in problem.measurements]
        title = f"{problem.title}: {model}"
        own = FitProblem(measurements, problem.parameters, problem.settings, title, problem.source)
        found.append(_fitted(own, model, processes, scheduler, report))
    return tuple(found)


def _fitted(
    problem: FitProblem, model: str, processes: int | None, scheduler: str | None,
    report: Callable[[FitProgress], None] | None,
) -> ModelFit:  # fmt: skip
    idle: tuple[str, ...] = ()
    while True:
        try:
            result = fit(problem, with_profiles=False, processes=processes, scheduler=scheduler, report=report)
        except CaseError as error:
            names = tuple(_named(each) for each in error.problems)
            if not all(name in problem.parameters.names for name in names) or len(names) == len(problem.parameters):
                return ModelFit(model, None, idle, np.nan, np.nan, "; ".join(map(str, error.problems)))
            idle += names
            every = [replace(each, fixed=each.fixed or each.name in names) for each in problem.parameters.every]
            problem = FitProblem(
                problem.measurements, Parameters(every), problem.settings, problem.title, problem.source
            )
        except SolverError as error:
            return ModelFit(model, None, idle, np.nan, np.nan, str(error))
        else:
            return ModelFit(model, result, idle, *criteria(result))


def _named(problem: Problem) -> str:
    """Parameter that a problem is about, as `fit` reports those without effect."""
    return problem.key.removeprefix("parameter[").removesuffix("]")


def criteria(result: FitResult) -> tuple[float, float]:
    """AICc and BIC of a fit.

    -2 ln L is the sum of squares over the variance where the noise is given, else N ln(S/N) for each measurement, whose
    variance is a parameter more.
    """
    problem, best = result.problem, result.best
    deviance, count, parameters = 0.0, 0.0, float(problem.n_parameters())
    for measurement, span in zip(problem.measurements, problem.spans, strict=True):
        own = (measurement.values - best.curves[span.points]) / (measurement.noise or measurement.size)
        number, squares = measurement.weight * len(measurement), measurement.weight * float(own @ own)
        count += number
        if measurement.noise is not None:
            deviance += squares
        else:
            deviance += number * np.log(max(squares / number, 1e-30))
            parameters += 1.0
    room = count - parameters - 1.0
    aicc = deviance + 2.0 * parameters + (2.0 * parameters * (parameters + 1.0) / room if room > 0.0 else np.inf)
    return float(aicc), float(deviance + parameters * np.log(count))


def same_to_the_data(models: Sequence[ModelFit]) -> tuple[str, ...]:
    """Models that the data cannot tell from the best of them."""
    known = [each for each in models if np.isfinite(each.aicc)]
    if not known:
        return ()
    least = min(each.aicc for each in known)
    return tuple(each.model for each in known if each.aicc - least <= UNDECIDED)
