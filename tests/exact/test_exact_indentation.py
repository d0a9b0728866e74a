"""Indentation of a layer on bone: the table of Hayes et al., and layers that are thick or thin."""

from __future__ import annotations

import numpy as np
import pytest

from fvswell.exact.indentation import indentation_force, instantaneous_indentation_force, thin_layer_factor

ASPECTS = (0.2, 0.4, 0.6, 0.8, 1.0, 1.5, 2.0)
TABLE = {
    0.0: (1.1780, 1.4004, 1.6567, 1.9350, 2.2261, 2.9806, 3.7513),
    0.3: (1.2066, 1.4726, 1.7848, 2.1260, 2.4835, 3.4090, 4.3532),
    0.4: (1.2323, 1.5422, 1.9178, 2.3402, 2.7938, 4.0100, 5.2985),
    0.5: (1.2806, 1.6837, 2.2129, 2.8602, 3.6187, 6.0030, 9.1495),
}


@pytest.mark.parametrize("poisson_ratio", TABLE)
def test_table(poisson_ratio: float) -> None:
    found = [thin_layer_factor(aspect, poisson_ratio) for aspect in ASPECTS]
    np.testing.assert_allclose(found, TABLE[poisson_ratio], atol=5.01e-5)


def test_narrow_indenter_meets_a_half_space() -> None:
    """Kappa = 1 at first, Boussinesq; the force is 2 a E w/(1 - nu^2)."""
    assert thin_layer_factor(0.0, 0.3) == pytest.approx(1.0, abs=1e-14)
    force = indentation_force(np.array([0.0, 0.02]), 1e-9, 5.0, 0.6, 0.25)
    np.testing.assert_allclose(force, [0.0, 2e-9 * 0.6 * 0.02 / (1 - 0.25**2)], rtol=1e-8)


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.2, 0.4])
def test_wide_indenter_confines_the_layer(poisson_ratio: float) -> None:
    """Each mm of radius more adds what a confined layer bears; the rim's part stays."""
    modulus = (1 - poisson_ratio) / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))  # H/E
    slope = 0.5 * np.pi * (1 - poisson_ratio**2) * modulus
    wide, wider = thin_layer_factor(6.0, poisson_ratio), thin_layer_factor(10.0, poisson_ratio)
    assert (wider - wide) / 4.0 == pytest.approx(slope, rel=2e-3)


def test_wide_indenter_squeezes_an_incompressible_layer_out() -> None:
    """Reynolds: P = 3 pi G w a^4/(8 h^3), of a radius that the rim makes larger by a share of the height."""
    aspects = np.array([5.0, 10.0])
    ratio = np.array([thin_layer_factor(a, 0.5) for a in aspects]) / (3 * np.pi / 64 * aspects**3)
    root = ratio**0.25
    assert 1.0 < root[1] < root[0]
    assert 2 * root[1] - root[0] == pytest.approx(1.0, abs=0.01)


def test_first_instant_is_that_of_an_incompressible_layer() -> None:
    E, nu, a, h = 0.5, 0.1, 0.8, 1.0
    G = E / (2 * (1 + nu))
    force = instantaneous_indentation_force(0.01, a, h, E, nu)
    assert force == pytest.approx(2 * a * 3 * G * 0.01 * 2.8602 / 0.75, rel=2e-5)
    assert force > indentation_force(0.01, a, h, E, nu)


@pytest.mark.parametrize(
    ("arguments", "message"), [((11.0, 0.3), "from 0 to 10, not 11"), ((1.0, 0.6), "from 0 to 0.5, not 0.6")]
)
def test_out_of_range(arguments: tuple[float, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        thin_layer_factor(*arguments)
