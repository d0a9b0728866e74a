"""The paper's figures and findings, from its own cases and a small sweep."""

from __future__ import annotations

import csv
from typing import Any

import numpy as np
import pytest
import studies
from sample_cases import CASES, small_block, small_compression, small_swelling

from fvswell.case.case import CaseError, load_case
from fvswell.paper.claims import Claim, claims, write_claims
from fvswell.paper.figures import FIGURES, paper_figures
from fvswell.paper.reproduction import PaperResults, paper_results
from fvswell.physics.osmotic import coefficients
from fvswell.prediction.case_prediction import mean_tissue
from fvswell.study.study import Study


def small_sweep(**changes: Any) -> Study:
    ions = studies.parameter("ions", ["tissue.cation_diffusivity", "tissue.anion_diffusivity"], 3e-4, 1e-3)
    tables = {
        "design": [{"name": "map", "kind": "grid", "counts": {"ions": 3, "permeability": 2}}],
        "protocol": [studies.protocol(), studies.protocol("swelling", "free_swelling.toml")],
        "parameter": [ions, studies.PERMEABILITY],
    }
    return studies.study(**(tables | changes))


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> PaperResults:
    cases = (load_case(CASES / "paper" / f"{name}.toml") for name in ("compression", "swelling"))
    block = small_block(phase__swelling__duration=6e5, phase__compression__duration=3e5, time__steps_per_phase=40)
    path = tmp_path_factory.mktemp("paper") / "study.nc"
    return paper_results(*cases, block, small_sweep(), path, processes=1)


@pytest.fixture(scope="module")
def found(results) -> dict[str, Claim]:
    return {claim.subject: claim for claim in claims(results)}


def test_what_has_to_come_out_does(found) -> None:
    """Facts of the theory, whatever the values that the paper's copy lost."""
    for subject in (
        "strains in equilibrium of the two swelling models", "compression in equilibrium, biphasic",
        "swelling, biphasic", "compression: where", "swelling: where", "compression: R^2",
    ):  # fmt: skip
        assert found[subject].agrees == "yes", subject


def test_what_does_not_come_out_is_reported(results, found) -> None:
    """The local error of 39 % does not: ours is below a tenth, in the table as in the simulation."""
    claim = found["compression: local strain error then, up to"]
    assert (claim.paper, claim.agrees) == ("39 %", "no")
    ratios = [d.local_strain_ratio for d in results.compression.differences if d.model == "biphasic-swelling"]
    assert claim.here == f"{100 * ratios[0]:.0f} % and {100 * ratios[1]:.0f} % of the local strain"
    assert max(ratios) < 0.1


def test_times_of_the_largest_errors(found) -> None:
    assert found["compression: time of the largest global error"].agrees == "partly"
    assert found["swelling: time of the largest global error"].agrees == "yes"


def test_cases_are_the_reference_ones() -> None:
    """Given in the paper's words: its eq 14 gives the osmotic coefficient."""
    for own, example in (("compression", "confined_compression"), ("swelling", "free_swelling")):
        paper = load_case(CASES / "paper" / f"{own}.toml")
        changes = {"title": "the same", "tissue.osmotic_coefficient": 0.83, "time.scheme": "backward-euler"}
        assert paper.with_changes(changes) == load_case(CASES / f"{example}.toml").with_changes(changes)
        assert coefficients(mean_tissue([paper]).osmotic)[0].item() == pytest.approx(0.83)


def test_the_sweep_is_run_once_unless_it_is_another(tmp_path) -> None:
    path, cases = tmp_path / "study.nc", (small_compression(), small_swelling(), small_block())
    design = {"name": "line", "kind": "grid"}
    sweeps = [small_sweep(design=[design | {"counts": {"permeability": count}}]) for count in (2, 3)]
    first = paper_results(*cases, sweeps[0], path, processes=1)
    written = path.stat().st_mtime_ns
    again = paper_results(*cases, sweeps[0], path, processes=1)
    assert path.stat().st_mtime_ns == written
    np.testing.assert_array_equal(again.points.r_squared, first.points.r_squared)
    assert paper_results(*cases, sweeps[1], path, processes=1).sweep.sizes["run"] == 6


def test_figures(results) -> None:
    figures = paper_figures(results)
    assert tuple(figures) == FIGURES
    histories, gaps = figures["figure3"].axes
    assert len(histories.lines) == 3
    assert "biphasic-swelling" in gaps.get_ylabel()
    for name in ("figure5", "figure6"):
        *_, loading, unloading = figures[name].axes
        for axes, difference in zip((loading, unloading), differences_of(results, name), strict=True):
            (line,) = axes.lines
            drawn = np.max(line.get_ydata())
            assert drawn >= 100.0 * difference.local_strain_ratio - 1e-9
            assert axes.get_ylim()[1] > drawn
    assert len(figures["figure7"].axes) == 2
    assert len(figures["figure8"].axes) == 1


def test_the_fitted_block_is_drawn_beside_the_full_model(results, found) -> None:
    *_, swelling, compression = paper_figures(results)["figure9"].axes
    assert len(swelling.lines) == len(compression.lines) == 3
    before, after = (np.nansum(line.get_ydata() ** 2) for line in compression.lines[:2])
    assert after < 0.5 * before
    assert found["2D: R^2 with it"].agrees == "yes"
    assert 0.74 < results.block.ratio < 0.79  # of the open-circuit permeability in equilibrium with the second bath
    assert f"{results.block.ratio:.3f} in compression" in found["2D: best permeability, over the tissue's"].here


def differences_of(results: PaperResults, name: str) -> list:
    comparison = results.compression if name == "figure5" else results.swelling
    return [d for d in comparison.differences if d.model == "biphasic-swelling"]


def test_findings_are_written(found, tmp_path) -> None:
    write_claims(tmp_path / "paper.csv", list(found.values()))
    with (tmp_path / "paper.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["subject"] for row in rows] == list(found)
    assert rows[0]["paper"] == "equal"


def test_other_protocols_are_refused(tmp_path) -> None:
    block = load_case(CASES / "plane_strain.toml")
    columns = small_compression(), small_swelling()
    with pytest.raises(CaseError, match="must be of geometry column with two phases"):
        paper_results(block, block, block, small_sweep(), tmp_path / "study.nc")
    with pytest.raises(CaseError, match="must be of geometry plane-strain with two phases"):
        paper_results(*columns, columns[0], small_sweep(), tmp_path / "study.nc")
    with pytest.raises(CaseError, match="needs phases of swelling"):
        paper_results(*columns, block, studies.study(), tmp_path / "study.nc")
    assert not list(tmp_path.iterdir())
