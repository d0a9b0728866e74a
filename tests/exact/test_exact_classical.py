"""Classical small-strain solutions, each against an integration of its balances by finite differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from fvswell.exact.confined_compression import creep_fluid_pressure, creep_strain, relaxation_pressure
from fvswell.exact.mandel import MandelBlock
from fvswell.exact.unconfined_compression import (
    DiscHistory,
    DiscStiffness,
    TransverselyIsotropicDisc,
    UnconfinedDisc,
)
from fvswell.physics.tissue import Array

# ---- confined compression ------------------------------------------------------------------------------

H, K, HEIGHT = 0.6, 2e-3, 0.8
LAYER = {"aggregate_modulus": H, "permeability": K, "height": HEIGHT}
LAYER_TIME = HEIGHT**2 / (H * K)  # diffusion time, s


class Layer(NamedTuple):
    """Displacement relative to the piston at nodes (times, nodes) that crowd at the filter."""

    x: Array
    displacement: Array


def integrate_layer(filter_rate: Callable[[float, float, float], float], time: Array, cells: int) -> Layer:
    """Integrate du/dt = H k d2u/dx2 (mass and momentum) with u = 0 at the piston.

    ``filter_rate`` gives du/dt at the filter from the time, the strain next to it and the spacing there.
    """
    x = HEIGHT * np.linspace(0, 1, cells + 1) ** 2
    spacing, widths = np.diff(x), 0.5 * (x[2:] - x[:-2])

    def rate(t: float, u: Array) -> Array:
        strain = np.diff(u) / spacing
        inside = H * K * np.diff(strain) / widths
        return np.concatenate([[filter_rate(t, strain[0], spacing[0])], inside, [0.0]])

    band = np.abs(np.subtract.outer(np.arange(cells + 1), np.arange(cells + 1))) <= 1
    options = {"method": "BDF", "rtol": 1e-9, "atol": 1e-14, "jac_sparsity": band}
    pieces, start = [np.zeros((0, cells + 1))], np.zeros(cells + 1)
    for begin, end in zip(np.append(0.0, time), time, strict=False):  # no step across a kink
        start = solve_ivp(rate, (begin, end), start, **options).y[:, -1]
        pieces.append(start[None])
    return Layer(x, np.concatenate(pieces))


def test_creep_against_finite_differences() -> None:
    time, strain_at_filter = np.array([1e-3, 0.1, 1.0]) * LAYER_TIME, -0.01 / H  # the solid carries the load

    def filter_rate(_: float, strain: float, spacing: float) -> float:
        return H * K * (strain - strain_at_filter) / (0.5 * spacing)

    coarse, fine = (integrate_layer(filter_rate, time, n).displacement[:, 0] for n in (60, 120))
    shortening = (fine + (fine - coarse) / 3) / HEIGHT
    exact = creep_strain(**LAYER, piston_pressure=0.01, time=time)
    np.testing.assert_allclose(exact, -shortening, rtol=2e-5)


def test_pressure_in_creep() -> None:
    """Strain is (p - P)/H throughout, the filter drains what the layer loses, nothing flows at the piston."""
    time = np.array([[0.03], [0.3], [1.0]]) * LAYER_TIME
    x = (np.arange(4000) + 0.5) / 4000 * HEIGHT
    p = creep_fluid_pressure(**LAYER, piston_pressure=0.01, position=x, time=time)

    def strain(at: Array) -> Array:
        return creep_strain(**LAYER, piston_pressure=0.01, time=at)

    np.testing.assert_allclose(((p - 0.01) / H).mean(axis=1), strain(time[:, 0]), rtol=1e-6)
    step = 1e-4 * LAYER_TIME
    loss = -(strain(time[:, 0] + step) - strain(time[:, 0] - step)) / (2 * step) * HEIGHT
    np.testing.assert_allclose(K * p[:, 0] / x[0], loss, rtol=1e-4)
    np.testing.assert_allclose(p[:, -1], p[:, -2], rtol=1e-6)


@pytest.mark.parametrize("scaled_ramp", [0.02, 2.0])
def test_relaxation_against_finite_differences(scaled_ramp: float) -> None:
    """The piston's pressure is the solid's stress at the filter, during the ramp and after it."""
    ramp, displacement = scaled_ramp * LAYER_TIME, 0.02
    time = np.array([0.1, 0.5, 1.0, 1.2, 3.0]) * ramp
    speed = np.where(time <= ramp, displacement / ramp, 0.0)

    def filter_rate(t: float, strain: float, spacing: float) -> float:
        return displacement / ramp if t <= ramp else 0.0

    def pressure(cells: int) -> Array:
        layer = integrate_layer(filter_rate, time, cells)
        spacing = layer.x[1]
        slope = (layer.displacement[:, 1] - layer.displacement[:, 0]) / spacing
        return -H * (slope - 0.5 * spacing * speed / (H * K))  # at the filter d2u/dx2 is known

    coarse, fine = pressure(60), pressure(120)
    exact = relaxation_pressure(**LAYER, displacement=displacement, ramp_duration=ramp, time=time)
    np.testing.assert_allclose(exact, fine + (fine - coarse) / 3, rtol=3e-5)


def test_relaxation_limits() -> None:
    """In the end H d/h; at first the boundary layer of a half space, 2 (V/k) sqrt(H k t/pi)."""
    final = relaxation_pressure(**LAYER, displacement=0.02, ramp_duration=5.0, time=np.array([0.0, 20 * LAYER_TIME]))
    np.testing.assert_allclose(final, [0.0, H * 0.02 / HEIGHT], rtol=1e-10)
    early = relaxation_pressure(**LAYER, displacement=0.02, ramp_duration=5.0, time=np.array([1e-6, 1.0]))
    half_space = 2 * 0.02 / 5.0 / K * np.sqrt(H * K * np.array([1e-6, 1.0]) / np.pi)
    np.testing.assert_allclose(early, half_space, rtol=1e-12)


# ---- Mandel ---------------------------------------------------------------------------------------------


def test_mandel_numbers_known_before() -> None:
    block = MandelBlock(half_width=1.0, youngs_modulus=1.0, poisson_ratio=0.2, permeability=1.0, force=1.0)
    assert block.roots(1).item() == pytest.approx(1.287342, abs=1e-6)
    pressure = block.fluid_pressure(np.array([0.0]), np.array([0.01, 0.05, 0.1, 0.5, 1.0]) / block.diffusivity)
    np.testing.assert_allclose(pressure[:, 0], [0.52188, 0.54944, 0.54771, 0.29639, 0.12942], atol=6e-6)


def test_mandel_pressure_rises_before_it_falls() -> None:
    block = MandelBlock(half_width=5.0, youngs_modulus=0.5, poisson_ratio=0.3, permeability=1e-3, force=0.5)
    time = np.array([1e-6, 0.05, 2.0]) * block.half_width**2 / block.diffusivity
    first, later, last = block.fluid_pressure(np.array([0.0]), time)[:, 0]
    undrained = 0.5 * block.force / block.half_width
    assert last < undrained < first < later


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.2, 0.45])
def test_mandel_against_finite_differences(poisson_ratio: float) -> None:
    block = MandelBlock(2.0, 0.7, poisson_ratio, 3e-3, 0.05)
    G, c, a = block.shear_modulus, block.diffusivity, block.half_width
    M = c / block.permeability
    lame = M - 2 * G
    time = np.array([0.02, 0.2, 1.0]) * a**2 / c

    def integrate(cells: int) -> tuple[Array, Array, Array]:
        """Pressure in the middle, axial strain and displacement of the side, from the balances."""
        width = a / cells
        laplace = np.eye(cells, k=1) - 2 * np.eye(cells) + np.eye(cells, k=-1)
        laplace[0, 0] += 1  # symmetry
        laplace[-1, -1] -= 1  # p = 0 half a cell away
        mean = np.full((1, cells), 1 / cells)
        # plates: (lame strain_xx + M strain_yy - p) averaged = -F/a; sides: M strain_xx + lame strain_yy = p
        axial_of_mean = (1 - lame / M) / (M - lame**2 / M)
        axial_of_force = -block.force / a / (M - lame**2 / M)
        # storage: d(strain_xx + strain_yy)/dt = k p''
        storage = np.eye(cells) / M + (1 - lame / M) * axial_of_mean * np.repeat(mean, cells, axis=0)
        rate = np.linalg.solve(storage, block.permeability / width**2 * laplace)
        undrained = np.linalg.solve(storage, np.full(cells, -(1 - lame / M) * axial_of_force))
        p = np.stack([expm(rate * t) @ undrained for t in time])
        axial = axial_of_mean * p.mean(axis=1) + axial_of_force
        side = a * (p.mean(axis=1) - lame * axial) / M
        return 1.125 * p[:, 0] - 0.125 * p[:, 1], axial, side  # quadratic through the middle

    exact = (
        block.fluid_pressure(np.array([0.0]), time)[:, 0],
        block.axial_strain(time),
        block.edge_displacement(time),
    )
    for known, coarse, fine in zip(exact, integrate(50), integrate(100), strict=True):
        np.testing.assert_allclose(known, fine + (fine - coarse) / 3, rtol=5e-5, atol=1e-9)


def test_mandel_limits() -> None:
    """Undrained it keeps its volume; in the end it is elastic in plane strain."""
    nu, E = 0.3, 0.5
    block = MandelBlock(5.0, E, nu, 1e-3, 0.5)
    G, stress = block.shear_modulus, 0.1
    time = np.array([1e-7, 30.0]) * block.half_width**2 / block.diffusivity
    np.testing.assert_allclose(block.edge_displacement(time) / 5.0, stress / (2 * G) * np.array([0.5, nu]), rtol=1e-3)
    np.testing.assert_allclose(block.axial_strain(time), -stress * np.array([0.25 / G, (1 - nu**2) / E]), rtol=1e-3)


def test_mandel_refuses_the_first_instant() -> None:
    block = MandelBlock(5.0, 0.5, 0.3, 1e-3, 0.5)
    with pytest.raises(ValueError, match="at least 1e-07 of the diffusion time, not 0"):
        block.axial_strain(np.array([0.0, 1.0]))


# ---- unconfined compression -------------------------------------------------------------------------------


class RadialBalances:
    """Displacement at faces, pressure in cells: balances of the disc in finite differences."""

    def __init__(self, disc: TransverselyIsotropicDisc, cells: int) -> None:
        a, C = disc.radius, disc.stiffness
        faces = np.linspace(0, a, cells + 1)
        centre, width = 0.5 * (faces[1:] + faces[:-1]), a / cells
        self.disc, self.areas = disc, np.diff(faces**2) / a**2  # share of the plate
        n = cells  # unknown displacements of the faces 1..n (0 on the axis), then the axial strain
        stretch = (np.eye(n) - np.eye(n, k=-1)) / width  # du/dr in cells
        hoop = 0.5 * (np.eye(n) + np.eye(n, k=-1)) / centre[:, None]  # u/r in cells
        column = np.ones((n, 1))
        self.radial = np.hstack([stretch, 0 * column])
        self.dilatation = np.hstack(
            [(np.diag(faces[1:]) - np.diag(faces[1:-1], k=-1)) / (centre * width)[:, None], column]
        )
        axial = np.hstack([np.zeros((n, n)), column])
        hoop = np.hstack([hoop, 0 * column])
        sigma_r = C.radial * self.radial + C.hoop * hoop + C.coupling * axial
        sigma_h = C.hoop * self.radial + C.radial * hoop + C.coupling * axial
        self.sigma_z = C.coupling * (self.radial + hoop) + C.axial * axial
        difference = np.eye(n, k=1)[:-1] - np.eye(n)[:-1]
        between = 0.5 * (np.eye(n, k=1)[:-1] + np.eye(n)[:-1])
        # radial equilibrium at inner faces: d sigma_r/dr - dp/dr + (sigma_r - sigma_h)/r = 0
        inner = difference @ sigma_r / width + (between @ (sigma_r - sigma_h)) / faces[1:-1, None]
        # at the rim, the same over the outer half of the last cell, without traction outside
        rim = -sigma_r[-1] / (0.5 * width) + (sigma_r - sigma_h)[-1] / centre[-1]
        self.solid = np.vstack([inner, rim])  # times (u, e) equals self.push @ p
        self.push = np.vstack([difference / width, np.append(np.zeros(n - 1), -2 / width)])
        self.leak = np.zeros((n, n))  # k (1/r) d/dr(r dp/dr)
        for face in range(1, n):
            conductance = faces[face] / width
            self.leak[face - 1, [face - 1, face]] += np.array([-1, 1]) * conductance / (centre[face - 1] * width)
            self.leak[face, [face - 1, face]] += np.array([1, -1]) * conductance / (centre[face] * width)
        self.leak[-1, -1] -= a / (0.5 * width) / (centre[-1] * width)
        self.leak *= disc.permeability

    def solve(self, load_row: Array, load_push: Array, load: float, instants: Array, rate: float = 0.0) -> DiscHistory:
        """Histories; the axial condition is load_row (u, e) = load_push p + load + rate t."""
        n = len(self.push)
        matrix = np.vstack([self.solid, load_row])
        of_pressure = np.linalg.solve(matrix, np.vstack([self.push, load_push]))
        of_load = np.linalg.solve(matrix, np.append(np.zeros(n), 1.0))
        storage = self.dilatation @ of_pressure
        growth = np.linalg.solve(storage, self.leak)
        start = np.linalg.solve(storage, -self.dilatation @ of_load * load)
        drive = np.linalg.solve(storage, -self.dilatation @ of_load * rate)
        augmented = np.zeros((n + 1, n + 1))
        augmented[:n, :n], augmented[:n, n] = growth, drive
        p = np.stack([(expm(augmented * t) @ np.append(start, 1.0))[:n] for t in instants])
        unknown = p @ of_pressure.T + np.outer(load + rate * instants, of_load)
        stress = (unknown @ self.sigma_z.T - p) @ self.areas
        axis = 1.125 * p[:, 0] - 0.125 * p[:, 1]
        return DiscHistory(unknown[:, -1], stress, unknown[:, -2], axis[:, None])


def extrapolated(solve: Callable[[RadialBalances], DiscHistory], disc: TransverselyIsotropicDisc) -> DiscHistory:
    coarse, fine = (solve(RadialBalances(disc, n)) for n in (60, 120))
    return DiscHistory(*(f + (f - c) / 3 for c, f in zip(coarse, fine, strict=True)))


DISCS = [UnconfinedDisc(2.5, 0.5, nu, 2e-3) for nu in (0.0, 0.2, 0.42)]
AXIS = np.array([0.0])


FIBROUS = [  # planar fibres in a soft solid, and one that is stiffer along its axis
    TransverselyIsotropicDisc(2.5, DiscStiffness(2.5, 1.2, 0.7, 1.0), 2e-3),
    TransverselyIsotropicDisc(1.0, DiscStiffness(1.0, 0.3, 0.4, 3.0), 1e-3),
]
GENERAL = [*(disc.as_transversely_isotropic for disc in DISCS), *FIBROUS]


def disc_time(disc: UnconfinedDisc | TransverselyIsotropicDisc, scaled: Array) -> Array:
    general = disc.as_transversely_isotropic if isinstance(disc, UnconfinedDisc) else disc
    return scaled * disc.radius**2 / (general.stiffness.radial * disc.permeability)


@pytest.mark.parametrize("disc", GENERAL)
def test_unconfined_creep_against_finite_differences(disc: TransverselyIsotropicDisc) -> None:
    time = disc_time(disc, np.array([0.01, 0.1, 0.5]))

    def solve(balances: RadialBalances) -> DiscHistory:
        return balances.solve(balances.areas @ balances.sigma_z, balances.areas, -0.01, time)

    numerical, exact = extrapolated(solve, disc), disc.creep(AXIS, time, 0.01)
    for known, integrated in zip(exact, numerical, strict=True):
        np.testing.assert_allclose(known, integrated, rtol=2e-4, atol=1e-8)


@pytest.mark.parametrize("disc", GENERAL)
def test_unconfined_ramp_against_finite_differences(disc: TransverselyIsotropicDisc) -> None:
    time = disc_time(disc, np.array([0.01, 0.1, 0.5]))
    ramp = time[1]

    def solve(balances: RadialBalances) -> DiscHistory:
        only_strain, no_push = np.append(np.zeros(len(balances.push)), 1.0), np.zeros(len(balances.push))
        rising = balances.solve(only_strain, no_push, 0.0, time, -0.01 / ramp)
        since_end = np.maximum(time - ramp, 0.0)
        falling = balances.solve(only_strain, no_push, 0.0, since_end, 0.01 / ramp)
        return DiscHistory(*(up + down for up, down in zip(rising, falling, strict=True)))

    numerical, exact = extrapolated(solve, disc), disc.relaxation(AXIS, time, -0.01, ramp)
    for known, integrated in zip(exact, numerical, strict=True):
        np.testing.assert_allclose(known, integrated, rtol=2e-4, atol=1e-8)


@pytest.mark.parametrize("disc", DISCS)
def test_unconfined_limits(disc: UnconfinedDisc) -> None:
    """At first an incompressible disc with a third of the stress in the water; in the end an elastic one."""
    E, nu, a = disc.youngs_modulus, disc.poisson_ratio, disc.radius
    time = disc_time(disc, np.array([1e-7, 50.0]))
    creep = disc.creep(np.array([0.0, 0.5 * a, a]), time, 0.01)
    np.testing.assert_allclose(creep.axial_strain, -0.01 * np.array([1 / (3 * disc.shear_modulus), 1 / E]), rtol=2e-3)
    np.testing.assert_allclose(
        creep.rim_displacement, -creep.axial_strain * np.array([0.5, nu]) * a, rtol=2e-3, atol=1e-9
    )
    np.testing.assert_allclose(creep.fluid_pressure[0], [0.01 / 3, 0.01 / 3, 0.0], rtol=2e-3, atol=1e-15)
    np.testing.assert_allclose(creep.fluid_pressure[1], 0.0, atol=1e-15)
    end = disc.relaxation(AXIS, np.array([0.0, time[1]]), -0.01, 1.0)
    np.testing.assert_allclose(end.axial_stress, [0.0, -0.01 * E], rtol=1e-9)
    np.testing.assert_allclose(end.rim_displacement, [0.0, 0.01 * nu * a], rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("disc", FIBROUS)
def test_fibrous_disc_before_and_after_the_water_has_left(disc: TransverselyIsotropicDisc) -> None:
    """Undrained it keeps its volume, but for what grows with the root of time; drained, the rim is free of traction."""
    C, time = disc.stiffness, disc_time(disc, np.array([2e-7, 8e-7, 50.0]))
    creep = disc.creep(AXIS, time, 0.01)
    strain, rim = (np.array([2.0 * v[0] - v[1], v[2]]) for v in (creep.axial_strain, creep.rim_displacement))
    moduli = np.array([disc.undrained_modulus, disc.drained_modulus])
    np.testing.assert_allclose(strain, -0.01 / moduli, rtol=2e-5)
    widening = np.array([0.5, C.coupling / (C.radial + C.hoop)])
    np.testing.assert_allclose(rim, -strain * widening * disc.radius, rtol=2e-5)
    e = np.array([1.0, -C.coupling / (C.radial + C.hoop)])  # axial and transverse, in equilibrium
    assert disc.drained_modulus == pytest.approx(C.axial + 2.0 * C.coupling * e[1], rel=1e-12)


def test_isotropic_disc_never_relaxes_by_more_than_a_third() -> None:
    """3 G over E is at most 1.5, at nu = 0; fibres across the axis raise it to what cartilage has."""
    ratios = [
        disc.as_transversely_isotropic.undrained_modulus / disc.as_transversely_isotropic.drained_modulus
        for disc in (UnconfinedDisc(1.0, 0.5, nu, 1e-3) for nu in (0.0, 0.1, 0.3, 0.45))
    ]
    assert max(ratios) == ratios[0] == pytest.approx(1.5)
    fibrous = TransverselyIsotropicDisc(1.0, DiscStiffness(0.5 + 3 / 8 * 12, 12 / 8, 0.0, 0.5), 1e-3)
    assert 6.5 < fibrous.undrained_modulus / fibrous.drained_modulus < 8.5


def test_short_ramp_is_a_step_at_late_times() -> None:
    """Relaxation goes from 3 G toward E; the ramp is then seen as one that began half its duration later."""
    disc = DISCS[1]
    time = disc_time(disc, np.array([0.2]))
    ramps = disc_time(disc, np.array([1e-3, 1e-4]))
    short, shorter = (disc.relaxation(AXIS, time + 0.5 * ramp, -0.01, ramp).axial_stress.item() for ramp in ramps)
    assert short == pytest.approx(shorter, rel=1e-6)
    assert -0.01 * 3 * disc.shear_modulus < shorter < -0.01 * disc.youngs_modulus
