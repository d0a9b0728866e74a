"""Runs of blocks from cases: they agree with columns, conserve, converge, and stop where they have to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from sample_cases import CASES, inverting_block, small_block, small_compression, small_swelling
from typer.testing import CliRunner

from fvswell.analysis.characteristics import characteristics
from fvswell.analysis.comparison import compare
from fvswell.case.case import MODELS, Case, load_case
from fvswell.cli.main import app
from fvswell.errors import SolverError
from fvswell.numerics.state import record_room
from fvswell.physics.solids import aggregate_modulus
from fvswell.results.file import COMPLETE, read_result
from fvswell.simulation.block_run import BlockRun
from fvswell.simulation.run import Progress, run


def column_as_block(column: Case) -> Case:
    """A one-cell-wide block between rollers with the filter at its bottom."""
    content = {
        "title": column.title, "model": column.model, "open_circuit_permeability": column.open_circuit_permeability,
        "geometry": {
            "kind": "plane-strain", "width": 0.1, "height": column.geometry.height,
            "cells": [1, column.geometry.cells], "grading": column.geometry.grading, "finest_at": ["bottom"],
        },
        "boundary": {
            "left": {"mechanical": "roller"}, "right": {"mechanical": "roller"},
            "bottom": {"mechanical": "roller", "bath": "open"}, "top": {"mechanical": "free"},
        },
    }  # fmt: skip
    dumped = column.model_dump(exclude_none=True)
    content |= {key: dumped[key] for key in ("tissue", "bath", "time")}
    content["phase"] = []
    for phase in dumped["phase"]:
        content["phase"].append({"top" if key == "piston" else key: value for key, value in phase.items()})
    return Case._from_content(content, "column as block")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("column", [small_compression(), small_swelling()], ids=["compression", "swelling"])
def test_one_cell_wide_block_is_the_column(column: Case, model: str) -> None:
    column = column.with_changes({"model": model})
    expected, found = run(column), run(column_as_block(column))
    np.testing.assert_allclose(found["time"], expected["time"], rtol=1e-14)
    np.testing.assert_allclose(found["global_strain"], expected["global_strain"], atol=1e-8)
    np.testing.assert_allclose(found["volume_ratio"], expected["volume_ratio"], atol=1e-8)
    if model == "electrochemical":
        np.testing.assert_allclose(found["electric_potential"], expected["electric_potential"], atol=1e-6)  # mV


@pytest.fixture(scope="module")
def results() -> dict[str, xr.Dataset]:
    return compare(small_block()).results


def test_run_conserves_water_salt_and_charge(results: dict[str, xr.Dataset]) -> None:
    errors = {name for name in results["electrochemical"] if str(name).endswith("_balance_error")}
    assert errors == {f"{balance}_balance_error" for balance in ("volume", "anion", "cation", "charge")}
    for result in results.values():
        for name in errors & set(result):
            assert float(result[name].max()) < 1e-10


def test_both_swelling_models_start_in_the_same_equilibrium(
    results: dict[str, xr.Dataset],
) -> None:
    full, simple = results["electrochemical"], results["biphasic-swelling"]
    for axis in "xy":
        np.testing.assert_allclose(
            full[f"displacement_{axis}"][0], simple[f"displacement_{axis}"][0], rtol=1e-10, atol=1e-12
        )
    for result in results.values():
        assert result["global_strain"][0] == 0.0
        assert np.abs(result["water_flux_x"][0]).max() < 1e-20
    assert np.abs(results["biphasic"]["displacement_x"][0].values).max() < 1e-12
    assert full["height"][0] > 5.05


def test_plate_stays_straight_and_carries_what_it_is_given(results: dict[str, xr.Dataset]) -> None:
    for result in results.values():
        top = result["displacement_y"].values[:, result["node_y"].values == 5.0]
        assert np.ptp(top, axis=1).max() < 1e-12
        assert float(result["top_pressure"][-1]) == pytest.approx(0.1, rel=1e-12)
        probe = result["probe_displacement_y"].values
        np.testing.assert_allclose(probe, result["global_strain"] * result["height"][0], atol=1e-12)


def test_swelling_models_come_to_the_same_equilibrium() -> None:
    long = {"phase__swelling__duration": 2e6, "phase__compression__duration": 2e6}
    ends = [run(small_block(model=model, **long)).isel(time=-1) for model in ("electrochemical", "biphasic-swelling")]
    for axis in "xy":
        found, expected = (end[f"probe_displacement_{axis}"] for end in ends)
        assert float(found) == pytest.approx(float(expected), rel=1e-4)


def test_load_appears_at_once_as_fluid_pressure_without_a_checkerboard() -> None:
    """A moment after the load the block deforms as an incompressible body: smooth pressure, J as it was."""
    moment = 0.05  # s, 1e-6 of the consolidation time
    case = small_block(
        model="biphasic", geometry__cells=[12, 10], phase__swelling__duration=1.0, time__steps_per_phase=1,
        phase__compression__duration=moment, phase__compression__top={"pressure": 0.1},
    )  # fmt: skip
    last = run(case).isel(time=-1)
    pressure, J = (last[name].values.reshape(10, 12) for name in ("fluid_pressure", "volume_ratio"))
    assert pressure[5, 0] > 0.05  # the load is on the fluid
    # away from the draining edge and its corners, water has not moved
    assert np.abs(J[:, :6] - 1.0).max() < 2e-3
    inside = pressure[:, :6]  # falls toward the free edge and toward the plate, from every cell to the next
    assert (np.diff(inside, axis=0) < 0.0).all()
    assert (np.diff(inside, axis=1) < 0.0).all()


def probe_history(cells: list[int], times: list[float], tolerance: float = 3e-3) -> np.ndarray:
    case = load_case(CASES / "plane_strain.toml").with_changes(
        {"geometry.cells": cells, "output.every": None, "output.times": times, "time.tolerance": tolerance}
    )
    return run(case)["probe_displacement_x"].values[-len(times) :]


def test_probe_converges_with_the_grid_in_small() -> None:
    coarse, middle, fine = (probe_history([n, n], [1e4, 6e5, 1.2e6]) for n in (4, 8, 16))
    assert (np.abs(fine - middle)[1:] < np.abs(middle - coarse)[1:]).all()
    np.testing.assert_allclose(middle, fine, rtol=0.02)


@pytest.mark.slow
def test_probe_converges_with_the_grid() -> None:
    times = [100.0, 1e4, 6e5, 1.2e6]
    histories = [probe_history(cells, times, 1e-3) for cells in ([20, 10], [20, 20], [40, 40])]
    np.testing.assert_allclose(histories[0], histories[1], rtol=0.02)
    np.testing.assert_allclose(histories[1][1:], histories[2][1:], rtol=4e-3)
    np.testing.assert_allclose(histories[1][0], histories[2][0], rtol=0.2)  # a layer thinner than the cells


def test_block_that_is_held_all_around_changes_its_salt_alone() -> None:
    """One cell between rollers: no displacement is unknown."""
    rollers = {"mechanical": "roller"}
    case = small_block(
        geometry__cells=[1, 1], geometry__probe=None, phase__compression__top=None, phase__compression__duration=1e8,
        boundary={"left": rollers, "right": rollers | {"bath": "open"}, "bottom": rollers, "top": rollers},
    )  # fmt: skip
    result = run(case)
    np.testing.assert_array_equal(result["volume_ratio"], 1.0)
    equilibrium = np.sqrt((0.5 * 2e-4) ** 2 + result["bath_concentration"].values[-1] ** 2) - 0.5 * 2e-4
    assert float(result["anion_concentration"][-1].item()) == pytest.approx(equilibrium, rel=1e-3)


def test_inverting_cells_stop_the_run_with_what_there_is(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(inverting_block().to_toml(), encoding="utf-8")
    done = CliRunner().invoke(app, ["run", str(path), "-o", str(tmp_path / "out")])
    assert done.exit_code == 3
    assert "stopped at t = " in done.stderr
    assert "in phase compression: the tissue would be inverted or without water at x = " in done.stderr
    assert "mm, y = " in done.stderr
    assert "holds the result until then, marked as partial" in done.stderr
    result = read_result(tmp_path / "out" / "biphasic.nc")
    assert result.attrs["run_status"].startswith("stopped at t = ")
    assert 2e4 < float(result["time"][-1]) < 20100.0
    assert float(result["volume_ratio"].min()) > 0.2  # water in every cell still
    with pytest.raises(SolverError):
        run(inverting_block())


def test_block_that_nothing_balances_is_refused_before_the_run() -> None:
    case = small_block(tissue__youngs_modulus=1e-6, tissue__poisson_ratio=0.0)
    with pytest.raises(SolverError, match="no equilibrium was found in the bath of"):
        run(case)


def test_progress_reports_the_strain() -> None:
    reports: list[Progress] = []
    result = run(small_block(), report=reports.append)
    assert [each.strain for each in reports] == result["global_strain"].values.tolist()
    assert reports[-1].time == reports[-1].phase_ends[-1]


def test_characteristics_of_a_block() -> None:
    numbers = characteristics(small_block())
    swollen = numbers.equilibria["electrochemical"]
    assert numbers.equilibria["biphasic"].initial_stretch == pytest.approx(1.0, abs=1e-12)
    # glued below and free above: between uniaxial (1.0545 with E = 0.5) and free swelling
    assert 1.02 < swollen.initial_stretch < swollen.initial_volume_ratio < 1.06
    assert numbers.drainage_length == pytest.approx(10.1, abs=0.1)
    modulus = 1.0 * 0.7 / (1.3 * 0.4)
    assert numbers.consolidation_time == pytest.approx(numbers.drainage_length**2 / (1e-3 * modulus), rel=1e-12)
    assert 0.80 < numbers.open_circuit_ratio[0] < numbers.open_circuit_ratio[1] < 0.85


@pytest.mark.parametrize("name", ["plane_strain", "unconfined_disc"])
def test_cases_of_blocks_are_valid(name: str) -> None:
    done = CliRunner().invoke(app, ["check", str(CASES / f"{name}.toml")])
    assert done.exit_code == 0, done.stderr
    assert "is valid" in done.stdout


def test_disc_relaxes_from_the_stress_of_an_incompressible_body_to_that_of_its_solid() -> None:
    case = load_case(CASES / "unconfined_disc.toml").with_changes({"geometry.cells": [10, 1], "model": "biphasic"})
    result = run(case)
    assert result.attrs["run_status"] == COMPLETE
    pressure, volume = result["top_pressure"].values, result["volume_ratio"].values
    # without friction uniaxial stress: 3 G before any water has left, E in the end, at small strain
    assert pressure[-1] == pytest.approx(0.5 * 0.05, rel=0.05)
    assert 1.1 < pressure.max() / pressure[-1] < 1.5 / 1.3 + 0.02
    np.testing.assert_allclose(volume[-1], volume[-1].mean(), rtol=1e-3)
    bulging = result["probe_displacement_x"].values
    assert bulging.max() > bulging[-1] > 0.0  # it bulges, and then gives water away


def test_failures_are_placed_at_vertices_or_cells() -> None:
    body = BlockRun(small_block())
    x, y = body.grid.vertices[:, -1]
    assert body.place("momentum", body.grid.vertices.shape[1] - 1) == f"x = {x:.3g} mm, y = {y:.3g} mm"
    x, y = body.grid.centres[:, 3]
    assert body.place("volume", 3) == f"x = {x:.3g} mm, y = {y:.3g} mm"


def test_loads_go_on_in_phases_that_do_not_name_them() -> None:
    """The second phase names the bath alone: the plate's pressure stays."""
    result = run(
        small_block(
            phase__swelling__top={"pressure": {"ramp_to": 0.05, "over": 50.0}}, phase__compression__top=None,
            phase__compression__bath_concentration=1.5e-4,
        ),
        "biphasic-swelling",
    )  # fmt: skip
    np.testing.assert_allclose(result["top_pressure"][1:], 0.05, rtol=1e-12)


def test_tolerance_of_steps_is_relative_to_the_strain_that_each_load_brings() -> None:
    moved = small_block(
        model="biphasic", phase__compression__top={"displacement": {"ramp_to": -0.5, "over": 50.0}},
        phase__swelling__bath_concentration=None,
    )  # fmt: skip
    assert BlockRun(moved).largest_strain() == pytest.approx(0.1, rel=1e-12)  # of a height of 5 mm
    aside = small_block(
        model="biphasic", boundary__right__mechanical="straight", boundary__bottom__mechanical="roller",
        boundary__top__mechanical="free", phase__swelling__bath_concentration=None,
        phase__compression__top={"pressure": 0.0},
        phase__compression__right={"displacement": {"ramp_to": -0.5, "over": 50.0}},
    )  # fmt: skip
    assert BlockRun(aside).largest_strain() == pytest.approx(0.05, rel=1e-12)  # of a width of 10 mm
    pressed = small_block(model="biphasic", phase__compression__top={"pressure": 0.01})
    tissue = BlockRun(pressed).tissue
    modulus = float(np.max(aggregate_modulus(tissue.solid, tissue.fluid_fraction)))
    assert BlockRun(pressed).largest_strain() == pytest.approx(0.01 / modulus, rel=0.02)


def test_mean_height_of_a_disc_is_weighted_by_area() -> None:
    """More charge at the axis makes a bump there, which is much of the radius and little of the area."""
    charge = {"x": ["0 mm", "0.75 mm", "1.5 mm"], "value": [4e-4, 1e-4, 1e-4]}
    case = load_case(CASES / "unconfined_disc.toml").with_changes(
        {
            "boundary.top.mechanical": "free", "geometry.cells": [30, 4], "geometry.grading": 1,
            "tissue.fixed_charge_density": charge, "phase.compression.top": {"pressure": 0.0},
        }
    )  # fmt: skip
    body = BlockRun(case)
    record = record_room(body.state, 1, 0)
    record.unknowns[0], record.loads[0], record.filled[0] = body.state.unknowns, body.state.loads, 1
    top, bottom = (body.grid.edge_vertices(edge) for edge in ("top", "bottom"))
    positions = body.block.positions(body.state.unknowns)[1]
    height, radius = positions[top] - positions[bottom], body.grid.vertices[0, top]
    rings = np.diff(radius**2) / radius[-1] ** 2
    expected = 0.5 * (height[1:] + height[:-1]) @ rings
    assert height.mean() > expected + 0.005
    assert body.fields(record)["height"][0] == pytest.approx(expected, abs=2e-4)


def test_properties_from_a_table_over_the_plane() -> None:
    """Bilinear between the table's places: exact for a product of linear functions, and constant beyond them."""
    x, y = [0.0, 4.0, 10.0], [0.0, 5.0]
    table = [[(1.0 + 0.1 * a) * (1.0 + 0.2 * b) * 1e-3 for a in x] for b in y]
    case = small_block(
        tissue__hydraulic_permeability={"x": x, "y": y, "value": table}, geometry__grading=2, model="biphasic"
    )
    body = BlockRun(case)
    for tissue, points in (
        (body.tissue, body.grid.centres),
        (body.block.faces, body.grid.face_centres[:, body.block.diamonds.faces]),
    ):
        expected = (1.0 + 0.1 * points[0]) * (1.0 + 0.2 * points[1]) * 1e-3
        np.testing.assert_allclose(tissue.permeability.hydraulic_permeability, expected, rtol=1e-12)
    short = {"x": [2.0, 4.0], "y": [1.0, 2.0], "value": [[1.0, 2.0], [3.0, 4.0]]}
    modulus = BlockRun(small_block(tissue__youngs_modulus=short, model="biphasic")).tissue.solid.youngs_modulus
    corners = np.array(modulus).reshape(4, 5)[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_allclose(corners, [1.0, 2.0, 3.0, 4.0])
    # a block whose properties say the same everywhere is the block without a table
    flat = {"x": [0.0, 10.0], "y": [0.0, 5.0], "value": [[1e-3, 1e-3], [1e-3, 1e-3]]}
    varying, plain = (run(small_block(model="biphasic", **change)) for change in (
        {"tissue__hydraulic_permeability": flat}, {}
    ))  # fmt: skip
    np.testing.assert_allclose(varying["volume_ratio"], plain["volume_ratio"], rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "scheme", "most_steps", "most_iterations"),
    [
        ("plane_strain", "esdirk43", 45, 320),
        ("unconfined_disc", "esdirk43", 25, 130),
        # each step sees anew how fast Newton converges, so that a run that goes on from a file is the same
        ("plane_strain", "backward-euler", 101, 345),
        ("unconfined_disc", "backward-euler", 51, 150),
    ],
)
def test_newton_iterations_of_the_shipped_cases_are_bounded(
    name: str, scheme: str, most_steps: int, most_iterations: int
) -> None:
    """A loss of speed shows in a count; few cells, as the count hardly depends on them."""
    changes = {"geometry.cells": [8, 8] if name == "plane_strain" else [16, 2], "time.scheme": scheme}
    if scheme == "backward-euler":
        changes |= {"time.tolerance": None, "time.steps_per_phase": 50}
    result = run(load_case(CASES / f"{name}.toml").with_changes(changes))
    assert result.attrs["run_status"] == COMPLETE
    assert result.sizes["step"] <= most_steps
    assert int(result["step_iterations"].sum()) <= most_iterations
