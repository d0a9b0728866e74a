"""Blocks between baths: edges in pieces, hydrostatic pressures, permeation and diffusion against exact solutions."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import (
    CLAMPED,
    CONFINED,
    FREE,
    UNCONFINED,
    Parts,
    acting,
    distorted_vertices,
    one_stage,
    part,
    rough_grid,
    steady_state,
    uniform_block,
)
from scipy.integrate import quad
from scipy.optimize import brentq
from tissues import BATH, reference_tissue

from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.fields import fields_at
from fvswell.block.grid import block_grid, shaped_block_grid
from fvswell.physics.constants import FARADAY
from fvswell.physics.differentiation import COMPLEX_STEP
from fvswell.physics.models import BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL, MODELS, Model
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array

by_model = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
by_kind = pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])
CLOSED = {edge: part(edge, "fixed")[edge] for edge in CLAMPED}


def in_pieces(parts: Parts, *places: tuple[str, float]) -> Parts:
    """Parts of which some are cut in two; both pieces keep the condition."""
    pieces: Parts = {}
    for name, whole in parts.items():
        if name not in dict(places):
            pieces[name] = whole
            continue
        for piece, ends in (("lower", {"end": dict(places)[name]}), ("upper", {"start": dict(places)[name]})):
            pieces |= part(
                whole.edge, whole.mechanical, f"{piece}_{name}", open=whole.open, electrical=whole.electrical,
                electrode=whole.electrode, **ends,
            )  # fmt: skip
    return pieces


@by_kind
@by_model
def test_a_split_edge_is_the_whole_edge(kind: str, model: Model) -> None:
    """Of a plate under pressure, a bath of its own, an insulating bath, a roller, an electrode in the wall."""
    top = part("top", "straight", open=True, electrical="insulating")
    bottom = part("bottom", "roller", electrical="grounded", electrode="anion")
    whole = UNCONFINED | part("right", "free", open=True, electrical="potential") | top | bottom
    cut = in_pieces(whole, ("top", 0.8), ("bottom", 1.2), ("right", 0.75))
    found = []
    for parts in (whole, cut):
        block = uniform_block(rough_grid(kind), parts, model)
        loads = {
            f"{name}__{load}": value
            for name in parts
            for where, load, value in (
                ("top", "pressure", 0.1), ("top", "bath_pressure", 0.03), ("top", "bath_concentration", 1.1e-4),
                ("right", "potential", 2.0), ("right", "bath_concentration", 0.9e-4), ("right", "pressure", -0.02),
            )
            if where in name
        }  # fmt: skip
        _, result = one_stage(block, 30.0, 1.2e-4, **loads)
        assert result.step is not None
        entered = -sum(
            (result.step.flow[:, faces].sum(axis=1) for faces in block.crossed_faces), np.zeros(len(block.balances))
        )
        found.append((block.positions(result.unknowns), block.potentials(result.unknowns), entered))
    assert np.abs(found[0][0] - rough_grid(kind).vertices).max() > 0.01
    for one, other in zip(*found, strict=True):
        scale = np.abs(np.atleast_2d(one)).max(axis=-1, keepdims=True) + 1e-30
        np.testing.assert_array_less(np.abs(np.atleast_2d(one - other)) / scale, 1e-12)


@by_kind
@by_model
def test_a_bath_under_pressure_all_around_does_nothing_to_the_solid(kind: str, model: Model) -> None:
    """It presses on the surface as much as it presses the water inside."""
    block = uniform_block(rough_grid(kind), FREE, model)
    state = equilibrated_body(block)[1]
    loads = {"right__bath_pressure": 0.3, "top__bath_pressure": 0.3}
    _, result = one_stage(block, 50.0, **loads)
    moved = np.abs((result.unknowns - state.unknowns)[: block.degrees_of_freedom.number])
    assert moved.max() < 1e-11
    fields = fields_at(block, result.unknowns, acting(block, **loads))
    before = fields_at(block, state.unknowns, block.unloaded)
    np.testing.assert_allclose(fields["fluid_pressure"] - before["fluid_pressure"], 0.3, rtol=1e-9)


@by_model
def test_steady_permeation_under_a_small_pressure_is_darcys(model: Model) -> None:
    """Exact on any grid of rectangles; in charged tissue with the open-circuit permeability or, shorted, nearly so."""
    grid = block_grid("plane-strain", np.array([0.0, 0.3]), np.array([0.0, 0.1, 0.3, 0.35, 0.5]))
    parts = CLOSED | part("bottom", "fixed", open=True) | part("top", "fixed", open=True)
    block = uniform_block(grid, parts, model, ratio=0.8 if model.open_circuit else None)
    flow = steady_state(block, top__bath_pressure=1e-7)[1][:, 0]
    if model is ELECTROCHEMICAL:
        assert 0.5 < flow[1] / (1e-3 * 1e-7 / 0.5 * 0.3) < 1.0
    else:
        ratio = 0.8 if model.open_circuit else 1.0
        assert flow[1] == pytest.approx(ratio * 1e-3 * 1e-7 / 0.5 * 0.3, rel=1e-8)
    assert flow[0] == pytest.approx(-flow[1], rel=1e-10)


def test_permeation_compacts_the_tissue_as_it_has_to() -> None:
    """A free surface under water of 0.2 MPa, on a porous filter: J and flux of the exact solution, to second order.

    The total stress is -p all through, so the water in it has p + sigma_s(J) and flows by its gradient.
    """
    tissue, p, height = reference_tissue(permeability_exponent=3.0), 0.2, 0.5

    def stress(J: float) -> float:
        return float(uniaxial_stress(tissue.solid, J, tissue.fluid_fraction))

    def conductance(J: float) -> float:
        slope = uniaxial_stress(tissue.solid, J + 1j * COMPLEX_STEP, tissue.fluid_fraction).imag / COMPLEX_STEP
        return float(hydraulic_permeability(tissue, J) * slope / J)

    compacted = brentq(lambda J: stress(J) + p, 0.5, 1.0, xtol=1e-14)
    through = quad(conductance, compacted, 1.0, epsabs=1e-14)[0] / height
    assert compacted < 0.85

    def exact_ratio(place: float) -> float:
        return float(brentq(lambda J: quad(conductance, compacted, J)[0] - through * place, compacted, 1.0))

    errors = []
    for n in (10, 20, 40):
        grid = block_grid("plane-strain", np.array([0.0, 0.3]), np.linspace(0.0, height, n + 1))
        parts = CONFINED | part("bottom", "roller", open=True) | part("top", "free", open=True)
        block = uniform_block(grid, parts, BIPHASIC, tissue)
        result, entered = steady_state(block, top__bath_pressure=p)
        flux = entered[1, 0] / 0.3
        J = block.transport_at(result.unknowns, acting(block, top__bath_pressure=p)).volume_ratio
        exact = np.array([exact_ratio(y) for y in grid.centres[1]])
        errors.append([abs(flux / through - 1.0), np.abs(J - exact).max()])
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.8).all(), (errors, orders)
    assert errors[-1][0] < 1e-4
    assert errors[-1][1] < 1e-3


def uncharged_between_baths(n: int, electrical: str) -> tuple[Array, float]:
    """Steady fluxes of water, anions and charge into an uncharged rigid sheet through its top, and the top's mV."""
    tissue = reference_tissue(
        fixed_charge_density=0.0, hindrance_factor=0.0, osmotic_coefficient=1.0, bath_osmotic_coefficient=1.0
    )
    grid = block_grid("plane-strain", np.array([0.0, 0.3]), np.linspace(0.0, 0.5, n + 1))
    top = part("top", "fixed", open=True, electrical=electrical)
    block = uniform_block(grid, CLOSED | part("bottom", "fixed", open=True) | top, ELECTROCHEMICAL, tissue)
    result, entered = steady_state(block, 1e-11, top__bath_concentration=3.0 * BATH)
    volts = tissue.thermal_energy / FARADAY * block.outer(result.unknowns)
    return entered[1] / 0.3, float(volts.mean()) if len(volts) else 0.0


@pytest.mark.parametrize("electrical", ["floating", "insulating"])
def test_salt_diffuses_between_two_baths_with_the_diffusivity_of_both_ions(electrical: str) -> None:
    D_cation, D_anion, n_f = 5e-4, 8e-4, 0.8
    expected = n_f * 2.0 * D_cation * D_anion / (D_cation + D_anion) * 2.0 * BATH / 0.5
    errors = []
    for n in (10, 20, 40):
        (water, anions, charge), potential = uncharged_between_baths(n, electrical)
        assert abs(charge) < 1e-12 * anions
        errors.append([abs(anions / expected - 1.0), abs(water) * BATH / anions])  # without hindrance no osmosis
        exact = 298.0 * 8.314462618 / FARADAY * (D_anion - D_cation) / (D_anion + D_cation) * np.log(3.0)
        assert potential == pytest.approx(exact, rel=1e-8)  # at each face, whatever the grid
    assert max(errors[-1]) < 1e-3
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 1.9).all(), errors


def test_in_a_short_circuit_each_ion_diffuses_by_itself() -> None:
    """The concentration stays linear, and the current is such that there is no field anywhere."""
    (_, anions, charge), _ = uncharged_between_baths(40, "grounded")
    expected = 0.8 * np.array([5e-4, 8e-4]) * 2.0 * BATH / 0.5
    np.testing.assert_allclose([charge + anions, anions], expected, rtol=1e-3)


def test_reduced_swelling_takes_the_bath_of_the_first_open_part() -> None:
    parts = FREE | part("top", "free", open=True)
    block = uniform_block(rough_grid("plane-strain"), parts, BIPHASIC_SWELLING)
    assert [part.name for part in block.parts if part.open] == ["right", "top"]
    loads = acting(block, right__bath_concentration=0.8e-4)
    transport = block.transport_at(equilibrated_body(block)[1].unknowns, loads)
    np.testing.assert_allclose(transport.log_activity, np.log(0.8e-4), rtol=1e-14)


def test_pieces_with_baths_of_their_own_differ_and_meet_in_the_middle() -> None:
    """Water is sucked from one half of an edge to the other; its vertex in the middle has the mean."""
    parts = in_pieces(CLOSED | part("bottom", "fixed", open=True), ("bottom", 1.0))
    flows = []
    for n in (6, 12, 24):
        block = uniform_block(shaped_block_grid("plane-strain", distorted_vertices(2 * n, n)), parts, BIPHASIC)
        beyond = block.beyond(acting(block, upper_bottom__bath_pressure=0.2), np.zeros(0))
        assert set(np.unique(beyond.across)) == {0.0, 0.2}
        flow = steady_state(block, upper_bottom__bath_pressure=0.2)[1][:, 0]
        assert flow[0] == pytest.approx(-flow[1], rel=1e-10)
        flows.append(flow[1])
    assert flows[0] > 0.0
    # the flux at the jump is k p/(pi r), so that the flow grows by the same amount with every halving of the cells
    np.testing.assert_allclose(np.diff(flows), 1e-3 * 0.2 * np.log(2.0) / np.pi, rtol=0.01)
