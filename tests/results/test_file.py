"""Result files: what is in them, that they stand for themselves, and that no half-written one is ever met."""

from __future__ import annotations

import re
import signal
from itertools import pairwise
from pathlib import Path

import netCDF4
import numpy as np
import pint
import pytest
import xarray as xr
from sample_cases import small_compression

import fvswell
from fvswell.case.case import MODELS
from fvswell.errors import OutputError
from fvswell.results.fields import FIELDS, Field, field, is_field, part_fields
from fvswell.results.file import COMPLETE, read_case, read_result, read_state
from fvswell.results.part_file import PartFile
from fvswell.simulation.run import run

COORDINATES = {"x", "x_bounds", "x_node", "time"}
LOCATION_DIMENSIONS = {
    "global": ("time",),
    "cell": ("time", "cell"),
    "node": ("time", "node"),
    "phase": ("phase",),
    "step": ("step",),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A result file of each model."""
    directory = tmp_path_factory.mktemp("results")
    paths = {model: directory / f"{model}.nc" for model in MODELS}
    for model, path in paths.items():
        run(small_compression(), model=model, path=path)
    return paths


def parsed_units(units: str) -> pint.Unit:
    """UDUNITS text, where ``mm-2`` is a power, as pint reads it."""
    spelled = re.sub(r"([A-Za-z])(-?\d+)", r"\1**\2", units).replace(" ", "*")
    return pint.get_application_registry().parse_units("" if units == "1" else spelled)


KNOWN = FIELDS | part_fields(("filter", "piston"), per_area=True)


@pytest.mark.parametrize("name", KNOWN)
def test_field_tells_all_a_reader_needs(name: str) -> None:
    field = KNOWN[name]
    assert field.location in {"global", "cell", "node", "face", "edge", "phase", "step"}
    assert re.fullmatch(r"(time|phase|step): (point|mean|maximum|sum)", field.cell_methods)
    assert field.long_name.strip()
    parsed_units(field.units)


@pytest.mark.parametrize(
    ("pattern", "same_dimension_as"),
    [
        ("_pressure|_stress$|water_potential", "MPa"),
        ("_concentration|charge_density", "mol/liter"),
        ("ion_flux", "mol/m**2/s"),
        ("water_flux", "m/s"),
        ("^displacement|^height", "m"),
        ("strain|_error|_ratio|_fraction|_iterations|_residual", ""),
        ("_time|_size|_end", "s"),
        ("current_density|_current$", "A/m**2"),
        ("_water_volume", "m"),
        ("ion_amount", "mol/m**2"),
        ("electric_potential|(filter|piston)_potential", "V"),
    ],
)
def test_units_have_the_dimension_of_the_quantity(pattern: str, same_dimension_as: str) -> None:
    expected = pint.get_application_registry().parse_units(same_dimension_as).dimensionality
    names = [name for name in KNOWN if re.search(pattern, name)]
    assert names
    for name in names:
        assert parsed_units(KNOWN[name].units).dimensionality == expected, name


def test_parts_of_the_boundary_have_any_name() -> None:
    """The unit is that of the kind, per area in columns alone; what is no kind is no field."""
    assert field("left_plate_bath_pressure").units == field("fluid_pressure").units
    assert "left plate" in field("left_plate_bath_pressure").long_name
    assert [field("top_water_volume", per_area).units for per_area in (False, True)] == ["mm3", "mm"]
    assert [field("top_current", per_area).units for per_area in (False, True)] == ["A", "A mm-2"]
    assert field("fluid_pressure") is FIELDS["fluid_pressure"]
    for name in ("top_temperature", "_pressure", "pressure"):
        assert not is_field(name)
        with pytest.raises(KeyError):
            field(name)


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("model", MODELS)
def test_variable_in_file_is_as_the_table_says(files: dict[str, Path], model: str, name: str) -> None:
    field: Field = KNOWN[name]
    with netCDF4.Dataset(files[model]) as file:
        if name in file.variables:
            variable = file[name]
            assert {key: variable.getncattr(key) for key in variable.ncattrs()} == field.attributes
            assert variable.dimensions == LOCATION_DIMENSIONS[field.location]
            assert np.isfinite(variable[...]).all()
            assert not np.ma.is_masked(variable[...])


@pytest.mark.parametrize("model", MODELS)
def test_file_holds_nothing_that_the_table_does_not_know(files: dict[str, Path], model: str) -> None:
    assert set(read_result(files[model]).variables) - KNOWN.keys() == COORDINATES


def test_models_have_the_fields_of_their_physics(files: dict[str, Path]) -> None:
    names = {model: set(read_result(path).data_vars) for model, path in files.items()}
    donnan = {"osmotic_pressure", "cation_concentration", "electric_potential", "virtual_concentration"}
    fluxes = {f"{ion}_flux_{part}" for ion in ("cation", "anion") for part in ("convection", "diffusion", "migration")}
    assert not (donnan | fluxes) & names["biphasic"]
    assert donnan <= names["biphasic-swelling"]
    assert not fluxes & names["biphasic-swelling"]
    assert donnan | fluxes <= names["electrochemical"]
    assert names["biphasic"] < names["biphasic-swelling"] < names["electrochemical"]


@pytest.mark.parametrize("model", MODELS)
def test_only_fields_move_in_time(files: dict[str, Path], model: str) -> None:
    with netCDF4.Dataset(files[model]) as file:
        assert file.dimensions["time"].isunlimited()
        for name in COORDINATES - {"time"}:
            assert "time" not in file[name].dimensions
        assert file["time"].units == "s"
        assert file["x"].bounds == "x_bounds"
        x, bounds, nodes = (np.asarray(file[name][...]) for name in ("x", "x_bounds", "x_node"))
    np.testing.assert_array_equal(bounds, list(pairwise(nodes)))
    assert ((bounds[:, 0] < x) & (x < bounds[:, 1])).all()


@pytest.mark.parametrize("model", MODELS)
def test_file_says_where_it_comes_from(files: dict[str, Path], model: str) -> None:
    result = read_result(files[model])
    case = small_compression(model=model)
    assert result.attrs["Conventions"].startswith("CF-1.")
    assert result.attrs["case_sha256"] == case.sha256
    assert result.attrs["run_status"] == COMPLETE
    assert result.attrs["title"] == case.title
    for key, part in (("source", model), ("history", fvswell.__version__), ("package_versions", "fipy")):
        assert part in result.attrs[key]
    assert {"institution", "references", "comment"} <= result.attrs.keys()


def test_displacement_of_the_piston_is_the_change_of_height(files: dict[str, Path]) -> None:
    for path in files.values():
        result = read_result(path)
        height = result["x_node"].values[-1] + result["displacement"].values[:, -1]
        np.testing.assert_allclose(height, result["height"], rtol=1e-13)


def test_flux_parts_add_up_in_every_node(files: dict[str, Path]) -> None:
    result = read_result(files["electrochemical"])
    for ion in ("cation", "anion"):
        parts = [result[f"{ion}_flux_{part}"].values for part in ("convection", "diffusion", "migration")]
        # fluxes of the first record are those of the state at rest before the load
        scale = np.abs(parts).max()
        np.testing.assert_allclose(sum(parts)[1:], result[f"{ion}_flux"].values[1:], rtol=0.0, atol=1e-9 * scale)


def test_flux_parts_are_smooth_up_to_the_filter() -> None:
    fine = small_compression(geometry__cells=40)
    parts = run(fine)["cation_flux_diffusion"].isel(time=2).values
    # what a parabola through the next three nodes expects at the filter
    node = run(fine)["x_node"].values
    expected = np.polyval(np.polyfit(node[1:4], parts[1:4], 2), node[0])
    assert parts[0] == pytest.approx(expected, rel=0.02)


def test_phases_end_where_the_case_says_and_rest_as_equilibrium_does(files: dict[str, Path]) -> None:
    for path in files.values():
        result = read_result(path)
        np.testing.assert_allclose(result["phase_end"], [300.0, 600.0])
        loaded, unloaded = result["equilibrium_strain"].values
        assert loaded < -0.2
        assert unloaded == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_memory_and_file_hold_the_same(files: dict[str, Path], model: str) -> None:
    xr.testing.assert_equal(run(small_compression(), model=model), read_result(files[model]))


@pytest.mark.parametrize("model", MODELS)
def test_result_runs_again_from_itself(files: dict[str, Path], model: str) -> None:
    case = read_case(files[model])
    assert case == small_compression(model=model)
    xr.testing.assert_equal(run(case), read_result(files[model]))


def test_durations_found_before_give_the_same_run() -> None:
    case = small_compression(phase__loading__duration="1.5 relaxation times")
    found = run(case)
    ends = found["phase_end"].values
    xr.testing.assert_equal(found, run(case, durations=np.diff(ends, prepend=0.0)))


def test_ctrl_c_is_heard_at_any_moment_of_writing_and_leaves_nothing(tmp_path: Path) -> None:
    """The netCDF library swallows 1 of 20 of those that come while it defines a file."""

    def write(file: netCDF4.Dataset) -> None:
        for name in "abcdefgh":
            file.setncatts({name: 1.0, name * 2: "text", name * 3: np.arange(3.0)})
            file.createDimension(name, 3)
            file.createVariable(name, "f8", (name,)).setncatts({"units": "mm", "valid_range": [0.0, 1.0]})
            file[name][:] = np.arange(3)

    def interrupt(number: int, frame: object) -> None:
        asked.append(number)
        signal.raise_signal(signal.SIGINT)

    asked: list[int] = []
    heard = 0
    usual = signal.signal(signal.SIGALRM, interrupt), signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        for delay in np.random.default_rng(0).uniform(1e-5, 5e-3, 400):
            try:
                with PartFile(tmp_path / "result.nc", write) as file:
                    signal.setitimer(signal.ITIMER_REAL, delay)
                    with file.writing():
                        pass
                    signal.setitimer(signal.ITIMER_REAL, 0.0)
                    raise EOFError
            except KeyboardInterrupt:
                heard += 1
            except EOFError:
                pass
            assert not list(tmp_path.iterdir())
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in zip((signal.SIGALRM, signal.SIGINT), usual, strict=True):
            signal.signal(number, handler)
    assert heard == len(asked) > 20


def test_unwritable_directory_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        run(small_compression(), path=tmp_path / "file" / "result.nc")


def test_what_is_no_result_is_refused(tmp_path: Path) -> None:
    text, other = tmp_path / "text.nc", tmp_path / "other.nc"
    text.write_text("no netCDF")
    xr.Dataset({"a": ("b", [1.0])}).to_netcdf(other)
    for path, reason in (
        (tmp_path / "none.nc", "no such file"),
        (text, "is not a netCDF file"),
        (other, "is not a result of fvswell"),
        (tmp_path, "is not a netCDF file"),
    ):
        for read in (read_result, read_case):
            with pytest.raises(OutputError, match=reason):
                read(path)
    with pytest.raises(OutputError, match="holds no state to continue from"):
        read_state(other)


@pytest.mark.parametrize("name", ["time", "phase_end", "global_strain", "step_time"])
def test_a_result_without_a_variable_that_all_have_is_refused(
    files: dict[str, Path], tmp_path: Path, name: str
) -> None:
    xr.open_dataset(files["biphasic"], decode_times=False).drop_vars(name).to_netcdf(tmp_path / "less.nc")
    with pytest.raises(OutputError, match=f"less.nc: is no whole result of fvswell: it has no {name}"):
        read_result(tmp_path / "less.nc")


def test_damaged_results_are_reported_in_a_line(files: dict[str, Path], tmp_path: Path) -> None:
    """Cut short, or with bytes overwritten anywhere: a result that can be read, or one clear error."""
    whole = files["electrochemical"].read_bytes()
    draw, refused = np.random.default_rng(0), 0
    for trial in range(60):
        path = tmp_path / f"damaged-{trial}.nc"  # HDF5 may still have an earlier one open
        damaged = bytearray(whole[: int(draw.integers(1, len(whole)))] if trial % 2 else whole)
        for place in draw.integers(0, len(damaged), 40 * (1 - trial % 2)):
            damaged[place : place + 64] = draw.bytes(64)
        path = tmp_path / f"damaged{trial}.nc"  # HDF5 keeps a file open that it has failed to read
        path.write_bytes(damaged)
        try:
            read_result(path)
        except OutputError as error:
            assert str(error).startswith(f"{path}: is ")  # noqa: PT017
            refused += 1
    assert refused >= 30
