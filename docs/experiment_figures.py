"""Figures of the shipped cases in docs/experiments.md: python docs/experiment_figures.py [NAME...]."""

from __future__ import annotations

import sys
from pathlib import Path

import fvswell
from fvswell.analysis.comparison import compare
from fvswell.case.shipped import shipped_cases
from fvswell.reporting.block_plots import all_blocks, block_comparison_figure
from fvswell.reporting.case_figure import case_figure
from fvswell.reporting.plots import comparison_figure, save_figure
from fvswell.simulation.relaxation import phase_durations

FIGURES = Path(__file__).parent / "figures"
CASES = (
    "stress-relaxation", "isometric-bath-step", "indentation", "permeation", "electro-osmosis", "cyclic",
    "depth-dependent", "dose-response",
)  # fmt: skip


def main() -> None:
    """Draw each case before it is run, and its three models side by side."""
    for name in sys.argv[1:] or CASES:
        case = fvswell.load_case(shipped_cases()[name])
        save_figure(case_figure(case, phase_durations(case)), FIGURES / f"case_{name}.png")
        models = ["biphasic", "biphasic-swelling", "electrochemical"]
        comparison = compare(case, models)
        draw = block_comparison_figure if all_blocks(comparison.results) else comparison_figure
        save_figure(draw(comparison), FIGURES / f"models_{name}.png")
        for each in comparison.differences:
            print(f"{name}, {each.phase}, {each.model}: {each}")


if __name__ == "__main__":
    main()
