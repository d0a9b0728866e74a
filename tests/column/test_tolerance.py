"""The tolerance means what it says: the largest error of the global strain at outputs, over its largest value."""

from __future__ import annotations

import numpy as np
import pytest
from integrations import Integration, compression, first_step, integrate, make_column, make_control, swelling
from random_columns import RandomRun, random_run

from fvswell.numerics.loads import Protocol, make_protocol
from fvswell.physics.tissue import Array

CONVERGED = 1e-8


def output_times(durations: list[float]) -> Array:
    """From a thousandth of each phase on."""
    starts = np.concatenate([[0.0], np.cumsum(durations)[:-1]])
    return np.concatenate([s + d * np.geomspace(1e-3, 1.0, 30) for s, d in zip(starts, durations, strict=True)])


def relative_error(case: RandomRun, tolerances: tuple[float, ...]) -> list[float]:
    """Errors of the global strain over the tolerance, and, of a sample that is held, of the mean change of J."""
    times, strain = output_times(case.durations), case.expected_strain()

    def run(tolerance: float) -> Integration:
        control = make_control(tolerance=tolerance, expected_strain=strain, first_step=first_step(case.column))
        done = integrate(case.column, make_protocol(case.phases, case.durations, times), control)
        assert done.complete
        assert done.filled("errors").max() < 1e-10
        return done

    def changes(done: Integration) -> Array:
        return done.filled("contents")[:, 0] if case.kind == "held, bath" else done.height[:, None]

    widths, exact = case.column.grid.widths, run(CONVERGED)
    result = []
    for tolerance in tolerances:
        gap = np.abs(changes(run(tolerance)) - changes(exact))
        error = gap @ widths / case.height if case.kind == "held, bath" else gap[:, 0] / case.height
        result.append(float(error.max()) / max(strain, float(np.abs(exact.strain).max())) / tolerance)
    return result


def test_random_columns_and_protocols() -> None:
    """Of twenty at three tolerances none errs by more than half as much again, nine in ten by less than 0.8."""
    errors = np.array([relative_error(random_run(seed), (1e-3, 1e-4, 1e-5)) for seed in range(20)])
    assert np.all(errors < 1.5), errors.max(axis=0)
    assert np.all(np.quantile(errors, 0.9, axis=0) < 0.8)


@pytest.mark.slow
def test_many_random_columns_and_protocols() -> None:
    errors = np.array([relative_error(random_run(seed), (1e-3, 1e-4, 1e-5)) for seed in range(300)])
    assert np.all(errors < 2.0), errors.max(axis=0)
    assert np.all(np.quantile(errors, 0.97, axis=0) < 1.1)


@pytest.mark.parametrize("make", [compression, swelling])
@pytest.mark.parametrize("model", ["biphasic-swelling", "electrochemical"])
def test_reference_cases(model: str, make: type[Protocol]) -> None:
    """Loading and unloading, the sample ending where it began."""
    column, times = make_column(model, cells=50), output_times([600.0, 600.0])
    expected = 0.22 if make is compression else 0.07

    def strain(tolerance: float) -> Array:
        control = make_control(tolerance=tolerance, expected_strain=expected, first_step=first_step(column))
        return integrate(column, make(output_times=times), control).strain  # type: ignore[call-arg]

    exact = strain(CONVERGED)
    for tolerance in (1e-3, 1e-4, 1e-5):
        assert np.abs(strain(tolerance) - exact).max() < tolerance * np.abs(exact).max()
