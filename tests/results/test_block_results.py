"""Results of blocks: UGRID files that other programs read, and what the commands make of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from sample_cases import small_block, small_compression
from typer.testing import CliRunner

from fvswell.analysis.comparison import BlockDifference, Comparison, compare_results
from fvswell.case.case import MODELS
from fvswell.cli.main import app
from fvswell.errors import OutputError
from fvswell.reporting.block_plots import all_blocks, block_comparison_figure, block_figure
from fvswell.reporting.plots import chosen_times, chosen_variables
from fvswell.reporting.reports import effort_lines
from fvswell.results.fields import field, is_field
from fvswell.results.file import read_case, read_result
from fvswell.results.moved_grid import first_fold, is_block, moved_nodes, quadrilaterals
from fvswell.simulation.run import run

GRID = {"mesh", "face_nodes", "node_x", "node_y", "face_x", "face_y", "probe", "time"}
LOCATIONS = {"cell": "face", "node": "node"}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    directory = tmp_path_factory.mktemp("blocks")
    paths = {model: directory / f"{model}.nc" for model in MODELS}
    for model, path in paths.items():
        run(small_block(), model, path=path)
    return paths


@pytest.fixture(scope="module")
def comparison(files: dict[str, Path]) -> Comparison:
    return compare_results({model: read_result(path) for model, path in files.items()})


@pytest.mark.parametrize("model", MODELS)
def test_file_keeps_the_rules_of_ugrid(files: dict[str, Path], model: str) -> None:
    with netCDF4.Dataset(files[model]) as file:
        assert file.Conventions == "CF-1.11 UGRID-1.0"
        mesh = file["mesh"]
        assert mesh.cf_role == "mesh_topology"
        assert mesh.topology_dimension == 2
        assert mesh.face_dimension == "face"
        connectivity = file[mesh.face_node_connectivity]
        assert connectivity.dtype == np.int32
        assert connectivity.getncattr("_FillValue") == -1
        assert connectivity.start_index == 0
        assert connectivity.dimensions == ("face", "corner")
        for name in (*mesh.node_coordinates.split(), *mesh.face_coordinates.split()):
            assert "time" not in file[name].dimensions
            assert file[name].standard_name in ("projection_x_coordinate", "projection_y_coordinate")
            assert file[name].units == "mm"
        assert file["time"].units == "s"
        assert file.dimensions["time"].isunlimited()


@pytest.mark.parametrize("model", MODELS)
def test_every_variable_states_what_it_is(files: dict[str, Path], model: str) -> None:
    with netCDF4.Dataset(files[model]) as file:
        assert {name for name in file.variables if not is_field(name)} == GRID
        for name in filter(is_field, file.variables):
            variable, own = file[name], field(name)
            expected = dict(own.attributes)
            if own.location in LOCATIONS:
                expected |= {"location": LOCATIONS[own.location], "mesh": "mesh"}
                assert variable.dimensions == ("time", expected["location"])
            assert {key: variable.getncattr(key) for key in variable.ncattrs()} == expected
            assert np.isfinite(variable[...]).all()


def test_plain_xarray_reads_what_the_run_gave(files: dict[str, Path]) -> None:
    expected = run(small_block(), "electrochemical")
    with xr.open_dataset(files["electrochemical"], decode_times=False) as found:
        for name in expected.variables:
            np.testing.assert_allclose(found[name].values, expected[name].values, rtol=1e-12, atol=1e-15)
    assert read_case(files["electrochemical"]) == small_block()


def test_moved_grid_has_the_volumes_that_the_fields_state(files: dict[str, Path]) -> None:
    result = read_result(files["electrochemical"])
    cells = quadrilaterals(result)

    def areas(nodes: np.ndarray) -> np.ndarray:
        x, y = nodes[:, cells]
        return 0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)

    stress_free = areas(np.stack([result["node_x"], result["node_y"]]))
    for index, time in enumerate(result["time"].values):
        moved = areas(moved_nodes(result, float(time)))
        np.testing.assert_allclose(moved / stress_free, result["volume_ratio"][index], rtol=1e-12)
    times = result["time"].values
    half = moved_nodes(result, 0.5 * (times[1] + times[2]))
    np.testing.assert_allclose(half, 0.5 * (moved_nodes(result, times[1]) + moved_nodes(result, times[2])), rtol=1e-12)


def test_moved_grid_is_refused_beyond_the_result_and_of_a_column(files: dict[str, Path]) -> None:
    result = read_result(files["biphasic"])
    for time in (-1.0, 4.1e4):
        with pytest.raises(OutputError, match=f"time {time:.6g} s: must be from 0 to 40000 s"):
            moved_nodes(result, time)
    column = run(small_compression(model="biphasic"))
    assert not is_block(column)
    with pytest.raises(OutputError, match="only the results of blocks"):
        moved_nodes(column, 0.0)


def test_xugrid_reads_it(files: dict[str, Path]) -> None:
    pytest.importorskip("xugrid")
    script = f"""
import numpy as np, xugrid
dataset = xugrid.open_dataset({str(files["electrochemical"])!r}, decode_times=False)
grid = dataset.ugrid.grid
assert grid.n_face == 20 and grid.n_node == 30, grid
assert dataset["fluid_pressure"].dims == ("time", grid.face_dimension)
assert dataset["displacement_x"].dims == ("time", grid.node_dimension)
np.testing.assert_allclose(grid.area.sum(), 50.0)
"""
    subprocess.run([sys.executable, "-W", "ignore", "-c", script], check=True, timeout=120)


def test_vtk_reads_it(files: dict[str, Path]) -> None:
    pytest.importorskip("vtkmodules.vtkIONetCDF")
    script = f"""
from vtkmodules.vtkIONetCDF import vtkNetCDFUGRIDReader
from vtkmodules.util.numpy_support import vtk_to_numpy
import numpy as np, netCDF4
reader = vtkNetCDFUGRIDReader()
reader.SetFileName({str(files["electrochemical"])!r})
reader.UpdateInformation()
steps = reader.GetOutputInformation(0).Get(reader.GetExecutive().TIME_STEPS())
for name in ("fluid_pressure", "volume_ratio"):
    reader.SetCellArrayStatus(name, 1)
reader.SetPointArrayStatus("displacement_x", 1)
file = netCDF4.Dataset({str(files["electrochemical"])!r})
np.testing.assert_allclose(steps, file["time"][:])
reader.UpdateTimeStep(steps[-1])
grid = reader.GetOutput()
assert grid.GetNumberOfCells() == 20 and grid.GetNumberOfPoints() == 30
assert all(grid.GetCellType(i) == 9 for i in range(20))  # quadrilaterals
pressure = vtk_to_numpy(grid.GetCellData().GetArray("fluid_pressure"))
np.testing.assert_allclose(pressure, file["fluid_pressure"][-1])
moved = vtk_to_numpy(grid.GetPointData().GetArray("displacement_x"))
np.testing.assert_allclose(moved, file["displacement_x"][-1])
"""
    subprocess.run([sys.executable, "-c", script], check=True, timeout=120)


def test_comparison_is_of_the_probe(comparison: Comparison) -> None:
    swelling, compression = (comparison.of_phase(phase) for phase in comparison.phases)
    assert comparison.reference == "electrochemical"
    assert {each.quantity for each in comparison.differences} == {"probe_displacement_x"}
    base = comparison.results["electrochemical"]
    for each in (*swelling, *compression):
        assert isinstance(each, BlockDifference)
        own = comparison.results[each.model]
        gaps = (own["probe_displacement_x"] - base["probe_displacement_x"]).values
        assert each.largest == pytest.approx(gaps[base["time"].values == each.time].item())
        assert 0.0 < each.x < 10.0
        assert 0.0 < each.y < 5.0
    plain, simple = swelling
    assert plain.final == pytest.approx(0.0, abs=1e-12)  # the biphasic model does not swell
    assert plain.local_strain_ratio == pytest.approx(1.0)
    assert 0.9 < simple.r_squared < 1.0


def test_prescribed_displacement_is_compared_by_its_pressure() -> None:
    moved = {"displacement": {"ramp_to": -0.1, "over": 1e3}}
    held = small_block(phase__compression__top=moved)
    results = {model: run(held, model) for model in ("biphasic-swelling", "electrochemical")}
    first, second = compare_results(results).differences
    assert (first.quantity, second.quantity) == ("probe_displacement_x", "top_pressure")


def test_figures_draw_fields_on_the_moved_grid(comparison: Comparison) -> None:
    results = comparison.results
    times, variables = chosen_times(results, "4000 s, 40000 s"), chosen_variables(results, None)
    figure = block_figure(results, times, variables)
    figure.draw_without_rendering()
    maps = [axes for axes in figure.axes if axes.get_aspect() == 1.0]
    assert len(maps) == 2 * (3 + 3 + 2)  # of all models, but the biphasic one has no ions
    drawn = np.array([path.vertices[:4] for path in maps[5].collections[0].get_paths()])
    base = results["electrochemical"]
    np.testing.assert_allclose(drawn, moved_nodes(base, 4e4).T[quadrilaterals(base)])
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert "volume ratio" in labels
    assert "fluid pressure (MPa)" in labels
    outer, inner = figure.bbox_inches, figure.get_tightbbox()
    assert inner.x0 >= outer.x0
    assert inner.x1 <= outer.x1
    assert len(block_comparison_figure(comparison).axes) == 5
    assert len(block_figure(results, times, []).axes) == 2


def test_blocks_and_columns_do_not_share_a_figure(comparison: Comparison) -> None:
    column = run(small_compression(model="biphasic"))
    with pytest.raises(OutputError, match=r"blocks \(a\) and columns \(b\) need figures of their own"):
        all_blocks({"a": comparison.results["biphasic"], "b": column})


def test_commands_run_compare_plot_and_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("block.toml").write_text(small_block().to_toml(), encoding="utf-8")
    done = CliRunner().invoke(app, ["compare", "block.toml"])
    assert done.exit_code == 0, done.stderr
    names = {f"{model}.nc" for model in MODELS} | {f"comparison.{suffix}" for suffix in ("csv", "png", "pdf")}
    assert {file.name for file in Path("output/block").iterdir()} == names
    for text in (
        "boundary  left roller; right free, open to the bath",
        "Phase compression: difference of the probe",
        "displacement of the probe at x = 10 mm, y = 5 mm",
        "top pressure to 0.1 MPa within 50 s",
    ):
        assert text in done.stdout
    header = Path("output/block/comparison.csv").read_text().splitlines()[0]
    assert "local_strain,local_strain_ratio,x,y,final,reference_final,reference" in header
    result = "output/block/electrochemical.nc"
    done = CliRunner().invoke(app, ["info", result])
    assert done.exit_code == 0
    probe = float(read_result(result)["probe_displacement_x"][-1])
    assert f"{probe:+.5g}" in done.stdout
    done = CliRunner().invoke(app, ["plot", result, "--variable", "water_flux_x", "--variable", "displacement_y"])
    assert done.exit_code == 0, done.stderr
    assert Path("output/block/electrochemical.png").stat().st_size > 10000


def test_a_fold_at_a_glued_corner_is_reported() -> None:
    """A corner of a cell pushed through its diagonal; the cell's mean volume does not show it."""
    result = run(small_block(time__steps_per_phase=2))
    assert first_fold(result) is None
    assert not any("folded" in line for line in effort_lines(result))
    cell = quadrilaterals(result)[-1]
    displacement = result["displacement_x"].copy()
    width = float(result["node_x"][cell[1]] - result["node_x"][cell[0]])
    displacement[2:, cell[2]] = displacement[2:, cell[2]] - 1.2 * width
    folded = result.assign(displacement_x=displacement)
    fold = first_fold(folded)
    assert fold == (float(result["time"][2]), float(result["face_x"][-1]), float(result["face_y"][-1]))
    assert any("is folded over from t = " in line for line in effort_lines(folded))
