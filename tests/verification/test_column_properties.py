"""Random tissues and protocols: a run converges or says why it cannot, conserves, and stays within bounds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from columns import compression
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import fvswell
from fvswell import CaseError, SolverError
from fvswell.case.case import Case
from fvswell.physics.models import MODELS
from fvswell.physics.solids import SOLIDS


def decades(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(np.log10(low), np.log10(high)).map(lambda power: float(10.0**power))


def varying(values: st.SearchStrategy[float]) -> st.SearchStrategy[Any]:
    """A number, or a profile over the depth."""
    profile = st.lists(values, min_size=2, max_size=3).map(lambda v: {"depth": [0.1, 0.25, 0.45][: len(v)], "value": v})
    return st.one_of(values, profile)


@st.composite
def tissues(draw: st.DrawFn) -> dict[str, Any]:
    solid = draw(st.sampled_from(tuple(SOLIDS)))
    tissue = {
        "solid": solid,
        "youngs_modulus": draw(varying(decades(0.1, 1.0))),
        "poisson_ratio": draw(varying(st.floats(0.0, 0.45))),
        "hydraulic_permeability": draw(varying(decades(2e-4, 5e-3))),
        "permeability_exponent": draw(st.floats(0.0, 4.0)),
        "fluid_fraction": draw(varying(st.floats(0.65, 0.9))),
        "fixed_charge_density": draw(varying(st.floats(0.0, 4e-4))),
        "osmotic_coefficient": draw(st.floats(0.7, 1.0)),
        "activity_ratio": draw(st.floats(0.7, 1.3)),
        "cation_diffusivity": draw(varying(decades(1e-4, 2.5e-3))),
        "anion_diffusivity": draw(varying(decades(1.6e-4, 4e-3))),
        "hindrance_factor": draw(st.floats(0.0, 1.0)),
    }
    of_solids = {"shear_modulus": draw(decades(0.05, 0.4)), "stiffening_coefficient": draw(st.floats(0.1, 1.5))}
    own = SOLIDS[solid]._fields
    kept = {key: value for key, value in tissue.items() if key in own or key not in ("youngs_modulus", "poisson_ratio")}
    return kept | {key: value for key, value in of_solids.items() if key in own}


@st.composite
def phases(draw: st.DrawFn) -> list[dict[str, Any]]:
    result = []
    for index in range(draw(st.integers(1, 3))):
        duration = draw(decades(5.0, 3e3))
        over = duration * draw(st.floats(0.2, 1.0))
        phase: dict[str, Any] = {"name": f"phase {index}", "duration": duration}
        if draw(st.booleans()):
            phase["bath_concentration"] = draw(
                st.one_of(decades(5e-5, 3e-4), decades(5e-5, 3e-4).map(lambda c, t=over: {"ramp_to": c, "over": t}))
            )
        if draw(st.integers(0, 3)) == 0:
            phase["piston"] = {"displacement": {"ramp_to": draw(st.floats(-0.1, 0.02)), "over": over}}
        else:
            pressure = draw(st.floats(0.0, 0.5))
            phase["piston"] = {"pressure": draw(st.sampled_from([pressure, {"ramp_to": pressure, "over": over}]))}
        result.append(phase)
    return result


SCHEMES = st.one_of(
    st.integers(2, 12).map(lambda n: {"scheme": "backward-euler", "steps_per_phase": n}),
    decades(3e-3, 3e-2).map(lambda tolerance: {"scheme": "esdirk43", "tolerance": tolerance}),
)


def check(case: Case, model: str) -> None:
    try:
        result = fvswell.run(case, model)
        assert result.attrs["run_status"] == "complete"
        end = sum(phase.duration for phase in case.phase)
        assert result["time"][-1] == pytest.approx(end, rel=1e-12)
        if case.phase[-1].piston.displacement is not None:
            aim = result["height"][0] + case.phase[-1].piston.displacement.ramp_to
            assert result["height"][-1] == pytest.approx(float(aim), rel=1e-10)
    except SolverError as error:
        result = error.result
    status = result.attrs["run_status"]
    if status != "complete":
        assert status.startswith("stopped at t = ")
        assert "balance did not converge" in status or "without water" in status
        assert result["fluid_fraction"].min() < 0.02, f"it gave up with water in every cell: {status}"
    assert np.all(np.isfinite(result["volume_ratio"]))
    assert np.all(result["fluid_fraction"] > 0.0)
    for name in result:
        if name.endswith("_balance_error"):
            assert result[name].max() < 1e-10, name
    if model != "biphasic":
        cation, anion = result["cation_concentration"], result["anion_concentration"]
        assert np.all(anion > 0.0)
        assert np.all(np.abs(cation - anion - result["fixed_charge_density"]) <= 1e-14 * cation)
    total = result["effective_stress"] - result["fluid_pressure"] + result["piston_pressure"]
    assert np.abs(total).max() < 1e-12 * (1.0 + np.abs(result["effective_stress"]).max())


@pytest.mark.parametrize("model", MODELS)
def test_any_column_runs_or_says_why_not(model: str) -> None:
    ran = []

    @settings(
        max_examples=30, deadline=None, derandomize=True, database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )  # fmt: skip
    @given(
        tissue=tissues(), protocol=phases(), scheme=SCHEMES, cells=st.integers(3, 14), grading=decades(1.0, 30.0),
        permeability=st.sampled_from(["initial", "state", "none"]),
    )  # fmt: skip
    def examine(
        tissue: dict[str, Any], protocol: list[dict[str, Any]], scheme: dict[str, Any], cells: int, grading: float,
        permeability: str,
    ) -> None:  # fmt: skip
        try:
            case = compression(
                model=model, tissue=tissue, phase=protocol, time=scheme, geometry__cells=cells,
                geometry__grading=grading, open_circuit_permeability=permeability,
            )  # fmt: skip
        except CaseError as error:  # a load beyond what the tissue can bear: refused before it is run
            refusal = str(error)
        else:
            check(case, model)
            ran.append(case)
            return
        assert "water" in refusal or "height" in refusal

    examine()
    assert len(ran) >= 15
