"""Currents through blocks: floating, insulating and driven parts, electrodes in the wall, reciprocity, conservation."""

from __future__ import annotations

from typing import Any

import integrations
import numpy as np
import pytest
from blocks import (
    CLAMPED,
    CONFINED,
    Parts,
    acting,
    distorted_vertices,
    integrate,
    jacobian_matrix,
    make_control,
    make_protocol,
    one_stage,
    part,
    phase,
    random_unknowns,
    rough_grid,
    steady_state,
    uniform_block,
)
from scipy.integrate import quad
from scipy.optimize import brentq
from tissues import BATH, reference_tissue

from fvswell.block.block import Interval
from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.grid import block_grid, shaped_block_grid
from fvswell.block.histories import part_histories
from fvswell.fipy.block_body import fipy_block_body
from fvswell.numerics.loads import Load
from fvswell.numerics.tableaux import BACKWARD_EULER
from fvswell.physics.constants import FARADAY
from fvswell.physics.models import BIPHASIC, ELECTROCHEMICAL
from fvswell.physics.osmotic import ion_concentrations
from fvswell.physics.permeability import open_circuit_ratio
from fvswell.physics.tissue import convection_factor

by_kind = pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])
CLOSED = {edge: part(edge, "fixed")[edge] for edge in CLAMPED}
# every electrical condition there is; the plate is glued
EVERYTHING = (
    part("left", "roller", electrical="grounded", electrode="anion")
    | part("right", "free", open=True, electrical="insulating")
    | part("bottom", "fixed", electrical="floating", electrode="cation")
    | part("top", "glued-plate", "plate", open=True, electrical="potential", end=0.8)
    | part("top", "free", "rest", open=True, electrical="current", start=0.8)
)
DISC = EVERYTHING | part("left", "roller") | part("bottom", "fixed", electrical="floating", electrode="anion")
LOADS = {
    "plate__force": 0.03, "plate__bath_pressure": 0.02, "plate__potential": 3.0, "rest__current": 1e-7,
    "rest__pressure": 0.05, "right__bath_pressure": 0.04, "right__bath_concentration": 1e-4,
}  # fmt: skip


def conditions(kind: str) -> Parts:
    return EVERYTHING if kind == "plane-strain" else DISC


@by_kind
def test_jacobian_is_the_derivative_of_the_residual(kind: str) -> None:
    block = uniform_block(
        rough_grid(kind), conditions(kind), ELECTROCHEMICAL, reference_tissue(permeability_exponent=2.0)
    )
    unknowns = random_unknowns(block)
    interval = Interval(np.zeros((3, block.grid.cells)), 3.0, acting(block, 1.2e-4, **LOADS))
    assert block.outside.unknowns > 15
    assert block.evaluate(unknowns, interval).sound.all()
    exact = jacobian_matrix(block, unknowns, interval).toarray()
    step, scale = 3e-5 * block.unknown_scale, block.unknown_scale / block.residual_scale[:, None]

    def shifted(j: int, times: float) -> Any:
        at = unknowns.copy()
        at[j] += times * step[j]
        return block.evaluate(at, interval).residual

    for j in range(len(unknowns)):
        slope = 8.0 * (shifted(j, 1) - shifted(j, -1)) - (shifted(j, 2) - shifted(j, -2))
        gap = (exact[:, j] - slope / (12.0 * step[j])) * scale[:, j]
        assert np.abs(gap).max() < 1e-8, j


@by_kind
def test_fluxes_keep_the_conditions_to_rounding(kind: str) -> None:
    """Charge closes in every cell; what may not pass does not, whatever ended the iteration."""
    block = uniform_block(rough_grid(kind), conditions(kind), ELECTROCHEMICAL)
    _, result = one_stage(block, 20.0, **LOADS)
    assert result.step is not None
    flow = result.step.flow
    through = np.abs(flow).max(axis=1)
    assert (through > 0.0).all()
    assert np.abs(block.diamonds.outflow @ flow[2]).max() < 1e-12 * through[2]
    names = [block.parts[i].name for i in block.crossed_parts]
    of = {name: flow[:, faces] for name, faces in zip(names, block.crossed_faces, strict=True)}
    assert np.abs(of["right"][2]).max() < 1e-12 * through[2]  # at each face of the insulating part
    assert of["rest"][2].sum() * FARADAY == pytest.approx(-20.0 * 1e-7, rel=1e-10)
    assert np.abs(of["rest"][2]).max() > 1e-12 * through[2]
    assert abs(of["bottom"][2].sum()) < 1e-12 * through[2]  # no net current, but currents
    assert np.abs(of["bottom"][2]).max() > 1e-6 * through[2]
    walls = [("bottom", 1 if kind == "plane-strain" else 2)] + ([("left", 2)] if kind == "plane-strain" else [])
    for name, stopped in walls:
        assert np.abs(of[name][0]).max() < 1e-12 * through[0]
        ion = of[name][1] if stopped == 1 else of[name][1] + of[name][2]
        assert np.abs(ion).max() < 1e-12 * through[2]


def test_in_equilibrium_an_electrode_is_at_the_potential_of_one_in_the_bath() -> None:
    """Of either ion, as long as there is only one bath, of whatever concentration."""
    for ion in ("cation", "anion"):
        parts = CLOSED | part("right", "fixed", open=True) | part("left", "fixed", electrical="floating", electrode=ion)
        block = uniform_block(rough_grid("plane-strain"), parts, ELECTROCHEMICAL)
        result, _ = steady_state(block, right__bath_concentration=0.5 * BATH)
        potential = block.outer(result.unknowns)[block.outside.part_potential(list(parts).index("left"))]
        assert abs(potential) < 1e-9


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_in_models_without_ions_electrical_conditions_are_without_effect(sign: float) -> None:
    plain = CONFINED | part("top", "straight", open=True)
    electric = CONFINED | part("left", "roller", electrical="floating", electrode="anion")
    electric |= part("top", "straight", open=True, electrical="current")
    grid = rough_grid("plane-strain")
    _, one = one_stage(uniform_block(grid, plain, BIPHASIC), 10.0, top__pressure=0.1 * sign)
    _, other = one_stage(uniform_block(grid, electric, BIPHASIC), 10.0, top__pressure=0.1 * sign, top__current=1.0)
    np.testing.assert_array_equal(one.unknowns, other.unknowns)


# ---- a block one cell wide is a column --------------------------------------------------------------------


def in_column(open_top: bool, pressures: Any, baths: Any, currents: Any, top: dict[str, Any]) -> tuple[Any, Any]:
    """A column and a block one cell wide through two phases; loads of the phases, a pair for each kind.

    The pressures are those of the plate, of the bath above and of the bath below; the baths are above and below. The
    currents are potentials (mV) where these are given.
    """
    tissue, area = reference_tissue(permeability_exponent=2.0), 0.3
    ends = integrations.parts_with(
        (True, open_top), ("grounded", top["electrical"]), ("bath", top.get("electrode", "bath"))
    )
    column = integrations.make_column("electrochemical", tissue, grading=5.0, parts=ends)
    of_column, of_block = [], []
    parts = CONFINED | part("bottom", "roller", open=True) | part("top", "straight", open=open_top, **top)
    block = uniform_block(block_grid("plane-strain", np.array([0.0, area]), column.grid.nodes), parts, ELECTROCHEMICAL,
                          tissue)  # fmt: skip
    body, state = equilibrated_body(block)
    for k in range(2):
        plate, above, below = (pressure[k] for pressure in pressures)
        of_column.append(
            integrations.loads(
                plate, filter_bath_concentration=baths[1][k], filter_bath_pressure=below,
                piston_bath_concentration=baths[0][k], piston_bath_pressure=above,
                **({"filter_current": None, "filter_potential": 0.0, "piston_potential": currents[k]}
                   if top["electrical"] == "potential" else {"filter_current": -currents[k]}),
            )
        )  # fmt: skip
        loads: dict[str, Any] = {"top__pressure": plate, "bottom__bath_concentration": baths[1][k],
                                 "bottom__bath_pressure": below}  # fmt: skip
        loads |= {"top__bath_concentration": baths[0][k], "top__bath_pressure": above} if open_top else {}
        loads |= {"top__current": area * currents[k]} if top["electrical"] == "current" else {}
        loads |= {"top__potential": currents[k]} if top["electrical"] == "potential" else {}
        of_block.append(phase(body, **loads))
    expected = integrations.integrate(column, make_protocol(of_column, [300.0] * 2), integrations.equal_steps(10))
    control = make_control(BACKWARD_EULER, 1e-12, fixed_steps=10, every=1)
    return expected, integrate(body, state, make_protocol(of_block, [300.0] * 2), control)


@pytest.mark.parametrize(
    ("open_top", "pressures", "baths", "currents", "top"),
    [
        (True, ((0.1, 0.1), (0.02, 0.0), (0.0, 0.03)), ((1e-4, 2e-4), (BATH, BATH)), (0.0, 0.0), {"electrical": kind})
        for kind in ("floating", "insulating")
    ]
    + [
        (True, ((0.1, 0.0), (0.02, 0.0), (0.0, 0.0)), ((1e-4, 1e-4), (BATH, 2e-4)), (1e-6, -1e-6),
         {"electrical": "current"}),
        (False, ((0.1, 0.0), (0.0, 0.0), (0.01, 0.0)), ((BATH, BATH), (1e-4, BATH)), (1e-6, -5e-7),
         {"electrical": "current", "electrode": "cation"}),
        (False, ((0.1, 0.0), (0.0, 0.0), (0.01, 0.0)), ((BATH, BATH), (1e-4, BATH)), (1e-6, -5e-7),
         {"electrical": "current", "electrode": "anion"}),
        (True, ((0.1, 0.0), (0.02, 0.0), (0.0, 0.0)), ((1e-4, 1e-4), (BATH, 2e-4)), (3.0, -2.0),
         {"electrical": "potential"}),
    ],
    ids=[
        "floating", "insulating", "current", "cation-electrode", "anion-electrode", "potential",
    ],
)  # fmt: skip
def test_one_cell_wide_block_is_the_column(
    open_top: bool, pressures: Any, baths: Any, currents: Any, top: dict[str, Any]
) -> None:
    expected, found = in_column(open_top, pressures, baths, currents, top)
    assert found.complete
    assert np.ptp(expected.strain) > 0.01
    height = 0.5 + found.load("top.displacement")
    np.testing.assert_allclose(height / found.body.initial_height - 1.0, expected.strain, rtol=0, atol=1e-8)
    contents = expected.filled("contents")
    np.testing.assert_allclose(found.filled("contents")[:, : contents.shape[1]], contents, rtol=1e-8, atol=1e-13)
    crossed = expected.filled("crossed")[:, : len(found.body.block.crossed_parts)]
    scale = np.abs(crossed).max(axis=(0, 1))
    assert (np.abs(found.filled("crossed") / 0.3 - crossed) / scale).max() < 1e-7


# ---- reciprocity ------------------------------------------------------------------------------------------


def small_response(electrical: str, load: str, size: float) -> tuple[float, float]:
    """Potential of the top (mV) and water through it (mm3/s) per load, by central differences in the steady state."""
    parts = CLOSED | part("bottom", "fixed", open=True) | part("top", "fixed", open=True, electrical=electrical)
    block = uniform_block(shaped_block_grid("plane-strain", distorted_vertices(6, 5)), parts, ELECTROCHEMICAL)
    found = []
    for sign in (1.0, -1.0):
        result, entered = steady_state(block, **{f"top__{load}": sign * size})
        unknown = block.outside.part_potential(list(parts).index("top"))
        psi = block.outer(result.unknowns)[unknown] if unknown is not None else np.nan
        found.append([psi * block.cells.thermal_energy / FARADAY, entered[list(parts).index("top") - 2, 0]])
    potential, water = (np.array(found[0]) - found[1]) / (2.0 * size)
    return potential, water


def test_streaming_potential_and_electro_osmosis_are_reciprocal() -> None:
    """Onsager: mV per MPa without current are, but for the sign, mm3 of water per C of current without pressure."""
    streaming, _ = small_response("floating", "bath_pressure", 1e-4)
    _, osmosis = small_response("current", "current", 1e-10)
    assert abs(streaming) > 5.0
    assert streaming == pytest.approx(-osmosis, rel=1e-6)


@by_kind
@pytest.mark.parametrize("electrical", ["floating", "insulating"])
def test_streaming_potential_of_a_uniform_flow_is_exact_on_any_grid(kind: str, electrical: str) -> None:
    """xi per pressure = -k_open w c_F R T/(F n_f b), b = c+ D+ + c- D-: the potentials are linear, face by face.

    The pressure is so small that the solid hardly gives way inside.
    """
    tissue, pressure = reference_tissue(), 1e-6
    parts = CLOSED | part("bottom", "fixed", open=True) | part("top", "fixed", open=True, electrical=electrical)
    if kind == "axisymmetric":
        parts |= part("left", "roller")
    block = uniform_block(rough_grid(kind), parts, ELECTROCHEMICAL, stabilisation=0.0)
    cation, anion = ion_concentrations(tissue.osmotic, 2e-4, np.log(BATH))
    conducting = 0.8 * (cation * 5e-4 + anion * 8e-4)
    k = 1e-3 * open_circuit_ratio(tissue, 1.0, cation, anion)
    expected = -k * convection_factor(tissue) * 2e-4 * tissue.thermal_energy / (FARADAY * conducting) * pressure
    result, _ = steady_state(block, top__bath_pressure=pressure)
    found = block.outer(result.unknowns) * tissue.thermal_energy / FARADAY
    assert len(found) == (1 if electrical == "floating" else 5)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


@pytest.mark.parametrize("ion", ["cation", "anion"])
def test_electrode_in_the_wall_converges_at_second_order_on_distorted_grids(ion: str) -> None:
    """A steady current from an electrode to a bath in stiff tissue, carried by one ion through standing water.

    The other ion rests, so that ln a~ and +-psi~ have the same gradient, and  -2 n_f D c d(ln a~)/dy = i/F.
    """
    tissue, density = reference_tissue(youngs_modulus=1e4), (1e-5 if ion == "cation" else 2e-6)
    sign = 1.0 if ion == "cation" else -1.0

    def carried(log_activity: float) -> float:
        cation, anion = ion_concentrations(tissue.osmotic, 2e-4, log_activity)
        return float(cation if ion == "cation" else anion)

    diffusivity = 5e-4 if ion == "cation" else 8e-4
    # the current enters at the top and leaves at the bottom, 1 mm below
    span = sign * density / FARADAY / (2.0 * 0.8 * diffusivity)
    at_wall = brentq(lambda top: quad(carried, np.log(BATH), top)[0] - span, np.log(BATH) - 1.5, np.log(BATH) + 1.5)
    expected = sign * 2.0 * (at_wall - np.log(BATH))
    assert abs(expected) > 0.1
    errors = []
    for n in (5, 10, 20):
        grid = shaped_block_grid("plane-strain", distorted_vertices(2 * n, n))
        top = part("top", "fixed", electrical="current", electrode=ion)
        block = uniform_block(grid, CLOSED | part("bottom", "fixed", open=True) | top, ELECTROCHEMICAL, tissue)
        result, entered = steady_state(block, 1e-12, top__current=2.0 * density)
        np.testing.assert_allclose(entered[:, 0], 0.0, atol=1e-12)
        unknown = block.outside.part_potential(list(CLOSED).index("top"))
        errors.append(abs(block.outer(result.unknowns)[unknown] / expected - 1.0))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.8).all(), (errors, orders)
    assert errors[-1] < 2e-4


# ---- over time --------------------------------------------------------------------------------------------


@by_kind
def test_a_run_with_everything_conserves_and_keeps_the_currents(kind: str) -> None:
    block = uniform_block(shaped_block_grid(kind, distorted_vertices(5, 4, amount=0.04)), conditions(kind),
                          ELECTROCHEMICAL)  # fmt: skip
    body, state = equilibrated_body(block)
    start = block.positions(state.unknowns)
    loads = {key: value for key, value in LOADS.items() if "force" not in key}
    loads |= {"plate__potential": Load(3.0, 100.0), "rest__current": Load(1e-6, 50.0)}
    phases = [phase(body, **loads), phase(body, **(loads | {"plate__pressure": 0.1}))]
    protocol = make_protocol(phases, [200.0, 200.0], np.linspace(20.0, 400.0, 20))
    run = integrate(body, state, protocol, make_control(tolerance=1e-4, expected_strain=0.05, first_step=0.1))
    assert run.complete
    assert run.filled("errors").max() < 1e-10
    histories, crossed = part_histories(body, run.record, start), run.filled("crossed")
    names = [block.parts[i].name for i in block.crossed_parts]
    charge = crossed[:, :, 2] - crossed[:, :, 1]
    through = np.abs(crossed[:, :, 1:]).max()
    assert np.abs(charge[:, names.index("right")]).max() < 1e-12 * through
    assert np.abs(charge[:, names.index("bottom")]).max() < 1e-12 * through
    assert np.abs(charge.sum(axis=1)).max() < 1e-10 * through
    # a ramp of 50 s to 1 uA, then constant
    times = run.filled("time")
    expected = np.where(times < 50.0, 0.5 * times**2 / 50.0, times - 25.0) * 1e-6 / FARADAY
    np.testing.assert_allclose(charge[:, names.index("rest")], expected, rtol=1e-10)
    np.testing.assert_allclose(histories["rest_current"], np.minimum(times / 50.0, 1.0) * 1e-6, rtol=1e-12)
    np.testing.assert_allclose(histories["plate_potential"], np.minimum(times / 100.0, 1.0) * 3.0, rtol=1e-12)
    total = sum(histories[f"{name}_current"] for name in names)
    assert np.abs(total).max() < 1e-3 * np.abs(histories["rest_current"]).max()  # to the tolerance of the stages
    for kind_of, column in (("water_volume", 0), ("anion_amount", 1), ("cation_amount", 2)):
        np.testing.assert_array_equal(histories[f"rest_{kind_of}"], crossed[:, names.index("rest"), column])


def test_fipys_solver_finds_the_same() -> None:
    block = uniform_block(rough_grid("plane-strain"), EVERYTHING, ELECTROCHEMICAL)
    found = []
    for solved in (lambda body: body, fipy_block_body):
        body, state = equilibrated_body(block)
        loads = {key: value for key, value in LOADS.items() if "force" not in key}
        control = make_control(BACKWARD_EULER, 1e-12, fixed_steps=2, every=1)
        found.append(integrate(solved(body), state, make_protocol([phase(body, **loads)], [20.0]), control))
    scale = found[0].body.block.unknown_scale
    assert found[1].complete
    gap = np.abs(found[0].state.unknowns - found[1].state.unknowns) / scale
    assert gap.max() < 1e-9
