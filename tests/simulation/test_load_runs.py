"""Loads over time, from the case to the result: exact solutions of the linear column, files, strains, what goes on."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from linear_columns import CONTROLLED, SMALL, linear, modulus_and_time
from sample_cases import small_block, small_compression

import fvswell
from fvswell import CaseError
from fvswell.case.case import Case
from fvswell.cli.arguments import read_case as read_case_argument
from fvswell.physics.tissue import Array
from fvswell.results.file import read_case
from fvswell.simulation.run import run


def fitted(times: Array, values: Array, period: float) -> complex:
    """Amplitude of a sine that values follow, and its phase."""
    w = 2.0 * np.pi / period
    basis = np.stack([np.sin(w * times), np.cos(w * times), np.ones_like(times)], axis=1)
    sine, cosine, _ = np.linalg.lstsq(basis, values, rcond=None)[0]
    return complex(sine, cosine)


# ---- exact solutions of the linear column -----------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.2, 2.0, 20.0])
@pytest.mark.parametrize("driven", ["pressure", "displacement"])
def test_a_sine_has_the_exact_frequency_response(driven: str, ratio: float) -> None:
    """Strain over pressure is -tanh(s)/(s H) with s^2 = i w h^2/(k H): amplitude and phase, from both sides."""
    H, tau = modulus_and_time(linear(1.0, piston__pressure=SMALL))
    period = 2.0 * np.pi * tau / ratio
    w, waiting = 2.0 * np.pi / period, np.ceil(3.0 * tau / period) * period
    times = waiting + np.linspace(0.0, period, 49)
    load = {"mean": 0.0, "amplitude": SMALL if driven == "pressure" else 1e-5 * 0.5, "period": period}
    case = linear(waiting + period, **{f"piston__{driven}": load}).with_changes({"output": {"times": times.tolist()}})
    result = fvswell.run(case).sel(time=times, method="nearest")
    s = np.sqrt(1j * w * tau)
    compliance = -np.tanh(s) / (s * H)
    if driven == "pressure":
        found = fitted(times, result["global_strain"].values, period) / SMALL
        assert found == pytest.approx(compliance, rel=2e-3)
    else:
        found = fitted(times, result["piston_pressure"].values, period) / 1e-5
        assert found == pytest.approx(1.0 / compliance, rel=2e-3)


def test_a_table_is_the_exact_sum_of_ramps() -> None:
    """Every corner starts one: strain = -sum(change of slope * integral of the uptake)/H."""
    H, tau = modulus_and_time(linear(1.0, piston__pressure=SMALL))
    knots = tau * np.array([0.0, 0.1, 0.15, 0.4, 1.0])
    values = SMALL * np.array([0.0, 1.0, -0.3, 0.8, 0.2])
    times = tau * np.linspace(0.02, 1.5, 60)
    case = linear(1.5 * tau, piston__pressure={"times": knots.tolist(), "values": values.tolist()})
    result = fvswell.run(case.with_changes({"output": {"times": times.tolist()}}))
    n = np.pi * (np.arange(200) + 0.5)

    def ramp(since: Array) -> Array:
        t = np.maximum(since, 0.0)[:, None] / tau
        return tau * (t[:, 0] - np.sum(2.0 / n**4 * -np.expm1(-(n**2) * t), axis=1))

    slopes = np.diff(values) / np.diff(knots)
    changes = np.diff([0.0, *slopes, 0.0])
    exact = -sum(change * ramp(times - knot) for change, knot in zip(changes, knots, strict=True)) / H
    strain = result["global_strain"].sel(time=times, method="nearest").values
    assert np.abs(strain - exact).max() < 1e-3 * np.abs(exact).max()
    pressure = result["piston_pressure"].sel(time=times, method="nearest").values
    np.testing.assert_allclose(pressure, np.interp(times, knots, values), atol=1e-17)


# ---- the same load in other words -------------------------------------------------------------------------


def test_a_table_with_the_points_of_a_ramp_is_the_ramp() -> None:
    times = np.linspace(0.0, 40.0, 81)
    table = {"times": times.tolist(), "values": (0.2 / 40.0 * times).tolist()}
    ramp = {"ramp_to": 0.2, "over": 40.0}
    one, other = (
        fvswell.run(small_compression(**CONTROLLED, phase__loading__piston__pressure=load, output={"per_phase": 20}))
        for load in (ramp, table)
    )
    np.testing.assert_array_equal(one["time"].values[-20:], other["time"].values[-20:])
    strains = (
        result["global_strain"].sel(time=np.arange(15.0, 600.1, 15.0), method="nearest") for result in (one, other)
    )
    np.testing.assert_allclose(*strains, rtol=1e-11)


@pytest.fixture
def protocol_case(tmp_path: Path) -> Path:
    """A case whose piston follows a file."""
    (tmp_path / "protocol.csv").write_text("Time [min];Stress [kPa]\n0;0\n0.5;100\n1;30\n4;30\n")
    content = tomllib.loads(small_compression(**CONTROLLED).to_toml())
    content["phase"][0]["piston"]["pressure"] = {"file": "protocol.csv", "time": "Time", "value": "Stress"}
    path = tmp_path / "measured.toml"
    path.write_text(tomli_w.dumps(content))
    return path


def test_a_load_from_a_file_is_that_of_its_points(protocol_case: Path) -> None:
    case = fvswell.load_case(protocol_case)
    inline = {"times": [0, "0.5 min", "1 min", "4 min"], "values": [0, "100 kPa", "30 kPa", "30 kPa"]}
    other = case.with_changes({"phase.loading.piston.pressure": inline})
    assert case != other  # one says where its points come from
    one, two = fvswell.run(case), fvswell.run(other)
    np.testing.assert_array_equal(one["global_strain"], two["global_strain"])
    assert case.with_changes({"tissue.hindrance_factor": 0.0}).load_files == case.load_files


def test_a_result_is_run_again_without_its_load_file_and_says_if_that_has_changed(
    protocol_case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = fvswell.load_case(protocol_case)
    assert case.changed_load_files() == []
    path = protocol_case.with_name("output") / "result.nc"
    path.parent.mkdir()
    first = run(case, path=path)
    again = read_case(path)
    assert again == case
    assert again.changed_load_files() == []
    file = protocol_case.with_name("protocol.csv")
    file.write_text(file.read_text().replace("100", "120"))
    (remark,) = again.changed_load_files()
    capsys.readouterr()
    assert read_case_argument(path, None) == case
    assert remark in capsys.readouterr().err
    assert "phase[loading].piston.pressure: protocol.csv has changed" in remark
    second = path.with_name("second.nc")
    run(again, path=second)
    assert len(read_case(second).changed_load_files()) == 1  # of a result of a result too
    file.unlink()
    assert read_case(path).changed_load_files() == []
    np.testing.assert_array_equal(fvswell.run(read_case(path))["global_strain"], first["global_strain"])


def test_a_load_file_that_is_wrong_is_an_error_of_the_case(protocol_case: Path) -> None:
    protocol_case.with_name("protocol.csv").write_text("Time [min];Stress [kPa]\n0;0\n6;0,1\n")
    with pytest.raises(CaseError, match=r"phase\[loading\].piston.pressure = {file = .*: protocol.csv: line 3, Stress"):
        fvswell.load_case(protocol_case)
    protocol_case.with_name("protocol.csv").write_text("Time [min];Stress [kPa]\n0;0\n6;1\n")
    with pytest.raises(CaseError, match="the last one, 360 s, is beyond the end of the phase, 300 s"):
        fvswell.load_case(protocol_case)


@pytest.mark.parametrize("load", ["ramp", "table", "sine"])
def test_a_strain_of_a_column_is_that_of_its_equilibrated_height(load: str) -> None:
    loads: dict[str, Any] = {
        "ramp": {"ramp_to": "-5 %", "over": 30.0},
        "table": {"times": [0, 30.0], "values": [0, "-5 %"]},
        "sine": {"mean": 0, "amplitude": "5 %", "period": 400.0},
    }
    case = small_compression(phase__loading__piston__displacement=loads[load], output={"times": [300.0]}, **CONTROLLED)
    assert Case.from_toml(case.to_toml()) == case
    strain = fvswell.run(case)["global_strain"].values[-1]
    assert strain == pytest.approx(-0.05, rel=1e-12)


def test_a_strain_of_a_block_is_that_of_its_equilibrated_height() -> None:
    load = {"ramp_to": "-3 %", "over": 1e3}
    case = small_block(phase__compression__top={"displacement": load}, model="biphasic-swelling")
    result = fvswell.run(case)
    final = result["top_displacement"].values[-1] - result["top_displacement"].values[0]
    assert final / result["height"].values[0] == pytest.approx(-0.03, rel=1e-10)
    assert result["global_strain"].values[-1] == pytest.approx(-0.03, rel=1e-10)


# ---- what goes on -----------------------------------------------------------------------------------------


def test_what_a_phase_does_not_name_goes_on() -> None:
    """The pressure of a sine where the phase left it, then a displacement."""
    phases: list[dict[str, Any]] = [
        {"name": "a", "duration": 25.0, "piston": {"pressure": {"mean": 0.1, "amplitude": 0.05, "period": 20.0}}},
        {"name": "b", "duration": 30.0, "bath_concentration": 1e-4},
        {"name": "c", "duration": 30.0, "piston": {"displacement": {"ramp_to": "-8 %", "over": 20.0}}},
        {"name": "d", "duration": 30.0, "bath_concentration": 2e-4},
        {"name": "e", "duration": 30.0},
    ]
    case = small_compression(phase=phases, **CONTROLLED, output={"per_phase": 5})
    result = fvswell.run(case)
    time = result["time"].values
    held = result["piston_pressure"].values[(time > 25.0) & (time <= 55.0)]
    np.testing.assert_allclose(held, 0.15, rtol=1e-14)
    np.testing.assert_allclose(result["global_strain"].values[time >= 105.0], -0.08, rtol=1e-12)
    np.testing.assert_allclose(result["bath_concentration"].values[time > 85.0], 2e-4)


def test_water_and_ions_are_conserved_under_all_loads() -> None:
    phases: list[dict[str, Any]] = [
        {"name": "a", "duration": 60.0, "piston": {"pressure": {"mean": 0.1, "amplitude": 0.05, "period": 7.0}},
         "bath_concentration": {"times": [0.0, 9.0, 31.0], "values": [1.5e-4, 1e-4, 3e-4]}},
        {"name": "b", "duration": 600.0, "until": "1e-2 /min"},
        {"name": "c", "duration": 60.0, "piston": {"displacement": {"times": [3.0, 9.0, 11.0, 40.0],
                                                                    "values": ["-6 %", "-5 %", "-7 %", "-4 %"]}}},
        {"name": "d", "duration": 600.0, "until": "1e-3 MPa/min", "bath_concentration": 1e-4},
    ]  # fmt: skip
    result = fvswell.run(small_compression(phase=phases, **CONTROLLED))
    for name in ("volume", "anions", "cations"):
        (field,) = (str(each) for each in result.data_vars if name[:-1] in str(each) and "error" in str(each))
        assert result[field].values.max() < 1e-10


def test_each_period_of_a_sine_has_outputs() -> None:
    load = {"mean": 0.1, "amplitude": 0.05, "period": 2.0}
    result = fvswell.run(
        small_compression(phase__loading__piston__pressure=load, **CONTROLLED, output={"per_phase": 5})
    )
    time = result["time"].values
    assert np.diff(time[time <= 300.0]).max() <= 2.0 / 16 + 1e-9
    assert result["piston_pressure"].values.max() == pytest.approx(0.15, rel=1e-9)
