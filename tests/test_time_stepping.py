"""The time loop: order of its schemes, times it has to hit, steps that fail, rows that go their own way."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from columns import compression, march, single_phase, strain_at

import fvswell
from fvswell.numerics.protocol import Drive, Protocol
from fvswell.numerics.system import LoadValues, Solution, Stage
from fvswell.numerics.time_stepping import BACKWARD_EULER, SDIRK2, Marcher, Scheme, State, Step, StepControl
from fvswell.physics.tissue import Array

RATE = np.array([0.3, 2.0])  # of two rows, 1/s


@dataclass
class Reservoir:
    """dm/dt = rate (load - m): one cell, one balance, solved exactly; fails for steps longer than it can take."""

    rate: Array
    longest: float = np.inf
    attempts: list[float] = field(default_factory=list)
    volumes = np.ones(1)
    equations = ("volume",)

    def rows(self, index: Array) -> Reservoir:
        return Reservoir(self.rate[index], self.longest, self.attempts)

    def extrapolate(self, unknowns: Array, change: Array) -> Array:
        return unknowns + change

    def solve(self, guess: Array, loads: LoadValues, stage: Stage) -> Solution:
        load = stage.prescribed["load"]
        inflow = self.rate * (load - stage.base[0, :, 0]) / (1.0 + self.rate * stage.duration)
        content = stage.base + (inflow * stage.duration)[None, :, None]
        self.attempts += stage.duration.tolist()
        return Solution(
            content, {"load": load}, content, np.stack([inflow, 0 * inflow], axis=-1)[None], inflow[None],
            np.where(stage.duration > self.longest, 7.0, 0.0)[None, :, None],
            stage.duration <= self.longest, np.ones(len(load), dtype=int),
        )  # fmt: skip


def marcher(
    system: Reservoir, control: StepControl, targets: Array, drive: Drive, duration: Array | None = None
) -> tuple[Marcher, list[tuple[Step, Array]]]:
    rows = len(system.rate)
    state = State(
        np.zeros((1, rows, 1)), {"load": np.zeros(rows)}, np.zeros((1, rows, 1)), np.zeros((1, rows, 2)),
        np.zeros(rows, dtype=int), np.zeros(rows), np.zeros(rows),
    )  # fmt: skip
    duration = np.full((rows, 1), 4.0) if duration is None else duration
    record: list[tuple[Step, Array]] = []
    protocol = Protocol(duration, {"load": drive}, (targets[None],) * duration.shape[1])
    loop = Marcher(system, protocol, control, state, [lambda s, step: record.append((step, s.elapsed.copy()))])
    loop.run()
    return loop, record


def jump(rows: int = 2, phases: int = 1) -> Drive:
    return Drive(np.ones((rows, phases)), np.zeros((rows, phases)))


@pytest.mark.parametrize(("scheme", "order"), [(BACKWARD_EULER, 1), (SDIRK2, 2)])
def test_order_of_the_scheme(scheme: Scheme, order: int) -> None:
    error = []
    for steps in (80, 160, 320):
        loop, _ = marcher(Reservoir(RATE), StepControl(scheme), 4.0 * np.arange(1, steps + 1) / steps, jump())
        error.append(np.abs(loop.state.contents[0, :, 0] - (1 - np.exp(-4.0 * RATE))))
    np.testing.assert_allclose(np.log2(np.array(error[:-1]) / error[1:]), order, atol=0.12)


@pytest.mark.parametrize("scheme", [BACKWARD_EULER, SDIRK2])
def test_schemes_are_l_stable(scheme: Scheme) -> None:
    """A step many relaxation times long ends at rest."""
    loop, _ = marcher(Reservoir(np.array([1e9, 1e12])), StepControl(scheme), np.array([4.0]), jump())
    np.testing.assert_allclose(loop.state.contents, 1.0, atol=1e-8)


def test_tolerance_bounds_the_error_of_each_step() -> None:
    """The errors of n steps add up to less than n tolerances; n goes as the cube root, the error as its square."""
    error, counts = [], []
    for tolerance in (1e-3, 1e-5, 1e-7):
        control = StepControl(SDIRK2, np.full(2, tolerance), first_step=1e-4)
        loop, record = marcher(Reservoir(RATE), control, np.array([4.0]), jump())
        error.append(np.abs(loop.state.contents[0, :, 0] - (1 - np.exp(-4.0 * RATE))))
        counts.append([sum(row in step.rows for step, _ in record) for row in range(2)])
        assert np.all(error[-1] < np.array(counts[-1]) * tolerance)
    assert np.all(error[1] / error[2] > 10.0)
    assert np.all(np.array(counts[2]) < 100 ** (1 / 3) * 1.5 * np.array(counts[1]))


def test_targets_are_hit_to_the_bit_and_steps_keep_below_the_longest() -> None:
    targets = np.array([0.1, 1 / 3, np.pi / 2, 3.9])
    control = StepControl(SDIRK2, np.full(2, 1e-4), max_step=0.3, first_step=1e-3)
    _, record = marcher(Reservoir(RATE), control, targets, jump())
    for row in range(2):
        steps = [(step, at) for step, at in record if row in step.rows]
        sizes = np.array([step.size[list(step.rows).index(row)] for step, _ in steps])
        ends = np.array([at[row] for _, at in steps])
        assert sizes.max() <= 0.3
        assert all(np.abs(ends - target).min() < 1e-15 for target in [*targets, 4.0])
        assert np.sum(sizes) == pytest.approx(4.0, rel=1e-14)
        assert steps[-1][0].ends_phase[list(steps[-1][0].rows).index(row)]


def test_steps_restart_small_after_every_jump_and_corner() -> None:
    drive = Drive(np.array([[1.0, 2.0]]), np.array([[0.0, 1.0]]))  # a step, then a ramp of 1 s
    control = StepControl(SDIRK2, np.full(1, 1e-2), first_step=1e-3)
    _, record = marcher(Reservoir(RATE[:1]), control, np.array([1.0, 4.0]), drive, np.array([[4.0, 4.0]]))
    ends = np.array([at[0] for _, at in record])
    sizes = np.array([step.size[0] for step, _ in record])
    after = [sizes[np.argmax(ends > corner + 1e-9)] for corner in (0.0, 4.0, 5.0)]
    assert after == [1e-3] * 3
    assert sizes.max() > 0.1


def test_failing_step_is_taken_smaller_and_grows_again() -> None:
    system = Reservoir(RATE[:1], longest=0.3)
    loop, record = marcher(system, StepControl(BACKWARD_EULER), np.array([2.0, 4.0]), jump(1))
    assert not loop.failures
    assert loop.state.elapsed[0] == 4.0
    assert max(step.size[0] for step, _ in record) <= 0.3
    assert max(system.attempts) == 2.0


def test_what_never_converges_is_told_with_place_and_balance_and_spares_the_other_row() -> None:
    @dataclass
    class HalfBroken(Reservoir):
        def rows(self, index: Array) -> HalfBroken:
            return HalfBroken(self.rate[index], self.longest, self.attempts)

        def solve(self, guess: Array, loads: LoadValues, stage: Stage) -> Solution:
            solution = super().solve(guess, loads, stage)
            broken = (self.rate > 1.0) & (stage.base[0, :, 0] > 0.5)
            solution.converged &= ~broken
            solution.residual[:, broken] = 7.0
            return solution

    loop, _ = marcher(HalfBroken(RATE), StepControl(BACKWARD_EULER), np.linspace(0.1, 4.0, 40), jump())
    (failure,) = loop.failures
    assert (failure.row, failure.phase, failure.balance, failure.point, failure.residual) == (1, 0, "volume", 0, 7.0)
    assert 0.0 < failure.elapsed < 1.0
    assert loop.state.elapsed.tolist() == [4.0, failure.elapsed]
    assert 0.5 < loop.state.contents[0, 1, 0] < 0.7  # where it stood
    assert "volume balance did not converge at here" in failure.reason("here")


def test_rows_march_as_they_would_alone() -> None:
    control = StepControl(SDIRK2, np.full(2, 1e-5), first_step=1e-3)
    _, together = marcher(Reservoir(RATE), control, np.array([4.0]), jump())
    for row in range(2):
        own = StepControl(SDIRK2, np.full(1, 1e-5), first_step=1e-3)
        _, alone = marcher(Reservoir(RATE[[row]]), own, np.array([4.0]), jump(1))
        sizes = [step.size[list(step.rows).index(row)] for step, _ in together if row in step.rows]
        assert sizes == [step.size[0] for step, _ in alone]


# ---- on the column ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scheme", "order"), [(BACKWARD_EULER, 1.0), (SDIRK2, 2.0)])
@pytest.mark.parametrize("model", ["biphasic", "electrochemical"])
def test_order_on_the_nonlinear_column(model: str, scheme: Scheme, order: float) -> None:
    """A ramp of the load up to 0.2 MPa; successive halvings of the step, over all unknowns."""
    case = single_phase(
        compression(geometry__cells=6, geometry__grading=1), 300.0, piston_pressure={"ramp_to": 0.2, "over": 300.0}
    )
    final = []
    for steps in (40, 80, 160):
        run, _ = march(case.with_changes({"time.steps_per_phase": steps}), StepControl(scheme), model)
        final.append(run.state.unknowns[: 1 if model == "biphasic" else 2, 0])
    change = [np.abs(b - a).max(axis=1) for a, b in pairwise(final)]
    np.testing.assert_allclose(np.log2(change[0] / change[1]), order, atol=0.15)


@pytest.mark.parametrize(
    "loads", [{"piston_pressure": 0.25}, {"piston_pressure": 0.0, "bath_concentration": 1e-4}], ids=["load", "bath"]
)
def test_strain_is_as_good_as_its_tolerance_after_a_jump(loads: dict[str, float]) -> None:
    """At times from 0.3 s on, against a run with a hundredth of the tolerance."""
    times = np.array([0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0])
    case = single_phase(compression(geometry__cells=20), 300.0, **loads).with_changes(
        {"time.scheme": "sdirk2", "output.times": times.tolist()}
    )
    coarse, fine = (strain_at(fvswell.run(case.with_changes({"time.tolerance": t})), times) for t in (1e-4, 1e-6))
    assert np.abs(coarse - fine).max() < 5e-4 * np.abs(fine).max()


@pytest.mark.parametrize(
    ("loads", "changes"),
    [
        ({"piston_displacement": 0.0, "bath_concentration": 1e-4}, {}),
        (
            {"piston_pressure": 0.0, "bath_concentration": 1e-4},
            {"tissue.fixed_charge_density": 0.0, "tissue.osmotic_coefficient": 0.93},
        ),
    ],
    ids=["held", "uncharged"],
)
def test_no_needless_steps_where_the_sample_ends_as_tall_as_it_began(
    loads: dict[str, float], changes: dict[str, float]
) -> None:
    """Salt moves water inside a held sample, and in and out of an uncharged one: tolerances need another measure."""
    case = single_phase(compression(geometry__cells=10), 300.0, **loads)
    result = fvswell.run(case.with_changes({"time.scheme": "sdirk2", "time.tolerance": 1e-3} | changes))
    assert np.abs(result["volume_ratio"] - result["volume_ratio"][0]).max() > 0.01
    assert result.sizes["step"] < 500
