"""Phase lag and energy loss per cycle of sinusoidal loads."""

from __future__ import annotations

import numpy as np
import pytest
from columns import compression

import fvswell
from fvswell.analysis.cycles import cycles
from fvswell.case.case import Case

PERIOD = 50.0
H = 0.5 / 1.2 + 4 / 3 * 0.5 / 2.6  # aggregate modulus of the reference tissue, MPa


def cyclic(amplitude: float, mean: float = 0.0, kind: str = "pressure", **changes: object) -> Case:
    sine = {"mean": mean, "amplitude": amplitude, "period": PERIOD}
    phase = {"name": "cycles", "duration": 20 * PERIOD, "piston": {kind: sine}}
    return compression(geometry__cells=40, geometry__grading=20).with_changes(
        {"phase": [phase], "time": {"scheme": "esdirk43", "tolerance": 1e-6}, "output": {"per_phase": 2000}, **changes}
    )


def test_small_cycles_of_a_biphasic_column_have_the_exact_lag_and_modulus() -> None:
    """Diffusion of pressure into a slab: strain/pressure = tanh(q)/(q H) with q^2 = i omega h^2/(H k)."""
    case = cyclic(1e-5)
    (found,) = cycles(case, fvswell.run(case, "biphasic"))
    q = np.sqrt(2j * np.pi / PERIOD * 0.5**2 / (H * 1e-3))
    compliance = np.tanh(q) / (q * H)
    assert found.dynamic_modulus == pytest.approx(1.0 / abs(compliance), rel=2e-3)
    assert found.lag == pytest.approx(-np.degrees(np.angle(compliance)), rel=2e-3)
    # a cycle dissipates pi times the part of the compliance that is out of phase, times the square of the pressure
    assert found.loss == pytest.approx(-np.pi * compliance.imag * 1e-10, rel=5e-3)


@pytest.mark.parametrize("model", ["biphasic-swelling", "electrochemical"])
def test_cycles_lose_energy_and_lag_whatever_drives_them(model: str) -> None:
    pressed = cyclic(0.02, 0.1)
    (first,) = cycles(pressed, fvswell.run(pressed, model))
    assert 0.0 < first.lag < 90.0
    # of a nonlinear response the first harmonic gives the loss exactly where the load is a pure sine
    expected = np.pi * first.pressure * first.strain * np.sin(np.radians(first.lag))
    assert first.loss == pytest.approx(expected, rel=2e-3)
    moved = cyclic(-first.strain * 0.6, 0.0, "displacement")
    (second,) = cycles(moved, fvswell.run(moved, model))
    assert second.part == "piston"
    assert second.loss > 0.0


def test_phases_without_whole_cycles_or_enough_outputs_are_left_out() -> None:
    short = cyclic(0.01, 0.01, **{"phase.cycles.duration": 0.8 * PERIOD})
    assert cycles(short, fvswell.run(short, "biphasic")) == []
    few = cyclic(0.01, 0.01, **{"output.per_phase": None, "output.times": [10.0, 20.0, 20 * PERIOD]})
    assert cycles(few, fvswell.run(few, "biphasic")) == []
    assert cycles(compression(), fvswell.run(compression(geometry__cells=5), "biphasic")) == []
