"""Quantities and their units."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_cases import CASES

from fvswell.common_units import COMMON_UNITS, common_unit
from fvswell.units import DIMENSIONS, PLAIN_NUMBER, QuantityError, parse, uncommon_unit

COMMON_NAMES = sorted(COMMON_UNITS)

WRITTEN = [
    ("0.5 mm", "length", 0.5),
    ("500 um", "length", 0.5),
    ("0.5e-3 m", "length", 0.5),
    ("0.5mm", "length", 0.5),
    ("-0.05 mm", "length", -0.05),
    ("0.5 MPa", "pressure", 0.5),
    ("500 kPa", "pressure", 0.5),
    ("0.5 N/mm^2", "pressure", 0.5),
    ("1e-3 mm^4/(N s)", "hydraulic permeability", 1e-3),
    ("1e-3 mm^4/N/s", "hydraulic permeability", 1e-3),
    ("1e-3 mm4/Ns", "hydraulic permeability", 1e-3),
    ("1e-3 mm⁴/(N·s)", "hydraulic permeability", 1e-3),
    ("1e-15 m^4/(N s)", "hydraulic permeability", 1e-3),
    ("0.2 mEq/ml", "concentration", 2e-4),
    ("0.2 meq/ml", "concentration", 2e-4),
    ("0.2 eq/l", "concentration", 2e-4),
    ("0.15 M", "concentration", 1.5e-4),
    ("150 mM", "concentration", 1.5e-4),
    ("150 mol/m^3", "concentration", 1.5e-4),
    ("5e-4 mm^2/s", "diffusivity", 5e-4),
    ("5e-10 m^2/s", "diffusivity", 5e-4),
    ("500 mm^3/meq", "volume per charge", 500.0),
    ("298 K", "temperature", 298.0),
    ("25 degC", "temperature", 298.15),
    ("-10 °C", "temperature", 263.15),
    ("77 degF", "temperature", 298.15),
    ("10 min", "time", 600.0),
    ("2 h", "time", 7200.0),
    ("30 mV", "electric potential", 30.0),
    ("30 N mm/C", "electric potential", 30.0),
    ("0.3", PLAIN_NUMBER, 0.3),
    ("30 %", PLAIN_NUMBER, 0.3),
]

OTHER_UNITS = {
    "length": ["m", "um", "inch"],
    "time": ["ms", "min", "h", "day"],
    "pressure": ["Pa", "kPa", "N/mm^2", "atm", "psi"],
    "hydraulic permeability": ["m^4/(N s)", "mm^4/(N s)", "mm^4/(mN min)"],
    "concentration": ["M", "mM", "mol/m^3", "meq/ml", "eq/l"],
    "diffusivity": ["m^2/s", "um^2/ms", "cm^2/day"],
    "volume per charge": ["ml/meq", "m^3/mol", "l/eq"],
    "temperature": ["mK", "K"],
    "electric potential": ["V", "mV", "J/C"],
    PLAIN_NUMBER: ["", "%", "mm/m"],
}


@pytest.mark.parametrize(("text", "dimension", "number"), WRITTEN)
def test_quantity_as_people_write_it_is_exact(text, dimension, number):
    assert parse(text, dimension) == number


def test_number_is_in_the_internal_unit():
    assert parse(0.25, "pressure") == 0.25
    assert parse(25, "temperature") == 25.0
    assert isinstance(parse(1, "length"), float)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_internal_unit_is_coherent(dimension):
    """One of every internal unit is one in mm, N, s, mmol, K, C, with no factor between."""
    coherent = {"pressure": "N/mm^2", "electric potential": "N mm/C"}
    unit = coherent.get(dimension, DIMENSIONS[dimension].unit)
    assert parse(f"1 {unit}", dimension) == 1.0
    assert parse(f"1 {DIMENSIONS[dimension].unit}", dimension) == 1.0


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_example_is_of_its_dimension(dimension):
    assert parse(DIMENSIONS[dimension].example.strip('"'), dimension) > 0.0


@settings(deadline=None)  # the first call imports pint
@given(
    dimension_and_unit=st.sampled_from([(d, u) for d, units in OTHER_UNITS.items() for u in units]),
    number=st.floats(1e-6, 1e6),
)
def test_conversion_is_linear_and_is_undone_by_the_inverse_factor(dimension_and_unit, number):
    dimension, unit = dimension_and_unit
    one = parse(f"1 {unit}", dimension)
    assert parse(f"{number!r} {unit}", dimension) == pytest.approx(number * one, rel=1e-15)
    assert parse(f"{number / one!r} {unit}", dimension) == pytest.approx(number, rel=1e-15)


@settings(deadline=None)  # the first call imports pint
@given(number=st.floats(allow_nan=False, allow_infinity=False), dimension=st.sampled_from(list(DIMENSIONS)))
def test_text_in_the_internal_unit_is_the_number_itself(number, dimension):
    assert parse(f"{number!r} {DIMENSIONS[dimension].unit}", dimension) == number


@settings(deadline=None)  # the first call imports pint
@given(kelvin=st.floats(200.0, 400.0))
def test_celsius_has_an_offset(kelvin):
    assert parse(f"{kelvin - 273.15!r} degC", "temperature") == pytest.approx(kelvin, rel=1e-15)


@settings(deadline=None)  # the first call imports pint
@given(
    names=st.tuples(st.sampled_from(list(OTHER_UNITS)), st.sampled_from(list(OTHER_UNITS))).filter(
        lambda pair: pair[0] != pair[1]
    )
)
def test_other_dimension_is_refused_and_both_are_reported(names):
    given_name, wanted = names
    with pytest.raises(QuantityError) as caught:
        parse(f"1 {OTHER_UNITS[given_name][0]}", wanted)
    assert (wanted if wanted != PLAIN_NUMBER else "without a unit") in str(caught.value)
    assert DIMENSIONS[wanted].unit in str(caught.value)
    if OTHER_UNITS[given_name][0]:
        assert given_name in str(caught.value)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("0.5", "has no unit"),
        ("mm", "is not a quantity"),
        ("", "is not a quantity"),
        ("0,5 mm", "no unit known"),
        ("0.5 milimetre", 'no unit known as "milimetre"'),
        ("1 mm;", "no unit known"),
        ("1 mm^", "no unit known"),
        ("1 mm/0", "no unit known"),
        ("1 ((", "no unit known"),
        ("1 2 mm", "no unit known"),
        ("1 J", "another dimension"),
        ("1e400 mm", "is not a quantity"),
        ("1e305 km", "finite"),
        (float("nan"), "finite"),
        (float("inf"), "finite"),
        (True, "dimension length"),
        (None, "dimension length"),
        ([1.0], "dimension length"),
    ],
)
def test_what_is_no_length_is_refused(value, words):
    with pytest.raises(QuantityError, match=r".") as caught:
        parse(value, "length")
    assert words in str(caught.value)


@settings(deadline=None)  # the first call imports pint
@given(text=st.text(max_size=20))
def test_any_text_is_a_number_or_a_quantity_error(text):
    try:
        number = parse(f"1 {text}", "length")
    except QuantityError:
        return
    assert np.isfinite(number)


def test_vanishing_number_does_not_fill_the_memory():
    assert parse("1e-999999999 mm", "length") == 0.0


def test_common_units_need_no_pint():
    code = (
        "import sys, fvswell.case.case, fvswell.units as units; units.parse(1.0, 'length');"
        "fvswell.case.case.load_case(sys.argv[1]); assert 'pint' not in sys.modules;"
        "units.parse('1 inch', 'length'); assert 'pint' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code, str(CASES / "confined_compression.toml")], check=True)


@pytest.mark.parametrize("name", COMMON_NAMES)
def test_common_unit_is_the_one_that_pint_knows(name):
    assert common_unit(name) == uncommon_unit(name)


@settings(deadline=None)  # the first call imports pint
@given(
    first=st.sampled_from(COMMON_NAMES),
    others=st.lists(
        st.tuples(st.sampled_from(["*", "/", " ", "/("]), st.sampled_from(COMMON_NAMES), st.integers(-3, 3)), max_size=4
    ),
)
def test_common_units_are_combined_as_pint_does(first, others):
    text = first
    for operator, name, power in others:
        text += f"{operator}{name}^{power}" if operator != "/(" else f"/({name} {first})"
    assert common_unit(text) == uncommon_unit(text)
