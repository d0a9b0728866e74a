"""The sheet of a tissue's laws: what its curves are, and that it can be drawn of any case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fvswell
from fvswell.analysis.tissue_curves import BATHS, tissue_curves
from fvswell.case.case import Case, load_case
from fvswell.physics.osmotic import OSMOTIC_LAWS
from fvswell.reporting.tissue_figure import tissue_figure

CASES = Path(fvswell.__file__).parents[1] / "cases"
PLANAR = {"tissue.fibres": [{"directions": "planar", "modulus": 2.0}]}


def case(name: str = "confined_compression", **changes: Any) -> Case:
    return load_case(CASES / f"{name}.toml").with_changes({key.replace("__", "."): v for key, v in changes.items()})


def test_total_stress_vanishes_in_the_first_equilibrium_and_is_the_load_in_the_others() -> None:
    curves = tissue_curves(case(tissue__osmotic="activity"))
    assert [round(point.volume_ratio, 6) for point in curves.working_points] == [1.131315, 0.858429]
    for point in curves.working_points:
        total = curves.ground_stress - curves.swelling_pressure[point.bath]
        assert np.interp(point.volume_ratio, curves.volume_ratio, total) == pytest.approx(-point.pressure, abs=1e-4)
        by_load, by_bath = curves.equilibrium_by_load[point.bath], curves.equilibrium_by_bath[point.pressure]
        assert np.interp(point.pressure, curves.loads, by_load) == pytest.approx(point.volume_ratio, abs=1e-4)
        log_bath = np.log(point.bath)
        assert np.interp(log_bath, np.log(BATHS), by_bath) == pytest.approx(point.volume_ratio, abs=1e-3)


def test_ions_over_the_bath_are_in_donnan_equilibrium() -> None:
    cation, anion = tissue_curves(case(tissue__osmotic="ideal", bath__osmotic_coefficient=None)).partition
    np.testing.assert_allclose(cation * anion, 1.0, rtol=1e-12)
    assert np.all(np.diff(cation) < 0.0)


def test_permeability_of_the_open_circuit_is_below_its_own_and_comes_to_it_in_strong_baths() -> None:
    curves = tissue_curves(case())
    low, middle, high = (curves.open_circuit_permeability[bath] for bath in sorted(curves.open_circuit_permeability))
    assert np.all((low < middle) & (middle < high) & (high < curves.permeability))


def test_fibres_of_a_disc_pull_along_the_radius_and_not_along_the_axis() -> None:
    curves = tissue_curves(load_case(CASES / "unconfined_disc.toml").with_changes(PLANAR))
    assert np.all(curves.fibre_stress["y"] == 0.0)
    stretched = curves.volume_ratio > 1.0
    assert np.all(curves.fibre_stress["x"][stretched] > 0.0)
    assert np.all(curves.fibre_stress["x"][~stretched] == 0.0)


DRAWN: list[tuple[str, dict[str, Any]]] = [
    *(("confined_compression", {"tissue.osmotic": law}) for law in ("activity", "constant")),
    ("confined_compression", {"tissue.osmotic": "ideal", "bath.osmotic_coefficient": None}),
    ("confined_compression", {"tissue.osmotic_coefficient_per_charge": 500}),
    ("confined_compression", {"tissue.fixed_charge_density": 0.0}),
    ("free_swelling", {"tissue.fixed_charge_density": {"depth": [0, 0.5], "value": [1e-4, 3e-4]}}),
    ("free_swelling", {"tissue.osmotic": "activity", "tissue.reference_state": "equilibrated"}),
    ("unconfined_disc", PLANAR),
    ("plane_strain", {}),
]


@pytest.mark.parametrize(("name", "changes"), DRAWN)
def test_any_case_can_be_drawn(name: str, changes: dict[str, Any], tmp_path: Path) -> None:
    """Six panels with curves and marks; a layout that does not fit would be a warning."""
    chosen = load_case(CASES / f"{name}.toml").with_changes(changes)
    curves = tissue_curves(chosen)
    figure = tissue_figure(chosen, curves)
    figure.savefig(tmp_path / "tissue.png", dpi=50)
    assert len(figure.axes) == 6
    for axes in figure.axes:
        assert axes.get_xlabel()
        assert axes.get_ylabel()
        marks = [line for line in axes.lines if line.get_marker() == "o" and len(line.get_xdata())]  # type: ignore[arg-type]
        assert marks
        low, high = axes.get_ylim()
        assert all(low <= float(np.ravel(line.get_ydata())[0]) <= high for line in marks)
    assert curves.varies == ("depth" in str(changes))


def test_every_osmotic_law_is_drawn() -> None:
    laws = {load_case(CASES / f"{name}.toml").with_changes(changes).tissue.osmotic for name, changes in DRAWN}
    assert laws == set(OSMOTIC_LAWS)


def test_show_and_tissues_are_public() -> None:
    assert {"show", "tissues"} <= set(fvswell.__all__)
    assert len(fvswell.show(case()).axes) == 6
    lines = repr(fvswell.tissues).splitlines()
    assert [line.partition(":")[0] for line in lines] == list(fvswell.tissues)
    assert "Source: Soltz & Ateshian (2000)" in str(fvswell.tissues["bovine-humeral-cartilage"])
