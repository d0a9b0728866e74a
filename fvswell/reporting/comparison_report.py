"""What the commands say of models beside each other: how far they are apart."""

from __future__ import annotations

import numpy as np

from fvswell.analysis.comparison import BlockDifference, ColumnDifference, Comparison
from fvswell.prediction.determination import NO_VARIATION
from fvswell.reporting.console import TextTable, percent
from fvswell.reporting.reports import words
from fvswell.results.fields import field

__all__ = ["comparison_remarks", "comparison_tables"]


def comparison_tables(comparison: Comparison) -> list[TextTable]:
    """Differences of the models in each phase, and their equilibria, or where they are at the last output."""
    return [_comparison_table(comparison, phase) for phase in comparison.phases]


def comparison_remarks(comparison: Comparison) -> list[str]:
    """What keeps models from being compared: phases with too few outputs, a probe that is held."""
    remarks = []
    if comparison.left_out:
        names = ", ".join(comparison.left_out)
        remarks.append(f"too few outputs to compare models in {names}: give more output times, or output.per_phase")
    base = comparison.results[comparison.reference]
    probes = {each.quantity for each in comparison.differences if each.quantity.startswith("probe_")}
    if any(np.ptp(base[quantity].values) <= NO_VARIATION for quantity in probes):
        remarks.append("the probe does not move: give another place for it, geometry.probe")
    return remarks


def _comparison_table(comparison: Comparison, phase: str) -> TextTable:
    differences = comparison.of_phase(phase)
    quantity = differences[0].quantity
    header = ["model", "R^2", "largest", "after (s)", "local", "of local"]
    rows, reference = [], ""
    for difference in differences:
        row = [
            difference.model,
            "-" if np.isnan(difference.r_squared) else f"{difference.r_squared:.5f}",
            _amount(difference.largest, quantity),
            f"{difference.time_in_phase:.4g}",
            percent(difference.local_strain),
            "-" if np.isnan(difference.local_strain_ratio) else f"{100.0 * difference.local_strain_ratio:.2f} %",
        ]
        if isinstance(difference, BlockDifference):
            places = ["at x, y (mm)", "last"]
            row += [f"{difference.x:.3g}, {difference.y:.3g}", _amount(difference.final, quantity)]
            reference = _amount(difference.reference_final, quantity)
        elif isinstance(difference, ColumnDifference):
            places = ["depth (mm)", "equilibrium"]
            row += [f"{difference.depth:.3g}", percent(difference.equilibrium_strain)]
            reference = percent(difference.reference_equilibrium_strain)
        rows.append(row)
    rows.append([f"{comparison.reference} (reference)", *["" for _ in header], reference])
    title = f"Phase {phase}: difference of the {words(quantity)} at {differences[0].times} times"
    return TextTable(title, header + places, rows)


def _amount(value: float, quantity: str) -> str:
    units = field(quantity).units
    return percent(value) if units == "1" else f"{value:+.4g} {'MPa' if units == 'N mm-2' else units}"
