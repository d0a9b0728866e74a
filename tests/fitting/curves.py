"""Small problems for the tests: coarse columns, whose runs take a few milliseconds, and curves made of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fvswell.case.case import Case, load_case
from fvswell.fitting.measurement import Measurement
from fvswell.fitting.parameters import Parameter, Parameters
from fvswell.fitting.problem import FitProblem, Settings
from fvswell.fitting.simulated import Experiment
from fvswell.physics.tissue import Array

CASES = Path(__file__).parents[2] / "cases"
_COARSE = {"geometry.cells": 8, "geometry.grading": 5, "time.tolerance": 1e-3}
TIMES = np.concatenate([np.linspace(2.0, 60.0, 25), np.linspace(70.0, 400.0, 25)])
TRUTH = {"youngs_modulus": 0.5, "hydraulic_permeability": 1e-3, "fixed_charge_density": 2e-4}


def case(phase: dict[str, Any], **changes: Any) -> Case:
    """Reference tissue in a coarse column under one phase of 400 s; keys of the changes have ``__`` for dots."""
    own = {key.replace("__", "."): value for key, value in changes.items()}
    whole = {"phase": [{"name": "only", "duration": 400.0, **phase}]}
    return load_case(CASES / "confined_compression.toml").with_changes(_COARSE | whole | own)


def relaxation(**changes: Any) -> Case:
    """A ramp of the piston, held."""
    return case({"piston": {"displacement": {"ramp_to": -0.05, "over": 40.0}}}, **changes)


def creep(**changes: Any) -> Case:
    """A step of pressure."""
    return case({"piston": {"pressure": 0.1}}, **changes)


def swelling(**changes: Any) -> Case:
    """A step of the bath."""
    return case({"bath_concentration": 5e-5}, **changes)


def sought(*names: str, start: float = 1.5, **more: Any) -> Parameters:
    """Properties of the tissue, starting at so many times their true values."""
    return Parameters(
        [
            Parameter(n, (f"tissue.{n}",), start * TRUTH[n], TRUTH[n] / 10.0, TRUTH[n] * 10.0, True, **more)
            for n in names
        ]
    )


def measured(
    of: Case, quantity: str, noise: float = 0.0, seed: int = 0, name: str = "curve", times: Array = TIMES, **more: Any
) -> Measurement:
    """A curve of a case, with noise of a part of its range."""
    values = Experiment.of(of, [quantity], times).histories({})[0]
    level = noise * float(np.ptp(values))
    noisy = values + level * np.random.default_rng(seed).standard_normal(len(times))
    return Measurement(name, of, quantity, times, noisy, **more)


def problem(
    measurements: Sequence[Measurement], parameters: Parameters, starts: int = 1, confidence: float = 0.9
) -> FitProblem:
    """A problem with one search."""
    return FitProblem(measurements, parameters, Settings(starts=starts, confidence=confidence))
