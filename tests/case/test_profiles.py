"""Properties that vary from place to place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_cases import small_block

from fvswell.case.profiles import PlaneProfile

X, Y = (0.0, 1.0, 4.0), (0.0, 2.0)


@given(
    coefficients=st.tuples(*[st.floats(-2.0, 2.0)] * 4),
    x=st.floats(0.0, 4.0),
    y=st.floats(0.0, 2.0),
)
def test_a_table_in_the_plane_reproduces_a_bilinear_function(coefficients, x, y) -> None:
    a, b, c, d = coefficients

    def function(x, y):
        return a + b * x + c * y + d * x * y

    # between x = 1 and x = 4 a bilinear function is linear too
    profile = PlaneProfile(X, Y, tuple(tuple(function(x, y) for x in X) for y in Y))
    found = profile.at({"x": np.array([x]), "y": np.array([y])})
    assert found == pytest.approx([function(x, y)], rel=1e-12, abs=1e-12)


def test_a_table_in_the_plane_is_constant_beyond_its_ends() -> None:
    profile = PlaneProfile(X, Y, ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)))
    outside = {"x": np.array([-1.0, 5.0, 9.0]), "y": np.array([-3.0, -3.0, 7.0])}
    np.testing.assert_array_equal(profile.at(outside), [1.0, 3.0, 6.0])


@pytest.mark.parametrize(
    ("profile", "expected"),
    [
        ({"x": [0.0, 10.0], "value": [0.5, 1.5]}, [0.75, 0.75]),
        ({"y": [0.0, 5.0], "value": [0.5, 1.5]}, [0.7, 1.3]),
        ({"x": [0.0, 10.0], "y": [0.0, 5.0], "value": [[0.5, 1.5], [1.5, 2.5]]}, [0.95, 1.55]),
    ],
)
def test_properties_of_a_block_vary_along_either_axis_or_both(profile, expected) -> None:
    case = small_block(tissue__youngs_modulus=profile)
    tissue = case.tissue_at(np.array([[2.5, 2.5], [1.0, 4.0]]))
    np.testing.assert_allclose(tissue.solid.youngs_modulus, expected)
    assert np.ndim(tissue.fluid_fraction) == 0
