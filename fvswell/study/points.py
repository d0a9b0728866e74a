"""A study seen as points, one for each phase of each run: which kind of change it was, and what came out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import xarray as xr

from fvswell.case.case import Case, CaseError
from fvswell.case.errors import Problem
from fvswell.errors import OutputError
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.solids import youngs_modulus
from fvswell.physics.tissue import Array
from fvswell.prediction.case_prediction import conditions_of, mean_tissue, predict_cases
from fvswell.prediction.conditions import kind_of_change
from fvswell.results.file import COMPLETE
from fvswell.study.study import Study

__all__ = ["CURVES", "PAPER_MODELS", "StudyPoints", "study_points"]

CURVES = (
    "compression, loading",
    "compression, unloading",
    "swelling",
)  # by kind_of_change
PAPER_MODELS = ("biphasic-swelling", "electrochemical")


@dataclass(frozen=True)
class StudyPoints:
    """Phases of complete runs in which either the load or the bath changes; arrays of shape ``(points,)``."""

    run: Array
    phase: Array  # index
    curve: Array  # index in CURVES
    applicability: Array  # f_c in compression and f_s in swelling, Wilson et al. (2005)
    mobility_ratio: Array  # D+ D-/(E k)^2
    strain: Array  # change of the global strain between equilibria, over the height at the phase's start
    r_squared: Array  # simulated
    batches: tuple[tuple[Array, tuple[Case, ...]], ...]  # of each protocol: numbers of complete runs and their cases

    def predicted(self, linearised_at: float | None = None) -> Array:
        """R^2 of the points by the predictor, as it is or linearised about a given state."""
        values = np.full((self.run.max() + 1, self.phase.max() + 1), np.nan)
        for runs, cases in self.batches:
            own = runs < len(values)
            values[runs[own]] = predict_cases(cases, linearised_at).r_squared[own, : values.shape[1]]
        return values[self.run, self.phase]

    def of_curve(self, name: str) -> Array:
        """Which points belong to a curve."""
        return self.curve == CURVES.index(name)

    @cached_property
    def curves(self) -> tuple[str, ...]:
        """Curves that have points."""
        return tuple(CURVES[index] for index in np.unique(self.curve))


def study_points(dataset: xr.Dataset) -> StudyPoints:
    """Points of the result of a study.

    Parameters
    ----------
    dataset
        Result of a study of the biphasic-swelling by the electrochemical model (`fvswell.study.file.read_study`).

    Raises
    ------
    CaseError
        If the study is of other models, or of cases that cannot be predicted.
    OutputError
        If no run is complete, or none is of a load or a bath that changes.
    """
    study = Study.from_toml(dataset.attrs["study_toml"], "study")
    if study.models != PAPER_MODELS:
        message = (
            f"must be a study of {PAPER_MODELS[0]} by {PAPER_MODELS[1]}, not of {study.models[0]} by {study.models[1]}"
        )
        raise CaseError([Problem("model", "", message)], "study")
    complete = dataset["run_status"].values == COMPLETE
    batches = []
    for protocol in range(len(study.cases)):
        runs = np.flatnonzero(complete & (study.runs.protocol == protocol))
        if len(runs):
            batches.append((runs, tuple(study.case(int(run)) for run in runs)))
    parts = [_points_of(dataset, runs, cases) for runs, cases in batches]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in (parts[0] if parts else {})}
    if not joined or not len(joined["run"]):
        raise OutputError("the study has no complete run with a phase in which the load or the bath changes")
    return StudyPoints(**joined, batches=tuple(batches))


def _points_of(dataset: xr.Dataset, runs: Array, cases: tuple[Case, ...]) -> dict[str, Array]:
    """Points of the runs of a protocol, by the names of `StudyPoints`."""
    conditions, tissue = conditions_of(cases), mean_tissue(cases)
    J = np.stack([equilibrium_volume_ratio(tissue, *each.ends) for each in conditions], axis=1)
    curve = np.stack([kind_of_change(*pair) for pair in pairwise(conditions)], axis=1)
    ratio = tissue.cation_diffusivity * tissue.anion_diffusivity
    ratio = ratio / (youngs_modulus(tissue.solid, tissue.fluid_fraction) * hydraulic_permeability(tissue, 1.0)) ** 2
    # the paper does not say in which state J is taken: here in equilibrium before the first phase
    compression = (ratio * J[:, 0])[:, None]
    swelling = compression * (tissue.fixed_charge_density / conditions[0].ends[1])[:, None]
    with np.errstate(divide="ignore"):  # without fixed charge there is no swelling: f_s is -inf
        number = np.log10(np.where(curve == CURVES.index("swelling"), swelling, compression))
    r_squared = dataset["r_squared"].values[runs]
    row, phase = np.nonzero((curve >= 0) & np.isfinite(r_squared) & np.isfinite(number))
    return {
        "run": runs[row],
        "phase": phase,
        "curve": curve[row, phase],
        "applicability": number[row, phase],
        "mobility_ratio": ratio[row],
        "strain": (J[:, 1:] / J[:, :-1] - 1.0)[row, phase],
        "r_squared": r_squared[row, phase],
    }
