"""Batches of a study: a row's answer is that of the same case run alone, and what is said about it is right."""

from __future__ import annotations

import math
from itertools import chain

import numpy as np
import pytest
import studies

import fvswell
from fvswell.simulation.relaxation import phase_durations
from fvswell.study.batches import plan, run_batch
from fvswell.study.sampling import sample_times

RANDOM = [
    studies.parameter("stiffness", "tissue.youngs_modulus", "0.15 MPa", "0.8 MPa"),
    studies.parameter("permeability", "tissue.hydraulic_permeability", 2e-4, 5e-3, spacing="log"),
    studies.parameter("cation", "tissue.cation_diffusivity", 1e-4, 2.5e-3, spacing="log"),
    studies.parameter("anion", "tissue.anion_diffusivity", 1.6e-4, 4e-3, spacing="log"),
    studies.parameter("charge", "tissue.fixed_charge_density", "0.05 mEq/ml", "0.4 mEq/ml"),
    studies.parameter("bath", ["bath.concentration", "phase.unloading.bath_concentration"], "0.05 M", "0.3 M"),
    studies.parameter("load", "phase.loading.piston.pressure", 0.05, 0.5, protocols="compression"),
    studies.parameter("step", "phase.loading.bath_concentration", "0.05 M", "0.3 M", protocols="swelling"),
]


def random_study(seed: int, scheme: str = "backward-euler", **changes):
    design = [{"name": "spread", "kind": "combinations", "sampling": "random", "count": 5, "seed": seed}]
    time = {} if scheme == "backward-euler" else {"time": {"scheme": scheme, "tolerance": 1e-4}}
    protocols = [studies.protocol(**time), studies.protocol("swelling", "free_swelling.toml", **time)]
    return studies.study(protocol=protocols, parameter=RANDOM, design=design, strain_curves=True, **changes)


@pytest.mark.parametrize("scheme", ["backward-euler", "esdirk43"])
def test_a_row_is_the_run_of_its_case_bit_for_bit(scheme):
    """The same durations, and the same strains where the run is asked for the samples."""
    study = random_study(20051, scheme=scheme)
    for batch in plan(study):
        result = run_batch(batch)
        assert set(result["run_status"]) == {"complete"}
        for row, run in list(enumerate(batch.runs))[1::3]:
            case = study.case(run)
            durations = phase_durations(case)
            assert list(result["phase_duration"][row]) == durations
            times = sample_times(durations, case.time.samples_per_phase)
            times[-1] = min(times[-1], math.fsum(durations))
            lengths = {f"phase.{phase.name}.duration": d for phase, d in zip(case.phase, durations, strict=True)}
            if scheme == "esdirk43":
                lengths |= {"output.times": times}
            for column, model in enumerate(batch.models):
                alone = fvswell.run(case.with_changes(lengths), model=model)
                strain = alone["global_strain"].values[1:].reshape(2, -1)
                np.testing.assert_array_equal(result["strain"][row, column], strain)
                np.testing.assert_array_equal(result["final_strain"][row, column], strain[:, -1])
                np.testing.assert_array_equal(result["equilibrium_strain"][row, column], alone["equilibrium_strain"])
                assert result["initial_height"][row, column] == alone["height"].values[0]


def test_fibres_and_osmotic_laws_in_a_study():
    """Amounts of fibres by their dotted keys, beside the activity law: a row is the run of its case."""
    fibres = [{"directions": "isotropic", "modulus": 0.5}, {"directions": "along", "angle": 90, "modulus": 0.5}]
    protocol = studies.protocol(
        tissue__osmotic="activity",
        tissue__fibres=fibres,
        phase__loading__duration=300.0,
        phase__unloading__duration=300.0,
    )
    varied = studies.parameter("amount", ["tissue.fibres.0.modulus", "tissue.fibres.1.modulus"], 0.1, "1 MPa")
    design = [{"name": "range", "kind": "grid", "counts": {"amount": 3}}]
    study = studies.study(protocol=[protocol], parameter=[varied], design=design, strain_curves=True)
    (batch,) = plan(study)
    result = run_batch(batch)
    assert set(result["run_status"]) == {"complete"}
    heights = result["initial_height"][:, 1]
    assert np.all(np.diff(heights) < 0.0)  # more fibres, less swelling
    for row, run in enumerate(batch.runs):
        case = study.case(run)
        assert [family.modulus for family in case.tissue.fibres] == [0.1 + 0.45 * row] * 2
        alone = fvswell.run(case, model="electrochemical")
        np.testing.assert_array_equal(result["final_strain"][row, 1, 1], alone["global_strain"].values[-1])


def test_a_row_does_not_depend_on_its_batch(monkeypatch):
    study = random_study(3)
    whole = [run_batch(batch) for batch in plan(study)]
    monkeypatch.setattr("fvswell.study.batches.LARGEST_BATCH", 1)
    alone = [run_batch(batch) for batch in plan(study)]
    assert (len(whole), len(alone)) == (2, 10)
    for name in whole[0]:
        rows, alike = (chain.from_iterable(part[name] for part in parts) for parts in (whole, alone))
        for one, other in zip(rows, alike, strict=True):
            assert one.tobytes() == other.tobytes()


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


def test_a_row_that_fails_says_so_and_stops_no_other():
    """A piston that goes down in 5 s, faster than the water of the full model can leave."""
    down = {"ramp_to": -0.35, "over": 5.0}
    ramps = [studies.parameter("ramp", "phase.loading.piston.displacement.over", "5 s", "100 s")]
    protocol = studies.protocol(
        geometry__cells=6, phase__loading__duration="300 s", phase__unloading__duration="10 s",
        phase__loading__piston__displacement=down,
    )  # fmt: skip
    design = [{"name": "ramps", "kind": "one-at-a-time", "count": 2}]
    study = studies.study(protocol=[protocol], parameter=ramps, design=design, strain_curves=True)
    result = run_batch(plan(study)[0])
    failed, fine = result["run_status"]
    assert fine == "complete"
    assert failed.startswith("electrochemical: stopped at t = ")
    assert "s in phase loading: the " in failed
    assert np.isnan(result["r_squared"][0]).all()
    assert np.isfinite(result["strain"][0, 0]).all()  # the other model got through
    assert np.isfinite(result["r_squared"][1]).any()
    alone = fvswell.run(study.case(1), model="electrochemical")
    times = sample_times([300.0, 10.0], 8)
    own = alone["global_strain"].sel(time=times, method="nearest", tolerance=1e-9).values
    np.testing.assert_array_equal(result["strain"][1, 1].ravel(), own)


def test_a_row_whose_ramp_outlasts_its_phase_says_so():
    """Half the relaxation time of a permeable tissue is over before the ramp is."""
    slow = {"ramp_to": 0.1, "over": 2000.0}
    protocol = studies.protocol(phase__loading__duration="0.5 relaxation times", phase__loading__piston__pressure=slow)
    permeability = studies.parameter("permeability", "tissue.hydraulic_permeability", 1e-5, 1e-2)
    design = [{"name": "line", "kind": "one-at-a-time", "count": 2}]
    result = run_batch(plan(studies.study(protocol=[protocol], parameter=[permeability], design=design))[0])
    stiff, quick = result["run_status"]
    assert stiff == "complete"
    assert quick.startswith(
        "phase[loading].piston.pressure = {ramp_to = 0.1, over = 2000}: over: 2000 s is longer than"
    )
    assert np.isnan(result["r_squared"][1]).all()


def test_a_row_without_a_relaxation_time_says_so():
    """Nothing is done to a sample under no load, so it never relaxes."""
    loads = [studies.parameter("load", "phase.loading.piston.pressure", 0.0, 0.2)]
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


def test_thicker_samples_take_the_square_of_their_height():
    """In every model time goes with the square of the height: strains at equal fractions of a phase are equal."""
    design = [{"name": "heights", "kind": "one-at-a-time", "count": 2}]
    study = studies.study(
        protocol=[studies.protocol(geometry__cells=6)], parameter=[studies.HEIGHT], design=design, strain_curves=True
    )
    result = run_batch(plan(study)[0])
    (thin, thick), (short, long) = result["strain"], result["phase_duration"]
    np.testing.assert_allclose(thick, thin, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(long, short * (0.6 / 0.4) ** 2, rtol=1e-8)


def test_impossible_runs_are_in_no_batch():
    loads = studies.parameter("load", "phase.loading.piston.pressure", "0.1 MPa", "10 MPa")
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
