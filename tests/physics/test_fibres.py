"""Families of fibres in tension: the derivative of their energy, and what follows from their directions."""

from __future__ import annotations

import pickle
from itertools import cycle
from typing import Any

import numpy as np
import pytest

from fvswell.compiled import kernel
from fvswell.compiled.dual import slope_of, variables
from fvswell.physics import fibre_directions
from fvswell.physics.fibre_directions import (
    IsotropicDirections,
    PlanarAcrossX,
    PlanarAcrossZ,
    PlanarDirections,
    SecondPiola,
    fibre_stress,
    one_direction,
)
from fvswell.physics.fibre_laws import LogarithmicFibres, PowerFibres, fibre_tension, tension_over_directions
from fvswell.physics.fibres import FibreFamily, ground_and_families, with_fibres
from fvswell.physics.solids import (
    NeoHookean,
    SolidFractionNeoHookean,
    aggregate_modulus,
    cauchy_stress,
    isotropic_stress,
    piola_stress,
    uniaxial_stress,
)
from fvswell.physics.tissue import Array

LAWS = {
    "quadratic": PowerFibres(3.0, 0.0, 2.0),
    "power": PowerFibres(3.0, 0.0, 2.5),
    "exponential": PowerFibres(3.0, 2.0, 2.5),
    "logarithmic": LogarithmicFibres(2.0, 8.0),
}
DIRECTIONS = {
    "isotropic": IsotropicDirections(), "planar": PlanarDirections(), "along": one_direction(35.0),
    "mirrored": one_direction(20.0, 40.0), "across x": PlanarAcrossX(), "across z": PlanarAcrossZ(),
}  # fmt: skip
PLANES = {"planar": (0, 2), "across x": (1, 2), "across z": (0, 1)}  # the axes in each
GROUND = NeoHookean(0.1, 0.2)
NONE = NeoHookean(1e-300, 0.0)  # a ground substance that carries nothing
POINTS = 24


def solid_of(directions: str, law: str, ground: Any = NONE) -> Any:
    return with_fibres(ground, [FibreFamily(DIRECTIONS[directions], LAWS[law])])


def gradients(seed: int = 0, amount: float = 0.3) -> Array:
    """Deformation gradients (5, points): components xx, xy, yx, yy, zz."""
    F = np.random.default_rng(seed).uniform(-amount, amount, (5, POINTS))
    return F + np.array([1.0, 0.0, 0.0, 1.0, 1.0])[:, None]


def energy(law: Any, square: Array) -> Array:
    """psi(I) of fibres in tension, zero in compression."""
    strain = square - 1.0
    if isinstance(law, PowerFibres) and law.exponent:
        value = law.modulus / (law.exponent * law.power) * np.expm1(law.exponent * strain**law.power)
    elif isinstance(law, PowerFibres):
        value = law.modulus / law.power * strain**law.power
    else:
        k, stretch = law.exponent, np.sqrt(square)
        value = law.modulus * ((stretch ** (k + 1.0) - 1.0) / (k + 1.0) - (stretch - 1.0))
    return np.where(strain.real > 0.0, value, 0.0)


def directions_of(name: str) -> tuple[Array, Array]:
    """Many directions (3, directions) of a family, and their shares."""
    if name == "isotropic":
        heights, shares = np.polynomial.legendre.leggauss(300)
        angles = (np.arange(600) + 0.5) * np.pi / 300.0
        height, angle = (grid.ravel() for grid in np.meshgrid(heights, angles, indexing="ij"))
        flat = np.sqrt(1.0 - height**2)
        return np.stack([flat * np.cos(angle), flat * np.sin(angle), height]), np.repeat(shares / 1200.0, 600)
    if name in PLANES:
        angles = (np.arange(4000) + 0.5) * np.pi / 2000.0
        n = np.zeros((3, 4000))
        n[PLANES[name][0]], n[PLANES[name][1]] = np.cos(angles), np.sin(angles)
        return n, np.full(4000, 1.0 / 4000)
    angle, tilt = {"along": (35.0, 0.0), "mirrored": (20.0, 40.0)}[name]
    a, b = np.radians(angle), np.radians(tilt)
    flat = [np.cos(a) * np.cos(b), np.sin(a) * np.cos(b)]
    return np.array([[flat[0]] * 2, [flat[1]] * 2, [np.sin(b), -np.sin(b)]]), np.array([0.5, 0.5])


def total_energy(name: str, law: Any, F: Array) -> Array:
    """Energy of a family at one deformation gradient, by brute force."""
    n, shares = directions_of(name)
    deformed = np.stack([F[0] * n[0] + F[1] * n[1], F[2] * n[0] + F[3] * n[1], F[4] * n[2]])
    with np.errstate(invalid="ignore"):
        value: Array = shares @ energy(law, (deformed * deformed).sum(axis=0))
    return value


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("directions", DIRECTIONS)
def test_stress_is_the_derivative_of_the_energy(directions: str, law: str) -> None:
    """P = dW/dF, the energy averaged over 180,000 directions of the sphere, whose own error is some 1e-5."""
    F = gradients(1)
    P = np.array(piola_stress(solid_of(directions, law), 0.8, tuple(F)))
    for i in range(0, POINTS, 4):
        expected = np.empty(5)
        for component in range(5):
            step = F[:, i].astype(complex)
            step[component] += 1e-30j
            expected[component] = total_energy(directions, LAWS[law], step).imag / 1e-30
        tolerance = 1e-12 if directions in ("along", "mirrored") else 1e-4
        np.testing.assert_allclose(P[:, i], expected, rtol=0, atol=tolerance * max(np.abs(expected).max(), 1e-6))


@pytest.mark.parametrize("law", LAWS)
def test_tension_is_the_derivative_of_the_energy_and_stiffness_that_of_tension(law: str) -> None:
    strain = np.geomspace(1e-4, 0.8, 50)
    tension, stiffness = fibre_tension(LAWS[law], strain)
    step = 1e-30j
    np.testing.assert_allclose(tension, 2.0 * energy(LAWS[law], 1.0 + strain + step).imag / 1e-30, rtol=1e-10)
    shifted = [fibre_tension(LAWS[law], strain * (1.0 + sign * 1e-5))[0] for sign in (1.0, -1.0)]
    np.testing.assert_allclose(stiffness, (shifted[0] - shifted[1]) / (2e-5 * strain), rtol=1e-7)


@pytest.mark.parametrize(
    "law",
    [
        *LAWS.values(),
        PowerFibres(1.0, 50.0, 2.0),
        PowerFibres(1.0, 8.0, 3.3),
        LogarithmicFibres(1.0, 30.0),
        LogarithmicFibres(1.0, 15.0),
    ],
)
def test_tension_over_directions_is_the_integral(law: Any) -> None:
    """To 1e-6 for stretches up to 1.3, and to rounding where there is a series, whatever its exponent."""
    strain = np.geomspace(1e-9, 0.69, 40)
    u, weights = np.polynomial.legendre.leggauss(200)
    u, weights = 0.5 * (u + 1.0), 0.5 * weights
    exact = (weights * u**2 * fibre_tension(law, strain[:, None] * u**2)[0]).sum(axis=1)
    tolerance = 1e-12 if isinstance(law, PowerFibres) else 1e-6
    np.testing.assert_allclose(tension_over_directions(law, strain), exact, rtol=tolerance)
    by_quadrature = tension_over_directions.implementations[object](law, strain)  # that of laws of one's own
    np.testing.assert_allclose(by_quadrature[strain < 0.2], exact[strain < 0.2], rtol=2e-6)


def extreme_strains() -> Array:
    """Principal values of C - I (3, points) of every sign and of very unequal sizes."""
    draw = np.random.default_rng(3)
    strain = draw.uniform(-0.4, 0.6, (3, 900))
    strain[2, :100] = 0.0
    strain[2, 100:300] *= 10.0 ** draw.uniform(-6, 0, 200)
    strain[1, 200:400] = -strain[0, 200:400] * 10.0 ** draw.uniform(-4, 0, 200)
    strain[:, 400:600] *= 10.0 ** draw.uniform(-3, 0, (3, 200))
    return draw.permuted(strain, axis=0)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("directions", ["isotropic", "planar", "across x", "across z"])
def test_quadrature_has_converged(monkeypatch: pytest.MonkeyPatch, directions: str, law: str) -> None:
    """Stress to 1e-6 of the largest component, at any strains; the derivative by 2e-4 at the worst of them."""
    xx, yy, zz = extreme_strains() + 1.0
    C = variables(xx, yy, zz, 0.0 * xx)

    def found() -> tuple[Array, Array]:
        S = fibre_stress(DIRECTIONS[directions], LAWS[law], *C)
        values = np.array([np.broadcast_to(part.value, xx.shape) for part in S[:3]])
        slopes = np.array([np.broadcast_to(slope_of(part, k), xx.shape) for part in S[:3] for k in range(3)])
        return values, slopes

    usual = found()
    for name, points in (("AZIMUTH", 60), ("HEIGHT", 24)):
        places, weights = fibre_directions._clustered(points)
        monkeypatch.setattr(fibre_directions, f"_{name}S", places)
        monkeypatch.setattr(fibre_directions, f"_{name}_WEIGHTS", weights)
    for values, exact, tolerance in zip(usual, found(), (1e-6, 3e-4), strict=True):
        scale = np.abs(exact).max(axis=0)
        assert np.all(np.abs(values - exact).max(axis=0) <= tolerance * (scale + 1e-6))  # strains of 1e-17 are rounding


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("directions", DIRECTIONS)
def test_derivatives(directions: str, law: str) -> None:
    """dP/dF against central differences; it is symmetric, as that of an energy is."""
    F, solid = gradients(2, 0.2), solid_of(directions, law)
    P = piola_stress(solid, 0.8, variables(*F))
    tangent = np.array([[np.broadcast_to(slope_of(part, by), POINTS) for by in range(5)] for part in P])
    scale = np.abs(tangent).max(axis=(0, 1))
    np.testing.assert_allclose(tangent / scale, np.swapaxes(tangent, 0, 1) / scale, atol=1e-12)
    for by in range(5):
        step = np.zeros(5)
        step[by] = 1e-6
        up, down = (np.array(piola_stress(solid, 0.8, tuple(F + sign * step[:, None]))) for sign in (1.0, -1.0))
        np.testing.assert_allclose((up - down) / 2e-6 / scale, tangent[:, by] / scale, atol=2e-4)


def in_plane(components: Any) -> Array:
    """Tensors (points, 2, 2) of the first four components."""
    xx, xy, yx, yy = components[:4]
    return np.moveaxis(np.array([[xx, xy], [yx, yy]]), -1, 0)


def turn(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def components_of(tensor: Array, zz: Array) -> tuple[Array, ...]:
    return tensor[:, 0, 0], tensor[:, 0, 1], tensor[:, 1, 0], tensor[:, 1, 1], zz


@pytest.mark.parametrize("law", ["quadratic", "logarithmic"])
@pytest.mark.parametrize("directions", DIRECTIONS)
def test_stress_turns_with_the_body(directions: str, law: str) -> None:
    """Objectivity: P(Q F) = Q P(F); the Cauchy stress turns as well."""
    F, solid, Q = gradients(3), solid_of(directions, law, GROUND), turn(0.7)
    turned = components_of(Q @ in_plane(F), F[4])
    P, rotated = piola_stress(solid, 0.8, tuple(F)), piola_stress(solid, 0.8, turned)
    np.testing.assert_allclose(in_plane(rotated), Q @ in_plane(P), atol=1e-12)
    np.testing.assert_allclose(rotated[4], P[4], atol=1e-12)
    sigma, other = (cauchy_stress(solid, 0.8, gradient) for gradient in (tuple(F), turned))
    symmetric, symmetric_other = (in_plane((s.xx, s.xy, s.xy, s.yy)) for s in (sigma, other))
    np.testing.assert_allclose(symmetric_other, Q @ symmetric @ Q.T, atol=1e-12)


@pytest.mark.parametrize("directions", DIRECTIONS)
def test_cauchy_and_piola_stress_are_one(directions: str) -> None:
    """P F^T = J sigma."""
    F, solid = gradients(4), solid_of(directions, "exponential", GROUND)
    P, sigma = piola_stress(solid, 0.8, tuple(F)), cauchy_stress(solid, 0.8, tuple(F))
    J = np.linalg.det(in_plane(F)) * F[4]
    expected = J[:, None, None] * in_plane((sigma.xx, sigma.xy, sigma.xy, sigma.yy))
    np.testing.assert_allclose(in_plane(P) @ np.swapaxes(in_plane(F), 1, 2), expected, atol=1e-11)
    np.testing.assert_allclose(P[4] * F[4], J * sigma.zz, atol=1e-11)


def test_a_family_turned_is_the_problem_turned() -> None:
    """P(F; a + t) = P(F Q; a) Q^T with Q the turn by t; isotropic families do not notice."""
    F, angle = gradients(5), 0.4
    Q = turn(angle)
    for directions, turned in (
        (one_direction(25.0, 30.0), one_direction(25.0 + np.degrees(angle), 30.0)),
        (IsotropicDirections(), IsotropicDirections()),
    ):
        own, other = (with_fibres(NONE, [FibreFamily(which, LAWS["power"])]) for which in (directions, turned))
        P = piola_stress(other, 0.8, tuple(F))
        expected = piola_stress(own, 0.8, components_of(in_plane(F) @ Q, F[4]))
        # with a quadrature, principal directions turn with it: nothing is left but rounding
        np.testing.assert_allclose(in_plane(P), in_plane(expected) @ Q.T, atol=1e-12)
        np.testing.assert_allclose(P[4], expected[4], atol=1e-12)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("directions", DIRECTIONS)
def test_compressed_fibres_carry_nothing(directions: str, law: str) -> None:
    F = (np.array([0.9, 1.0]), 0.0, 0.0, np.array([0.8, 1.0]), np.array([0.95, 1.0]))
    for component in piola_stress(solid_of(directions, law), 0.8, F):
        np.testing.assert_allclose(component, 0.0, atol=1e-290)
    np.testing.assert_allclose(uniaxial_stress(solid_of(directions, law), np.array([0.7, 1.0]), 0.8), 0.0, atol=1e-290)


@pytest.mark.parametrize(("law", "modulus"), [("quadratic", 4 * 3.0), ("logarithmic", 2.0 * 8.0)])
def test_small_strain(law: str, modulus: float) -> None:
    """Stiffness E_f along a fibre; E_f times the means of n_i^2 n_j^2 where all of a family are in tension."""
    strain = 1e-7

    def stiffness(directions: str, *stretched: int) -> Array:
        F = np.array([1.0, 0.0, 0.0, 1.0, 1.0])
        F[list(stretched)] += strain
        xx, _, _, yy, zz = piola_stress(
            with_fibres(NONE, [FibreFamily(DIRECTIONS[directions], LAWS[law])]), 0.8, tuple(F)
        )
        return np.array([xx, yy, zz]) / (strain * modulus)

    along = with_fibres(NONE, [FibreFamily(one_direction(90.0), LAWS[law])])
    assert uniaxial_stress(along, 1.0 + strain, 0.8) == pytest.approx(modulus * strain, rel=1e-5)
    # transversely isotropic about y: 3/8 and 1/8
    np.testing.assert_allclose(stiffness("planar", 0, 4), [0.5, 0.0, 0.5], atol=1e-5)
    np.testing.assert_allclose(stiffness("planar", 0), [3 / 8, 0.0, 1 / 8], atol=1e-5)
    np.testing.assert_allclose(stiffness("planar", 3), 0.0, atol=1e-5)
    # isotropic, E_f/15 (d_ij d_kl + d_ik d_jl + d_il d_jk)
    np.testing.assert_allclose(stiffness("isotropic", 0), [3 / 15, 1 / 15, 1 / 15], atol=1e-5)
    np.testing.assert_allclose(stiffness("isotropic", 0, 3, 4), [1 / 3, 1 / 3, 1 / 3], atol=1e-5)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("directions", DIRECTIONS)
def test_column_and_free_swelling_are_cases_of_the_general_stress(directions: str, law: str) -> None:
    """The axis of a column is y; free swelling takes the mean of the normal stresses."""
    solid, J, one = solid_of(directions, law, GROUND), np.linspace(0.7, 1.3, 41), np.ones(41)
    axial = cauchy_stress(solid, 0.8, (one, 0 * one, 0 * one, J, one)).yy
    np.testing.assert_allclose(uniaxial_stress(solid, J, 0.8), axial, atol=2e-6 * np.abs(axial).max())
    stretch = J ** (1 / 3)
    equal = cauchy_stress(solid, 0.8, (stretch, 0 * one, 0 * one, stretch, stretch))
    mean = (equal.xx + equal.yy + equal.zz) / 3
    np.testing.assert_allclose(isotropic_stress(solid, J, 0.8), mean, atol=1e-6 * np.abs(mean).max())
    for stress in (uniaxial_stress, isotropic_stress):
        (dual,) = variables(J)
        found = slope_of(stress(solid, dual, 0.8), 0)
        exact = np.imag(stress(solid, J + 1e-40j, 0.8)) / 1e-40
        np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1e-14)
        away = np.abs(J - 1.0) > 0.01
        step = (stress(solid, J + 1e-6, 0.8) - stress(solid, J - 1e-6, 0.8)) / 2e-6
        np.testing.assert_allclose(found[away], step[away], rtol=1e-5, atol=1e-6)


def test_febios_convention() -> None:
    """FEBio: sigma = 1/J times the integral over the sphere of 2 beta ksi (I - 1)^(beta - 1) exp(...) F n (x) F n."""
    ksi, alpha, beta = 0.2, 1.5, 2.5
    family = FibreFamily(IsotropicDirections(), PowerFibres(4 * np.pi * beta * ksi, alpha, beta))
    F = np.array([1.1, 0.05, -0.1, 0.9, 1.05])
    n, shares = directions_of("isotropic")
    deformed = np.stack([F[0] * n[0] + F[1] * n[1], F[2] * n[0] + F[3] * n[1], F[4] * n[2]])
    strain = np.maximum((deformed**2).sum(axis=0) - 1.0, 0.0)
    tension = 2 * beta * ksi * strain ** (beta - 1) * np.exp(alpha * strain**beta)
    expected = (4 * np.pi * shares * tension * deformed) @ deformed.T / ((F[0] * F[3] - F[1] * F[2]) * F[4])
    sigma = cauchy_stress(with_fibres(NONE, [family]), 0.8, tuple(F))
    found = (sigma.xx, sigma.yy, sigma.zz, sigma.xy)
    np.testing.assert_allclose(found, [expected[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1))], rtol=1e-4)


def test_families_and_ground_substance_add_up() -> None:
    families = [FibreFamily(DIRECTIONS[name], law) for name, law in zip(DIRECTIONS, cycle(LAWS.values()), strict=False)]
    F, J = tuple(gradients(6)), np.linspace(0.8, 1.4, POINTS)
    ground = SolidFractionNeoHookean(0.2)
    solid = with_fibres(ground, families)
    for stress, place in ((piola_stress, (0.8, F)), (uniaxial_stress, (J, 0.8)), (isotropic_stress, (J, 0.8))):
        parts = [np.array(stress(with_fibres(NONE, [family]), *place)) for family in families]
        np.testing.assert_allclose(np.array(stress(solid, *place)), sum(parts) + stress(ground, *place), atol=1e-12)
    assert aggregate_modulus(solid, 0.8) == aggregate_modulus(ground, 0.8)


def test_a_solid_with_fibres_is_a_law_of_numbers() -> None:
    families = (
        FibreFamily(IsotropicDirections(), LAWS["power"]),
        FibreFamily(one_direction(90.0), LAWS["logarithmic"]),
    )
    solid = with_fibres(GROUND, families)
    assert type(solid) is type(with_fibres(NeoHookean(2.0, 0.1), families))
    assert (solid.youngs_modulus, solid.power_1, solid.yy_2, solid.exponent_2) == (0.1, 2.5, 1.0, 8.0)
    assert ground_and_families(solid) == (GROUND, families)
    assert pickle.loads(pickle.dumps(solid)) == solid
    assert with_fibres(GROUND, []) is GROUND
    assert ground_and_families(GROUND) == (GROUND, ())


def test_amount_may_vary_in_space() -> None:
    amount, F = np.linspace(0.0, 3.0, POINTS), tuple(gradients(7))
    varying = with_fibres(GROUND, [FibreFamily(IsotropicDirections(), PowerFibres(amount, 1.0, 2.0))])
    together = np.array(piola_stress(varying, 0.8, F))
    for i in range(0, POINTS, 5):
        single = with_fibres(GROUND, [FibreFamily(IsotropicDirections(), PowerFibres(amount[i], 1.0, 2.0))])
        alone = piola_stress(single, 0.8, tuple(float(component[i]) for component in F))
        np.testing.assert_allclose(together[:, i], alone, rtol=1e-13, atol=1e-15)


def compiled_stress(solid: Any, F: Any, P: Any) -> None:
    for i in range(F.shape[1]):
        values = piola_stress(solid, 0.8, variables(F[0, i], F[1, i], F[2, i], F[3, i], F[4, i]))
        for component in range(5):
            P[component, i] = slope_of(values[component], 0)


def test_compiled() -> None:
    """Several families in a kernel, with the same derivatives as in Python."""
    families = [FibreFamily(DIRECTIONS[name], LAWS["exponential"]) for name in ("isotropic", "planar", "along")]
    solid, F, P = with_fibres(GROUND, families), gradients(8), np.zeros((5, POINTS))
    kernel(compiled_stress)(solid, F, P)
    expected = piola_stress(solid, 0.8, variables(*F))
    for component in range(5):
        np.testing.assert_allclose(P[component], slope_of(expected[component], 0), rtol=1e-12, atol=1e-13)


def test_without_strain_there_is_no_stress_of_any_shape() -> None:
    zero = fibre_stress(IsotropicDirections(), LAWS["power"], 1.0, 1.0, 1.0, 0.0)
    assert zero == SecondPiola(0.0, 0.0, 0.0, 0.0)
