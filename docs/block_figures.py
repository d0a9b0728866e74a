"""Figure of the undrained instant in docs/blocks.md: python docs/block_figures.py."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

import fvswell
from fvswell.results.moved_grid import moved_nodes, quadrilaterals

ROOT = Path(__file__).parent.parent


def main() -> None:
    """Draw the fluid pressure just after a sudden load, for shorter and shorter times."""
    case = fvswell.load_case(ROOT / "cases" / "plane_strain.toml")
    figure, axes = plt.subplots(1, 3, figsize=(7.1, 2.0), layout="constrained", sharey=True)
    for axis, share in zip(axes, (1e-2, 1e-4, 1e-6), strict=True):
        moment = share * 7.6e4  # of the consolidation time
        sudden = case.with_changes(
            {
                "phase.swelling.duration": 1.0,
                "phase.swelling.bath_concentration": case.bath.concentration,
                "phase.compression.duration": moment,
                "phase.compression.top": {"pressure": 0.1},
                "time": {"scheme": "backward-euler", "steps_per_phase": 1},
            }
        )
        result = fvswell.run(sudden, "biphasic")
        corners = moved_nodes(result, float(result["time"][-1]))[:, quadrilaterals(result)]
        cells = PolyCollection(corners.transpose(1, 2, 0), array=result["fluid_pressure"].values[-1], cmap="viridis")
        cells.set_clim(0.0, 0.1)
        axis.add_collection(cells)
        axis.autoscale()
        axis.set_aspect("equal")
        axis.set_title(f"{share:g} of consolidation", fontsize=8)
        axis.set_xlabel("x (mm)")
    axes[0].set_ylabel("y (mm)")
    figure.colorbar(cells, ax=axes, label="fluid pressure (MPa)")
    figure.savefig(ROOT / "docs" / "figures" / "undrained.png", dpi=200)


if __name__ == "__main__":
    main()
