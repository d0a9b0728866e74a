"""What `fvswell advise` says of a case."""

from __future__ import annotations

import numpy as np

from fvswell.analysis.advice import Advice, PhaseAdvice
from fvswell.prediction.determination import NO_VARIATION
from fvswell.reporting.console import TextTable, percent

__all__ = ["advice_lines", "advice_tables"]


def advice_tables(advice: Advice) -> list[TextTable]:
    """What is predicted of the phases, and their times."""
    if not advice.phases:
        return []
    rows = [
        [
            phase.name,
            f"{phase.duration:.4g}",
            phase.quantity,
            _amount(phase, phase.equilibrium),
            _r_squared(phase),
            *_largest(phase),
        ]
        for phase in advice.phases
    ]
    header = ["phase", "duration (s)", "of", "equilibrium", "R^2", "largest error", "in share", "after (s)"]
    predicted = TextTable("Predicted error of biphasic-swelling, from electrochemical", header, rows)
    rows = [
        [phase.name, f"{phase.consolidation_time:.4g}", f"{phase.diffusion_time:.4g}", _direction(phase)]
        for phase in advice.phases
    ]
    header = ["phase", "fast (s)", "slow (s)", "first flow"]
    times = TextTable("Times h^2/d of the coupled diffusion of volume and salt, d its two diffusivities", header, rows)
    return [predicted, times]


def advice_lines(advice: Advice) -> list[str]:
    """Characteristic numbers, where the advice comes from, and the recommendation."""
    numbers = advice.characteristics
    low, high = numbers.open_circuit_ratio
    ratio = f"{low:.3f}" if high - low < 1e-9 else f"{low:.3f} to {high:.3f}"
    stronger = "more" if advice.salt_outdraws_osmosis else "less"
    lines = [
        f"open-circuit permeability at first: k_open/k = {ratio}",
        f"consolidation time h^2/(k H): {numbers.consolidation_time:.4g} s; "
        f"diffusion time of the salt h^2/D: {numbers.diffusion_time:.4g} s",
        f"at first, salt that diffuses drags water along {stronger} than osmosis draws it the other way",
    ]
    if not advice.uniform:
        lines.append("the tissue varies with depth: its mean properties stand for it in what is predicted")
    if advice.phases:
        lines.append(
            f"R^2 in brackets: nine of ten simulations lie there, by strain and kind of change in the study "
            f'"{advice.accuracy_source}"'
        )
        if advice.beyond:
            lines.append(
                f"which did not have {', '.join(advice.beyond)}: take the brackets as rough, and run fvswell compare"
            )
    else:
        lines.append(f"nothing is predicted: {advice.unpredictable}")
    return [*lines, "", f"recommended: {advice.model}", f"because {advice.reason}"]


def _r_squared(phase: PhaseAdvice) -> str:
    if np.isnan(phase.r_squared):
        return "-"
    low, high = phase.r_squared_range
    return f"{phase.r_squared:.4f} ({low:.4f} to {high:.4f})"


def _largest(phase: PhaseAdvice) -> list[str]:
    if np.isnan(phase.r_squared):
        return ["-", "-", "-"]
    share = "-" if np.isnan(phase.largest_share) else f"{100.0 * phase.largest_share:.2f} %"
    return [_amount(phase, phase.largest_difference), share, f"{phase.time_of_largest:.4g}"]


def _amount(phase: PhaseAdvice, value: float) -> str:
    """A strain or a pressure."""
    return percent(value) if phase.quantity == "strain" else f"{value if abs(value) > NO_VARIATION else 0.0:.4g} MPa"


def _direction(phase: PhaseAdvice) -> str:
    if np.isnan(phase.r_squared) or phase.quantity != "strain":
        return "-"
    return "against the change" if phase.flows_backward_first else "with the change"
