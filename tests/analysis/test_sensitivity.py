"""Sobol indices against known ones, and against what physics demands."""

from __future__ import annotations

import builtins
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import studies
from sample_cases import small_compression, small_swelling

from fvswell.analysis import sensitivity as module
from fvswell.analysis.sensitivity import ranges_about, read_ranges, sensitivity
from fvswell.case.case import CaseError
from fvswell.errors import OutputError
from fvswell.reporting.sensitivity_report import sensitivity_figure, sensitivity_tables, write_sensitivity
from fvswell.study.study import Study

SQUARE = studies.parameter("stiffness", "tissue.youngs_modulus", 0.25, 1.0, spacing="log")
PERMEABILITY = studies.parameter("permeability", "tissue.hydraulic_permeability", 5e-4, 2e-3, spacing="log")
TALL = studies.parameter("height", "geometry.height", "0.25 mm", "1 mm", spacing="log")


POINT = [{"name": "one", "kind": "combinations", "sampling": "random", "count": 1}]  # designs are not used


def study_of(parameters: list[dict[str, Any]], **changes: Any) -> Study:
    return studies.study(parameter=parameters, design=POINT, **changes)


def test_indices_of_a_known_function(monkeypatch) -> None:
    """1 - R^2 = E^3 k over ranges of one factor: log10 has the variances 9 : 1, and no interaction."""

    def known(cases):
        values = np.array([[case.tissue.youngs_modulus**3 * case.tissue.hydraulic_permeability] for case in cases])
        return SimpleNamespace(r_squared=np.repeat(1.0 - values, 2, axis=1))

    monkeypatch.setattr(module, "predict_cases", known)
    (result,) = sensitivity(study_of([SQUARE, PERMEABILITY]), samples=256)
    assert result.parameters == ("stiffness", "permeability")
    assert result.models is None
    for values in (result.predictor.first, result.predictor.total):
        np.testing.assert_allclose(values, [[0.9, 0.9], [0.1, 0.1]], atol=0.02)
    np.testing.assert_allclose(result.predictor.mean, np.log10(0.5**3 * 1e-3), atol=1e-3)
    np.testing.assert_allclose(result.predictor.deviation, np.log10(4.0) * np.sqrt(10.0 / 12.0), rtol=1e-3)


def test_the_height_decides_nothing() -> None:
    """Time goes with the square of the height in both models, and phases last as long as the tissue relaxes."""
    (result,) = sensitivity(study_of([TALL, PERMEABILITY]), samples=32)
    np.testing.assert_allclose(result.predictor.total[0], 0.0, atol=1e-12)
    assert np.all(result.predictor.total[1] > 0.5)


def test_models_confirm_the_predictor() -> None:
    """Loads small enough for the linear theory: the same misfit on average, and the same order of the parameters."""
    protocol = studies.protocol(geometry__cells=20, time__steps_per_phase=40, phase__loading__piston__pressure=0.02)
    weak = studies.parameter("poisson", "tissue.poisson_ratio", 0.28, 0.32)
    study = study_of([weak, PERMEABILITY], protocol=[protocol])
    done = []
    (result,) = sensitivity(study, 64, 8, processes=1, report=lambda *progress: done.append(progress))
    assert done == [("compression", 32, 32)]
    assert result.models is not None
    assert (result.predictor.evaluations, result.models.evaluations) == (256, 32)
    np.testing.assert_allclose(result.models.mean, result.predictor.mean, atol=0.25)
    for indices in (result.predictor, result.models):
        assert np.all(indices.total[1] > 5.0 * indices.total[0])


def test_ranges_about_a_case() -> None:
    """Loads that are the same stay the same, and what is zero or a profile is left alone."""
    profile = {"depth": [0.0, 0.5], "value": [1e-4, 2e-4]}
    study = ranges_about(small_swelling(tissue__fixed_charge_density=profile, tissue__hindrance_factor=0.8), 2.0)
    parameters = {parameter.name: parameter for parameter in study.table.parameter}
    assert set(parameters) == {
        "youngs_modulus", "hydraulic_permeability", "cation_diffusivity", "anion_diffusivity", "hindrance_factor",
        "bath_concentration", "bath_concentration_in_loading",
    }  # fmt: skip
    assert parameters["bath_concentration"].key == ("bath.concentration", "phase.unloading.bath_concentration")
    assert parameters["bath_concentration_in_loading"].key == ("phase.loading.bath_concentration",)
    assert (parameters["youngs_modulus"].low, parameters["youngs_modulus"].high) == (0.25, 1.0)
    assert (parameters["hindrance_factor"].low, parameters["hindrance_factor"].high) == (0.4, 1.0)


def test_files_of_cases_and_studies_are_reported_apart(tmp_path) -> None:
    (tmp_path / "case.toml").write_text(small_compression().to_toml())
    (tmp_path / "study.toml").write_text(studies.text())
    about, read = (read_ranges(tmp_path / f"{name}.toml", 3.0) for name in ("case", "study"))
    assert about.table.protocol[0].name == "case"
    assert [parameter.name for parameter in read.table.parameter] == ["stiffness", "permeability"]
    with pytest.raises(CaseError, match="no such file"):
        read_ranges(tmp_path / "other.toml", 2.0)


def test_impossible_corners_are_refused() -> None:
    load = studies.parameter("load", "phase.loading.piston.pressure", 0.5, 1.6)  # 1.2 MPa presses all water out
    weak = studies.protocol(tissue__fixed_charge_density=0.0)
    ends = [{"name": "ends", "kind": "one-at-a-time", "count": 2}]
    with pytest.raises(CaseError, match="narrow them"):
        sensitivity(studies.study(parameter=[load], protocol=[weak], impossible="skip", design=ends), samples=8)
    with pytest.raises(CaseError, match="must be a study of biphasic-swelling by electrochemical"):
        sensitivity(studies.study(model="biphasic"), samples=8)


def test_without_salib_the_extra_is_named(monkeypatch) -> None:
    real = builtins.__import__

    def without(name, *rest):
        if name.startswith("SALib"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(OutputError, match=r'pip install "fvswell\[study\]"'):
        sensitivity(studies.study(), samples=8)


def test_report(tmp_path) -> None:
    results = sensitivity(studies.study(), 16)
    (loading, unloading) = sensitivity_tables(results)
    assert loading.title.startswith("compression, loading")
    most = int(results[0].predictor.total[:, 0].argmax())
    assert loading.rows[0][0] == ("stiffness", "permeability")[most]
    assert len(unloading.rows) == 2
    write_sensitivity(tmp_path / "sensitivity.csv", results)
    assert len((tmp_path / "sensitivity.csv").read_text().splitlines()) == 5
    assert len(sensitivity_figure(results).axes) == 2
