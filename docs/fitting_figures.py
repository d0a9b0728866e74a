"""Draws the figures of docs/fitting.md: a fit to a synthetic relaxation, and a plan of relaxations.

Run it in the clone: python docs/fitting_figures.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import fvswell
from fvswell.fitting.candidates import candidate_problems, varied_cases
from fvswell.fitting.measurement import Measurement
from fvswell.fitting.parameters import Parameter, Parameters
from fvswell.fitting.planning import plan
from fvswell.fitting.problem import FitProblem
from fvswell.fitting.schema import ParameterTable
from fvswell.fitting.simulated import Experiment
from fvswell.reporting.fit_figures import fit_figures
from fvswell.reporting.plan_report import plan_figure
from fvswell.reporting.plots import save_figure

FIGURES = Path(__file__).parent / "figures"
CASE = Path(__file__).parents[1] / "cases" / "stress_relaxation.toml"
SOUGHT = {"youngs_modulus": (0.3, 0.1, 2.0), "hydraulic_permeability": (2e-3, 1e-4, 1e-2),
          "fixed_charge_density": (1.5e-4, 5e-5, 6e-4)}  # fmt: skip
NOISE = 1e-3  # MPa


def relaxation() -> FitProblem:
    """The case's own curve with noise, and three properties to find from elsewhere."""
    case = fvswell.load_case(CASE)
    times = np.concatenate([np.linspace(10.0, 1500.0, 150), np.linspace(1600.0, 7600.0, 61)])
    values = Experiment.of(case, ["piston_pressure"], times).histories({})[0]
    noisy = values + NOISE * np.random.default_rng(1).standard_normal(len(times))
    measurement = Measurement("relaxation", case, "piston_pressure", times, noisy)
    parameters = [Parameter(name, (f"tissue.{name}",), *numbers, True) for name, numbers in SOUGHT.items()]
    return FitProblem([measurement], Parameters(parameters), title="Synthetic relaxation")


def main() -> None:
    """Draw all figures."""
    figures = fit_figures(fvswell.fit(relaxation()))
    for name in ("fit_curves", "fit_profiles"):
        save_figure(figures[name], FIGURES / f"{name}.png")
    baths = ("bath.concentration", ["0.05 M", "0.15 M", "1 M"])
    strains = ("phase.ramp.piston.displacement.ramp_to", ["-0.05 mm", "-0.1 mm", "-0.2 mm"])
    cases = varied_cases({"relaxation": fvswell.load_case(CASE)}, [baths, strains])
    tables = [ParameterTable.model_validate({"name": name, "key": f"tissue.{name}"}) for name in SOUGHT]
    planned = candidate_problems(cases, tables, ["piston_pressure"], [f"{1e3 * NOISE:g} kPa"], None, 0.9)
    save_figure(plan_figure(plan(planned)), FIGURES / "plan.png")


if __name__ == "__main__":
    main()
