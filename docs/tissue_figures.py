"""Make the figures of docs/tissue-laws.md and print the numbers in it: python docs/tissue_figures.py."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import fvswell
from fvswell.physics.constants import GAS_CONSTANT
from fvswell.physics.osmotic import (
    ActivityCoefficients,
    ChargeDependentCoefficients,
    ConstantCoefficients,
    Ideal,
    bath_log_activity,
    bath_osmotic_pressure,
    ion_concentrations,
    osmotic_pressure,
)
from fvswell.physics.tissue import Array

FIGURES = Path(__file__).parent / "figures"
CASES = Path(__file__).parent.parent / "cases"
RT = 298.0 * GAS_CONSTANT
BATHS = np.geomspace(1.5e-5, 2e-3, 200)
MEASURED = (4e-4, 1.5e-4, 0.30)  # chondroitin sulphate, Ehrlich et al. (1998): c_F and bath in mmol/mm3, MPa
LINES = {"ideal": (":", "C7"), "constant": ("-.", "C1"), "charge-dependent": ("--", "C3"), "activity": ("-", "C0")}


def swelling_pressure(name: str, charge: float, bath: Array | float) -> Array:
    """Of tissue with this fixed charge density in a bath, by a law with the numbers of the paper, MPa."""
    law = {
        "ideal": Ideal(),
        "constant": ConstantCoefficients(0.83, 0.93),
        "charge-dependent": ChargeDependentCoefficients(500.0, charge, 0.93),
        "activity": ActivityCoefficients(),
    }[name]
    bath = np.asarray(bath)
    ions = ion_concentrations(law, charge, bath_log_activity(law, bath))
    value: Array = osmotic_pressure(law, RT, charge, *ions) - bath_osmotic_pressure(law, RT, bath)
    return value


def baths() -> Figure:
    """Swelling pressure over the bath by all four laws."""
    figure, panels = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained")
    for axes, charge in zip(panels, (2e-4, 4e-4), strict=True):
        for name, (style, colour) in LINES.items():
            axes.plot(1e3 * BATHS, swelling_pressure(name, charge, BATHS), linestyle=style, color=colour, label=name)
        axes.axhline(0.0, color="0.6", linewidth=0.7)
        axes.axvspan(0.05, 0.15, color="0.93", zorder=0)
        axes.set(xscale="log", xlabel="bath (M)", title=f"fixed charge {1e3 * charge:g} M")
        axes.set_ylim(-0.35, 1.05)
    panels[0].set_ylabel(r"swelling pressure $\pi - \pi_\mathrm{bath}$ (MPa)")
    charge, bath, pressure = MEASURED
    panels[1].plot(1e3 * bath, pressure, "ko", label="chondroitin sulphate, measured")
    panels[0].text(0.087, -0.31, "fitted", ha="center", fontsize=8, color="0.4")
    panels[1].legend(loc="upper right")
    for name in LINES:
        print(f"{name}: {swelling_pressure(name, charge, bath):.3f} MPa at {1e3 * charge:g} M in {1e3 * bath:g} M")
    return figure


def fibres() -> Figure:
    """Relaxation of a disc without fibres and with planar ones, after a ramp of 1 %."""
    figure, axes = plt.subplots(figsize=(5.6, 3.6), layout="constrained")
    base = fvswell.load_case(CASES / "unconfined_disc.toml")
    phases = [
        {"name": "ramp", "duration": 2.0, "top": {"displacement": {"ramp_to": -0.005, "over": 2.0}}},
        {"name": "hold", "duration": 6000.0},
    ]
    for modulus, colour in ((0.0, "C7"), (1.0, "C1"), (3.0, "C0")):
        family = [{"directions": "planar", "modulus": modulus}] if modulus else []
        changes = {
            "tissue.fibres": family, "tissue.poisson_ratio": 0.1, "model": "biphasic", "phase": phases,
            "output": {"per_phase": 60}, "geometry.cells": [40, 2],
        }  # fmt: skip
        result = fvswell.run(base.with_changes(changes))
        force, time = result["top_force"].values, result["time"].values
        ratio = force.max() / force[-1]
        label = f"planar fibres, xi {modulus:g} MPa" if modulus else "no fibres"
        axes.plot(time[1:], force[1:] / force[-1], color=colour, label=f"{label}: peak {ratio:.2f}")
        print(f"xi {modulus:g} MPa: peak over equilibrium {ratio:.3f}")
    axes.axhspan(6.5, 8.5, color="0.92", zorder=0)
    axes.text(0.055, 7.4, "measured cartilage", fontsize=8, color="0.4")
    axes.set(xscale="log", xlabel="time (s)", ylabel="force over that in equilibrium")
    axes.set(xlim=(0.04, 8000.0), ylim=(0.0, 9.0))
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 0.99))
    return figure


def main() -> None:
    """Make both."""
    plt.rcParams.update({"font.size": 9, "lines.linewidth": 1.5, "legend.frameon": False})
    plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False})
    for name, make in {"baths": baths, "fibres": fibres}.items():
        figure = make()
        figure.savefig(FIGURES / f"tissue_{name}.png", dpi=130)
        plt.close(figure)
    case = fvswell.load_case(CASES / "unconfined_disc.toml").with_changes(
        {"tissue.osmotic": "activity", "tissue.fibres": [{"directions": "isotropic", "modulus": 0.5}]}
    )
    fvswell.show(case).savefig(FIGURES / "tissue_sheet.png", dpi=110)


if __name__ == "__main__":
    main()
