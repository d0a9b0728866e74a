"""Batches of a study: a row's answer is that of the same case run alone, and what is told about it is right."""

from __future__ import annotations

import numpy as np
import pytest
import studies

import fvswell
from fvswell.study.batches import plan, run_batch

RANDOM = [
    studies.parameter("stiffness", "tissue.youngs_modulus", "0.15 MPa", "0.8 MPa"),
    studies.parameter("permeability", "tissue.hydraulic_permeability", 2e-4, 5e-3, spacing="log"),
    studies.parameter("cation", "tissue.cation_diffusivity", 1e-4, 2.5e-3, spacing="log"),
    studies.parameter("anion", "tissue.anion_diffusivity", 1.6e-4, 4e-3, spacing="log"),
    studies.parameter("charge", "tissue.fixed_charge_density", "0.05 mEq/ml", "0.4 mEq/ml"),
    studies.parameter("bath", ["bath.concentration", "phase.unloading.bath_concentration"], "0.05 M", "0.3 M"),
    studies.parameter("load", "phase.loading.piston_pressure", 0.05, 0.5, protocols="compression"),
    studies.parameter("step", "phase.loading.bath_concentration", "0.05 M", "0.3 M", protocols="swelling"),
]
PROTOCOLS = [studies.protocol(), studies.protocol("swelling", "free_swelling.toml")]


def random_study(seed: int, **changes):
    design = [{"name": "spread", "kind": "combinations", "sampling": "random", "count": 5, "seed": seed}]
    return studies.study(protocol=PROTOCOLS, parameter=RANDOM, design=design, strain_curves=True, **changes)


def test_a_row_gives_the_answer_of_its_case_alone():
    study = random_study(20051)
    for batch in plan(study):
        result = run_batch(batch)
        assert set(result["run_status"]) == {"complete"}
        for row, run in list(enumerate(batch.runs))[1::3]:
            durations = None  # found by the first run, and given to the other to save time
            for column, model in enumerate(batch.models):
                alone = fvswell.run(study.case(run), model=model, durations=durations)
                durations = np.diff(alone["phase_end"].values, prepend=0.0).tolist()
                strain = alone["global_strain"].values[1:].reshape(2, -1)
                np.testing.assert_allclose(result["strain"][row, column], strain, rtol=0.0, atol=1e-10)
                np.testing.assert_allclose(result["final_strain"][row, column], strain[:, -1], rtol=0.0, atol=1e-10)
            ends = np.cumsum(result["phase_duration"][row])
            np.testing.assert_allclose(ends, alone["time"].values[[8, 16]], rtol=1e-10)


def test_differences_are_those_of_the_curves():
    batch = plan(random_study(7))[0]
    result = run_batch(batch)
    judged, reference = np.moveaxis(result["strain"], 1, 0)
    for row in range(len(batch.runs)):
        for phase in range(2):
            data, model = reference[row, phase], judged[row, phase]
            mean = sum(data) / len(data)
            by_hand = 1.0 - sum((d - m) ** 2 for d, m in zip(data, model, strict=True)) / sum(
                (d - mean) ** 2 for d in data
            )
            assert result["r_squared"][row, phase] == pytest.approx(by_hand, rel=1e-12)
            worst = max(range(len(data)), key=lambda i: abs(model[i] - data[i]))
            assert result["largest_difference"][row, phase] == model[worst] - data[worst]
            time = (worst + 1) / 8 * result["phase_duration"][row, phase]
            assert result["time_of_largest_difference"][row, phase] == pytest.approx(time, rel=1e-14)


def test_both_swelling_models_have_the_equilibria_that_the_runs_come_to():
    result = run_batch(plan(random_study(8))[0])
    equilibrium, final = result["equilibrium_strain"], result["final_strain"]
    np.testing.assert_allclose(equilibrium[:, 0], equilibrium[:, 1], rtol=0.0, atol=1e-9)
    reached = np.abs(final - equilibrium)[:, 0, 0] / np.abs(equilibrium[:, 0, 0])
    assert (reached < 0.05).all()  # after 1.5 times the time to 99 % by exact steps; these 8 steps are coarse
    assert (result["balance_error"] < 1e-8).all()


def test_error_controlled_rows_are_as_alone_and_sampled_between_their_steps():
    """Ends of phases are those of the case alone; curves those of a run made to hit the samples, to the tolerance."""
    changes = {"geometry.cells": 6, "time": {"scheme": "sdirk2", "tolerance": 1e-4}}
    study = studies.study(protocol=[studies.protocol() | {"changes": changes}], strain_curves=True)
    batch = plan(study)[0]
    result = run_batch(batch)
    assert result["strain"].shape == (4, 2, 2, 50)
    row, model, column = 2, "electrochemical", 1
    case = study.case(batch.runs[row])
    alone = fvswell.run(case, model=model)["global_strain"].values
    np.testing.assert_allclose(result["final_strain"][row, column, -1], alone[-1], rtol=0.0, atol=1e-10)
    duration = result["phase_duration"][row].tolist()
    times = [p * duration[0] + duration[p] * i / 50 for p in range(2) for i in range(1, 51)]
    case = case.with_changes({f"phase.{p}.duration": duration[p] for p in range(2)} | {"output.times": times[:-1]})
    strain = fvswell.run(case, model=model)["global_strain"].values[1:]
    curve = result["strain"][row, column].ravel()[:99]
    np.testing.assert_allclose(curve, strain[:99], rtol=0.0, atol=3e-4 * np.abs(strain).max())


def test_a_row_that_fails_is_told_and_stops_no_other():
    """200 MPa at once: the ions of the squeezed tissue leave the range of the solver."""
    loads = [studies.parameter("load", "phase.loading.piston_pressure", "0.2 MPa", "200 MPa")]
    short = studies.protocol(phase__loading__duration="300 s", phase__unloading__duration="300 s", geometry__cells=4)
    design = [{"name": "loads", "kind": "one-at-a-time", "count": 2}]
    study = studies.study(protocol=[short], parameter=loads, design=design, strain_curves=True)
    result = run_batch(plan(study)[0])
    fine, failed = result["run_status"]
    assert fine == "complete"
    assert failed.startswith("electrochemical: stopped at t = ")
    assert "s in phase loading: the " in failed
    assert np.isnan(result["r_squared"][1]).all()
    assert np.isfinite(result["strain"][1, 0]).all()  # the other model got through
    alone = fvswell.run(study.case(0), model="electrochemical")["global_strain"].values[1:]
    np.testing.assert_allclose(result["strain"][0, 1].ravel(), alone, rtol=0.0, atol=1e-10)


def test_a_row_whose_ramp_outlasts_its_phase_is_told():
    """Half the relaxation time of a permeable tissue is over before the ramp is."""
    slow = {"ramp_to": 0.1, "over": 2000.0}
    protocol = studies.protocol(phase__loading__duration="0.5 relaxation times", phase__loading__piston_pressure=slow)
    permeability = studies.parameter("permeability", "tissue.hydraulic_permeability", 1e-5, 1e-2)
    design = [{"name": "line", "kind": "one-at-a-time", "count": 2}]
    result = run_batch(plan(studies.study(protocol=[protocol], parameter=[permeability], design=design))[0])
    stiff, quick = result["run_status"]
    assert stiff == "complete"
    assert quick.startswith(
        "phase[loading].piston_pressure = {ramp_to = 0.1, over = 2000}: over: 2000 s is longer than"
    )
    assert np.isnan(result["r_squared"][1]).all()


def test_a_row_without_a_relaxation_time_is_told():
    """Nothing is done to a sample under no load, so it never relaxes."""
    loads = [studies.parameter("load", "phase.loading.piston_pressure", 0.0, 0.2)]
    study = studies.study(parameter=loads, design=[{"name": "loads", "kind": "one-at-a-time", "count": 3}])
    result = run_batch(plan(study)[0])
    assert "does not relax in phase loading" in result["run_status"][0]
    assert list(result["run_status"][1:]) == ["complete", "complete"]
    assert np.isnan(result["final_strain"][0]).all()
    assert np.isfinite(result["r_squared"][1:]).all()


def test_batches_hold_every_possible_run_once(monkeypatch):
    monkeypatch.setattr("fvswell.study.batches.LARGEST_BATCH", 4)
    study = random_study(1)
    batches = plan(study)
    assert sorted(run for batch in batches for run in batch.runs) == list(range(10))
    assert all(len(batch.runs) <= 4 for batch in batches)
    assert [batch.index for batch in batches] == list(range(len(batches)))
    assert all(len({int(study.runs.protocol[run]) for run in batch.runs}) == 1 for batch in batches)


def test_columns_of_unlike_grids_are_in_unlike_batches():
    study = studies.study(**studies.many_batches())
    batches = plan(study)
    assert len(batches) == 6
    for batch in batches:
        assert len({study.case(run).geometry for run in batch.runs}) == 1


def test_thicker_samples_take_the_square_of_their_height():
    """In every model time goes with the square of the height: strains at equal fractions of a phase are equal."""
    design = [{"name": "heights", "kind": "one-at-a-time", "count": 2}]
    study = studies.study(
        protocol=[studies.protocol(geometry__cells=6)], parameter=[studies.HEIGHT], design=design, strain_curves=True
    )
    thin, thick = (run_batch(batch) for batch in plan(study))
    np.testing.assert_allclose(thick["strain"], thin["strain"], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(thick["phase_duration"], thin["phase_duration"] * (0.6 / 0.4) ** 2, rtol=1e-8)


def test_impossible_runs_are_in_no_batch():
    loads = studies.parameter("load", "phase.loading.piston_pressure", "0.1 MPa", "10 MPa")
    design = [{"name": "loads", "kind": "one-at-a-time", "count": 5}]
    study = studies.study(model="biphasic", parameter=[loads], design=design, impossible="skip")
    planned = {run for batch in plan(study) for run in batch.runs}
    assert planned == set(range(5)) - set(study.impossible)
    assert study.impossible


def test_a_worker_with_another_version_refuses():
    batch = plan(studies.study())[0]
    other = type(batch)(**vars(batch) | {"version": "0.0.0"})
    with pytest.raises(RuntimeError, match=r"needs 0\.0\.0"):
        run_batch(other)
