"""Results for ParaView: what VTK reads back is what the run computed."""

from __future__ import annotations

import builtins
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sample_cases import small_block, small_compression

from fvswell.errors import OutputError
from fvswell.results.export import export_result
from fvswell.results.file import read_result
from fvswell.results.moved_grid import moved_nodes
from fvswell.simulation.run import run


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "block.nc"
    run(small_block(), path=path)
    return path


READ = """
import sys
import numpy as np
import pyvista

reader = pyvista.get_reader(sys.argv[1])
out = {"time": np.array(reader.time_values)}
for index in range(len(reader.time_values)):
    reader.set_active_time_point(index)
    mesh = reader.read()[0]
    out[f"points{index}"] = mesh.points
    out[f"pressure{index}"] = mesh.cell_data["fluid_pressure"]
    out[f"flux{index}"] = mesh.cell_data["water_flux"]
    out[f"displacement{index}"] = mesh.point_data["displacement"]
    out[f"strain{index}"] = mesh.field_data["global_strain"]
out["areas"] = mesh.compute_cell_sizes(length=False, volume=False)["Area"]
np.savez(sys.argv[2], **out)
"""


def test_series_reads_back_with_moved_points(path: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    series = export_result(path, directory=tmp_path / "new")
    subprocess.run([sys.executable, "-c", READ, str(series), str(tmp_path / "read.npz")], check=True, timeout=120)
    found, result = np.load(tmp_path / "read.npz"), read_result(path)
    np.testing.assert_allclose(found["time"], result["time"])
    for index, time in enumerate(result["time"].values):
        np.testing.assert_allclose(found[f"points{index}"][:, :2].T, moved_nodes(result, time), atol=1e-12)
        np.testing.assert_array_equal(found[f"pressure{index}"], result["fluid_pressure"][index])
        np.testing.assert_array_equal(found[f"flux{index}"][:, 0], result["water_flux_x"][index])
        np.testing.assert_array_equal(found[f"flux{index}"][:, 1], result["water_flux_y"][index])
        assert not found[f"flux{index}"][:, 2].any()
        np.testing.assert_array_equal(found[f"displacement{index}"][:, 1], result["displacement_y"][index])
        assert found[f"strain{index}"] == float(result["global_strain"][index])
    # the cells are read as cells: J tells their areas
    stress_free = found["areas"] / result["volume_ratio"].values[-1]
    assert stress_free.sum() == pytest.approx(50.0, rel=1e-12)


def test_column_is_refused(tmp_path: Path) -> None:
    run(small_compression(model="biphasic"), path=tmp_path / "column.nc")
    with pytest.raises(OutputError, match="is of a column"):
        export_result(tmp_path / "column.nc")
    assert {file.name for file in tmp_path.iterdir()} == {"column.nc"}


def test_unknown_format_and_existing_files_are_refused(path: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match='format "stl": must be vtu'):
        export_result(path, "stl")
    pytest.importorskip("pyvista")
    (tmp_path / "block_03.vtu").write_text("precious")
    with pytest.raises(OutputError, match=r"block_03\.vtu: exists already"):
        export_result(path, directory=tmp_path)
    assert (tmp_path / "block_03.vtu").read_text() == "precious"


def test_missing_pyvista_is_told(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *arguments: Any, **named: Any) -> Any:
        if name == "pyvista":
            raise ImportError(name)
        return real(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(OutputError, match=r'pip install "fvswell\[viz\]"'):
        export_result(path, directory=tmp_path)
