"""Whether the biphasic-swelling model will do for a case: predicted at once, without running either model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fvswell.analysis.characteristics import Characteristics, characteristics
from fvswell.analysis.prediction_accuracy import Accuracy, known_accuracy
from fvswell.case.case import Case, CaseError
from fvswell.case.geometry import ColumnGeometry
from fvswell.exact.linear_swelling import salt_outdraws_osmosis
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import BIPHASIC_SWELLING, ELECTROCHEMICAL
from fvswell.physics.osmotic import bath_log_activity
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.tissue import Array, Tissue
from fvswell.prediction.case_prediction import (
    conditions_of,
    is_uniform,
    mean_tissue,
    predict_cases,
    stress_free_heights,
    unpredictable,
)
from fvswell.prediction.conditions import course_of, kind_of_change
from fvswell.prediction.predictor import Prediction
from fvswell.study.points import CURVES

__all__ = ["ADEQUATE", "GOOD", "Advice", "PhaseAdvice", "advise"]

GOOD = 0.99  # R^2 from which the reduced model is taken to be as good
ADEQUATE = 0.9  # from which it follows the course of the strain
_SLOWEST_MODE = 0.25 * np.pi**2  # its decay in one diffusion time, of a column drained at one end
_EQUILIBRATED = 0.05  # of a change still to come


@dataclass(frozen=True)
class PhaseAdvice:
    """What is predicted of a phase; strains relative to the sample equilibrated in the first bath."""

    name: str
    quantity: str  # "strain", or "pressure" of a piston that is held, MPa: what the models are compared by
    change: str  # of load or bath, one of fvswell.study.points.CURVES; "" for any other
    other_bath: bool  # whether the bath changes
    duration: float  # s
    equilibrium: float  # of the quantity, that both models come to
    r_squared: float  # of the biphasic-swelling by the electrochemical model
    r_squared_range: tuple[float, float]  # in which nine of ten simulated ones lie around such a prediction
    largest_difference: float  # of the quantity, biphasic-swelling less electrochemical
    largest_share: float  # the same over the quantity's change between equilibria, or its range if it is held or turns
    time_of_largest: float  # s since the phase began
    consolidation_time: float  # h^2 over the larger diffusivity of volume and salt together, s
    diffusion_time: float  # h^2 over the smaller one, s
    flows_backward_first: bool  # negative osmosis: water first flows against the phase's change of volume


@dataclass(frozen=True)
class Advice:
    """What to expect of a case, and which model to use."""

    characteristics: Characteristics
    phases: tuple[PhaseAdvice, ...]  # none where the case cannot be predicted
    unpredictable: str  # why it cannot, or ""
    uniform: bool  # else mean properties stand for a tissue that varies
    salt_outdraws_osmosis: bool  # whether salt moves water toward the weaker solution, in the first equilibrium
    accuracy_source: str
    beyond: tuple[str, ...]  # what sets the case apart from those that the accuracy is known of
    model: str  # recommended
    reason: str


def advise(case: Case) -> Advice:
    """Predict how well the biphasic-swelling model stands in for the electrochemical one.

    Raises
    ------
    CaseError
        If the case is not of a column.
    """
    problems = unpredictable(case)
    if not isinstance(case.geometry, ColumnGeometry):
        raise CaseError(problems, case.source)
    accuracy = known_accuracy()
    if problems:
        phases: tuple[PhaseAdvice, ...] = ()
        model = ELECTROCHEMICAL.name
        reason = "how far biphasic-swelling is from it cannot be predicted here: fvswell compare runs both"
    else:
        phases = _phases(case, predict_cases([case]), accuracy)
        model, reason = _recommendation(phases)
        if _has_current(case):
            model, reason = ELECTROCHEMICAL.name, "only it has ions that carry an electric current"
    return Advice(
        characteristics=characteristics(case),
        phases=phases,
        unpredictable="; ".join(map(str, problems)),
        uniform=is_uniform(case),
        salt_outdraws_osmosis=bool(salt_outdraws_osmosis(*_first_equilibrium(case)).item()),
        accuracy_source=accuracy.source,
        beyond=tuple(_beyond(case, phases)),
        model=model,
        reason=reason,
    )


def _phases(case: Case, prediction: Prediction, accuracy: Accuracy) -> tuple[PhaseAdvice, ...]:
    conditions = conditions_of([case])
    kinds = [kind_of_change(*change).item() for change in pairwise(conditions)]
    strains = np.append(0.0, prediction.equilibrium_strain[0])
    height = float(stress_free_heights([case]).item()) * _initial_stretch(case)
    advice = []
    for p, (phase, kind) in enumerate(zip(case.phase, kinds, strict=True)):
        r_squared, measured = float(prediction.r_squared[0, p]), prediction.measured[p]
        change = float(strains[p + 1] - strains[p])
        expected = accuracy.expected(CURVES[kind] if kind >= 0 else None, change / (1.0 + float(strains[p])))
        factor = expected.ninth_decile_factor
        largest = float(prediction.largest_difference[0, p])
        whole = abs(change) if kind >= 0 else float(np.ptp(prediction.full[0, p]))
        fast, slow = np.sort(np.abs(prediction.diffusivities[0, p]))[::-1]
        equilibria = prediction.equilibrium_strain if measured == "strain" else prediction.equilibrium_pressure
        (before,), (after,) = (each.ends[1] for each in conditions[p : p + 2])
        advice.append(
            PhaseAdvice(
                name=phase.name,
                quantity=measured,
                change=CURVES[kind] if kind >= 0 else "",
                other_bath=bool(before != after),
                duration=float(prediction.phase_duration[0, p]),
                equilibrium=float(equilibria[0, p]),
                r_squared=r_squared,
                r_squared_range=(1.0 - (1.0 - r_squared) * factor, 1.0 - (1.0 - r_squared) / factor),
                largest_difference=largest,
                largest_share=abs(largest) / whole if whole else np.nan,
                time_of_largest=float(prediction.time_of_largest_difference[0, p]),
                consolidation_time=float(height**2 / fast),
                diffusion_time=float(height**2 / slow),
                flows_backward_first=bool(prediction.flows_backward_first[0, p]),
            )
        )
    return tuple(advice)


def _beyond(case: Case, phases: Sequence[PhaseAdvice]) -> Iterator[str]:
    """What sets a case apart from the study: uniform tissue of the paper's laws, changed in equilibrium."""
    if not is_uniform(case):
        yield "a tissue that varies with depth"
    if case.tissue.solid != "neo-hookean":
        yield f"a {case.tissue.solid} solid"
    if case.tissue.fibres:
        yield "fibres"
    if case.tissue.osmotic not in ("constant", "charge-dependent"):
        yield f"the {case.tissue.osmotic} osmotic law"
    if np.ptp(hydraulic_permeability(mean_tissue([case]), np.array([0.9, 1.0, 1.1]))) > 0.0:
        yield "a permeability that varies with strain"
    if any(np.exp(-_SLOWEST_MODE * phase.duration / phase.diffusion_time) > _EQUILIBRATED for phase in phases[:-1]):
        yield "a change before the last one is over"
    if any(phase.quantity == "pressure" for phase in phases):
        yield "a piston that is held"
    if _has_current(case):
        yield "an electric current"
    if _turns(case):
        yield "a load that turns on its way"
    elif not _has_current(case) and any(
        not phase.change and phase.quantity == "strain" and not np.isnan(phase.r_squared) for phase in phases
    ):
        yield "load and bath changed at once"


def _has_current(case: Case) -> bool:
    """Whether a current passes in any phase."""
    return any(course_of(each.current).acts for each in conditions_of([case]))


def _turns(case: Case) -> bool:
    """Whether any load comes back on its way in a phase."""
    phases = pairwise(conditions_of([case]))
    return any(after.turns(before) for before, after in phases)


def _first_equilibrium(case: Case) -> tuple[Tissue, Array, Array]:
    """The tissue, by its mean properties, and J and ln a~ in equilibrium with the first bath, ``(1,)``."""
    tissue, bath = mean_tissue([case]), np.array([case.bath.concentration])
    return tissue, equilibrium_volume_ratio(tissue, 0.0, bath), bath_log_activity(tissue.osmotic, bath)


def _initial_stretch(case: Case) -> float:
    return float(_first_equilibrium(case)[1].item())


def _recommendation(phases: Sequence[PhaseAdvice]) -> tuple[str, str]:
    """Which model to use, and why."""
    judged = [phase for phase in phases if not np.isnan(phase.r_squared)]
    if not judged:
        return BIPHASIC_SWELLING.name, "nothing changes in any phase, so the models agree"
    worst = min(judged, key=lambda phase: phase.r_squared_range[0])
    backward = [phase.name for phase in judged if phase.flows_backward_first]
    error = f"largest error {_percent(worst.largest_share)} of the {worst.quantity}"
    found = f"{worst.name}: R^2 about {worst.r_squared:.3g}, {error}"
    if worst.r_squared_range[0] >= GOOD:
        return BIPHASIC_SWELLING.name, f"it follows the full model closely even where it is worst ({found})"
    if worst.r_squared_range[0] >= ADEQUATE:
        return BIPHASIC_SWELLING.name, (
            f"it follows the course of the {worst.quantity}, with visible errors after each change ({found}); use "
            "electrochemical where these or the ions matter"
        )
    return ELECTROCHEMICAL.name, "; ".join(
        [f"the biphasic-swelling model may fail ({found})", _cause(worst), *_backward(backward)]
    )


def _percent(share: float) -> str:
    """In two digits, and whole numbers from 10 on."""
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"


def _cause(phase: PhaseAdvice) -> str:
    times = f"in about {phase.diffusion_time:.3g} s, while the tissue consolidates in {phase.consolidation_time:.3g} s"
    if phase.other_bath:
        return f"it lets the salt follow the bath at once, but salt diffuses {times}"
    return (
        f"it keeps the ions in equilibrium with the bath, but salt that the water carries along diffuses back {times}"
    )


def _backward(phases: Sequence[str]) -> list[str]:
    if not phases:
        return []
    return [f"the first flow goes against the final change in {', '.join(phases)}, which only it can show"]
