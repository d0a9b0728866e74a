"""Loads of a case file: what each is at a time, how far it goes, how it is read and written back."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fvswell.case.loads import (
    AnyLoad,
    Load,
    Ramp,
    Shape,
    Sine,
    StrainLoad,
    TableLoad,
    extremes,
    final_value,
    jumps,
    settled,
    value_at,
)
from fvswell.case.values import Quantity, RateReader

PRESSURE, LENGTH = Load(Quantity("pressure")), Load(Quantity("length"), strain=True)
BATH = Load(Quantity("concentration", above=0.0))

RAMP, SINE = {"ramp_to": "0.2 MPa", "over": "1 min"}, {"mean": "20 kPa", "amplitude": "5 kPa", "period": "2 s"}
TABLE = {"times": [0, "1 s", 3], "values": ["0 MPa", 0.3, "100 kPa"]}
LOADS: list[tuple[Any, AnyLoad]] = [
    ("0.25 MPa", 0.25),
    (RAMP, Ramp(0.2, 60.0)),
    (TABLE, TableLoad((0.0, 1.0, 3.0), (0.0, 0.3, 0.1))),
    (SINE, Sine(0.02, 0.005, 2.0)),
]


@pytest.mark.parametrize(("given_value", "load"), LOADS)
def test_each_way_of_giving_a_load(given_value: Any, load: AnyLoad) -> None:
    read = PRESSURE._read(given_value)
    assert read == load
    assert PRESSURE._read(PRESSURE._plain(read)) == load


@pytest.mark.parametrize("value", ["-10 %", "0.1%", " 2.5e0  % "])
def test_a_strain_in_place_of_a_displacement(value: str) -> None:
    read = LENGTH._read(value)
    assert read == StrainLoad(float(value.replace("%", "")) / 100.0)
    assert LENGTH._read(LENGTH._plain(read)) == read
    assert read.of(0.5) == pytest.approx(0.5 * read.strain, rel=1e-15)


@pytest.mark.parametrize(
    "value",
    [
        {"ramp_to": "-10 %", "over": 60.0},
        {"times": [0.0, 1.0], "values": [0, "-3.3 %"]},
        {"mean": "-5 %", "amplitude": "1 %", "period": 1.0},
    ],
)
def test_strains_in_place_of_displacements(value: dict[str, Any]) -> None:
    """The load of a sample of an extent is that of the strains times the extent."""
    read = LENGTH._read(value)
    assert isinstance(read, StrainLoad)
    assert LENGTH._read(LENGTH._plain(read)) == read
    load = read.of(0.5)
    for time in (0.0, 0.3, 0.8):
        assert value_at(load, time, 0.0) == pytest.approx(0.5 * value_at(read.strain, time, 0.0), rel=1e-15)


@given(st.floats(-1.0, 1.0))
def test_a_strain_that_is_written_back_is_the_same(strain: float) -> None:
    assert LENGTH._read(LENGTH._plain(StrainLoad(strain))) == StrainLoad(strain)


@pytest.mark.parametrize(
    ("reader", "value", "message"),
    [
        (PRESSURE, {"ramp_to": 0.1}, "over: missing"),
        (PRESSURE, {"raampto": 0.1}, "ramp_to: missing.*did you mean ramp_to"),
        (PRESSURE, {"ramp_to": 0.1, "over": 0}, "over: must be above 0"),
        (PRESSURE, {"anything": 1}, "one of these sets of keys: {ramp_to, over}, {times, values}, {file"),
        (PRESSURE, {"times": [0, 1], "values": [0.1]}, "has 2 times and 1 values: must be as many of each"),
        (PRESSURE, {"times": [0, 1, 1], "values": [0, 1, 2]}, "times: must increase"),
        (PRESSURE, {"times": [0, 1], "values": [0.1, "2 mm"]}, r"values: \[1\] = .*is of dimension length"),
        (PRESSURE, {"times": [-1, 1], "values": [0, 1]}, r"times: \[0\] = -1: must be at least 0"),
        (PRESSURE, {"times": [0, math.nan], "values": [0, 1]}, "finite"),
        (PRESSURE, {"times": [], "values": []}, "not empty"),
        (PRESSURE, {"mean": 1, "amplitude": 2}, "period: missing"),
        (PRESSURE, {"mean": 1, "amplitude": 2, "period": -1}, "period: must be above 0"),
        (PRESSURE, "-10 %", "is of dimension plain number"),
        (BATH, {"mean": 1e-4, "amplitude": 2e-4, "period": 1}, "goes to -0.0001 mmol/mm.3: must be above 0"),
        (LENGTH, {"times": [0, 1], "values": [0.1, "-3.3 %"]}, r"\[0\] = 0.1: must be a strain in % as the other"),
        (LENGTH, {"mean": "1 %", "amplitude": "1 mm", "period": 1}, "amplitude: must be a strain in %"),
    ],
)
def test_bad_loads(reader: Load, value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        reader._read(value)


def test_the_amplitude_of_a_load_that_has_to_be_positive_may_be_negative() -> None:
    assert BATH._read({"mean": 2e-4, "amplitude": -1e-4, "period": 1}) == Sine(2e-4, -1e-4, 1.0)


@pytest.mark.parametrize("load", [0.25, Ramp(0.2, 6.0), TableLoad((0.0, 1.0, 3.0), (0.4, -0.3, 0.1)),
                                  TableLoad((2.0, 3.0), (0.4, 0.1)), Sine(0.2, 0.5, 3.1)])  # fmt: skip
@pytest.mark.parametrize("before", [-0.7, 0.25])
def test_extremes_ends_and_starts_are_those_of_the_values(load: Shape, before: float) -> None:
    duration = 6.0
    values = np.array([value_at(load, time, before) for time in np.linspace(0.0, duration, 60_001)])
    assert extremes(load, duration, before) == pytest.approx((values.min(), values.max()), abs=1e-7)
    assert final_value(load, duration) == pytest.approx(values[-1], abs=1e-15)
    assert jumps(load, before) == (abs(values[0] - before) > 1e-9)
    rest = settled(load)
    if np.isfinite(rest):
        assert np.ptp(values[round(1e4 * rest) :]) < 1e-15


def test_whole_periods_end_at_the_mean() -> None:
    assert final_value(Sine(0.3, 0.1, 0.1), 1000.0) == 0.3
    assert final_value(Sine(0.3, 0.1, 4.0), 1001.0) == pytest.approx(0.4)


# ---- rates ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value", "dimension"),
    [
        ("1e-3 MPa/min", 1e-3 / 60.0, "pressure rate"),
        ("2 kPa/h", 2e-3 / 3600.0, "pressure rate"),
        ("1e-4 /min", 1e-4 / 60.0, "strain rate"),
        ("1e-4 1/min", 1e-4 / 60.0, "strain rate"),
        ("0.01 %/min", 1e-4 / 60.0, "strain rate"),
    ],
)
def test_rates(text: str, value: float, dimension: str) -> None:
    read = RateReader()._read(text)
    assert read.dimension == dimension
    assert read.value == pytest.approx(value, rel=1e-15)
    assert RateReader()._read(RateReader()._plain(read)) == read


@pytest.mark.parametrize("text", ["1e-3 MPa", 1e-3, "-1 /min", "0 MPa/s", "1 N/min", "soon", "1e-3 /", ""])
def test_bad_rates(text: Any) -> None:
    with pytest.raises(ValueError, match='must be a rate above 0, such as "1e-3 MPa/min"'):
        RateReader()._read(text)
