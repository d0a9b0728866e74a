"""Make the figures of docs/verification.md and print the numbers in its table: python docs/verification_figures.py."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("agg")
import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import fvswell
from fvswell.case.case import Case
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array
from fvswell.simulation.column_run import ColumnRun

HERE = Path(__file__).parent
CASES, REFERENCE, FIGURES = (
    HERE.parent / "cases",
    HERE.parent / "tests" / "verification" / "reference",
    HERE / "figures",
)
COLOURS = {"biphasic": "C0", "biphasic-swelling": "C1", "electrochemical": "C2"}
DURATIONS = {"phase.loading.duration": 600.0, "phase.unloading.duration": 600.0}
OSMOTIC_ONE = {"tissue.osmotic_coefficient": 1.0, "bath.osmotic_coefficient": 1.0}
FULL = {"model": "electrochemical", "tissue.hindrance_factor": 0.0}
FEBIO: dict[str, tuple[str, str, dict[str, Any]]] = {
    "biphasic, 0.25 MPa": ("febio-biphasic-compression", "confined_compression", {"model": "biphasic"}),
    "electrochemical, 0.25 MPa": (
        "febio-triphasic-compression-phi-1", "confined_compression", FULL | OSMOTIC_ONE,
    ),
    "electrochemical, 0.15 to 0.1 M": ("febio-triphasic-swelling-phi-0.83", "free_swelling", FULL),
}  # fmt: skip


def main() -> None:
    """Make all figures."""
    plt.rcParams.update({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3, "lines.linewidth": 1.3})
    plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False})
    FIGURES.mkdir(exist_ok=True)
    figures = {"febio": febio, "exact": exact, "orders": orders, "limits": limits}
    for name, make in figures.items():
        print(f"{name}:")
        figure = make()
        figure.savefig(FIGURES / f"verification_{name}.png", dpi=130)
        plt.close(figure)


def changed(file: str, changes: dict[str, Any]) -> Case:
    """A case of the project with changes."""
    return fvswell.load_case(CASES / f"{file}.toml").with_changes(changes)


def one_phase(loads: dict[str, Any], duration: float, changes: dict[str, Any]) -> Case:
    """Reference tissue under one step."""
    phase = {"name": "step", "duration": duration, "piston": {"pressure": 0.0}} | loads
    return changed("confined_compression", {"phase": [phase]} | changes)


def febio() -> plt.Figure:
    """Global strain over FEBio's, and what remains between them."""
    figure, axes = plt.subplots(2, 3, figsize=(10, 5), sharex=True, layout="constrained", height_ratios=(3, 2))
    for column, (title, (file, case_file, changes)) in enumerate(FEBIO.items()):
        times, theirs = np.loadtxt(REFERENCE / f"{file}.csv", delimiter=",", skiprows=1).T
        scale = np.abs(theirs).max()
        case = changed(case_file, DURATIONS | changes)
        same = fvswell.run(case.with_changes({"time": {"scheme": "backward-euler", "steps_per_phase": 300}}))
        converged = fvswell.run(
            case.with_changes({"time.scheme": "esdirk43", "time.tolerance": 1e-5, "output.times": times.tolist()})
        )
        ours, exact_time = (
            100 * run["global_strain"].sel(time=times, method="nearest").values for run in (same, converged)
        )
        top, bottom = axes[:, column]
        top.plot(times[::12], 100 * theirs[::12], "o", mfc="none", ms=4, color="0.4", label="FEBio")
        top.plot(np.append(0.0, times), np.append(0.0, exact_time), color="C2", label="fvswell, converged in time")
        top.set_title(title)
        gaps = {
            "theirs, less converged": 100 * theirs - exact_time,
            "our backward Euler at 2 s, less converged": ours - exact_time,
            "theirs, less our backward Euler at 2 s": 100 * theirs - ours,
        }
        for (label, gap), style in zip(gaps.items(), ("C3-", "k--", "C0-"), strict=True):
            bottom.plot(times, gap / scale, style, label=label, lw=1.6 if style == "C3-" else 1.1)
        bottom.set(xlabel="time, s", ylim=(-1.25, 1.25))
        late = (times % 600 >= 22) | (times % 600 == 0)
        numbers = [np.abs(gap).max() / scale for gap in (gaps["theirs, less our backward Euler at 2 s"],)]
        own = np.abs(gaps["theirs, less converged"]) / scale
        print(f"  {file}: same steps {numbers[0]:.4f} %, converged at 20 s {own[times % 600 == 20].max():.3f} %,"
              f" from 22 s on {own[late].max():.3f} %")  # fmt: skip
    axes[0, 0].set_ylabel("global strain, %")
    axes[1, 0].set_ylabel("difference, % of the\nlargest strain")
    entries = [each for axis in axes[:, 0] for each in zip(*axis.get_legend_handles_labels(), strict=True)]
    figure.legend(*zip(*entries, strict=True), loc="outside lower center", ncols=3)
    return figure


def linear_column(model: str) -> LinearColumn:
    """The reference column in equilibrium, linearised."""
    run = ColumnRun(changed("confined_compression", {}), MODELS[model])
    return LinearColumn.at_equilibrium(run.model, run.tissue, 0.5, 0.0, 1.5e-4)


def linear_response(model: str, key: str, rest: float, step: float, times: Array, **changes: Any) -> xr.Dataset:
    """Response to a step over its size, from two sizes so that the second-order part falls out."""
    control = {"time.scheme": "esdirk43", "time.tolerance": 5e-6, "output.times": times.tolist()}
    whole, half = (
        fvswell.run(one_phase({key: rest + share * step}, float(times[-1]), control | changes), model)[
            ["global_strain", "volume_ratio", "water_potential"]
        ]
        for share in (1.0, 0.5)
    )
    whole, half = whole - whole.isel(time=0), half - half.isel(time=0)
    return (4.0 * half - whole).sel(time=times, method="nearest") / step


STEPS = {
    "load": ("piston", 0.0, 2e-3, "delta_pressure", 1e-3, "load of 1 kPa"),
    "bath": ("bath_concentration", 1.5e-4, -1e-6, "delta_concentration", -1e-6, "bath weaker by 1 mM"),
}


def exact() -> plt.Figure:
    """Small steps of load and of bath over the exact linear solution: strain, and profiles of J."""
    figure, axes = plt.subplots(2, 2, figsize=(9, 6), layout="constrained")
    times = np.geomspace(1.0, 1500.0, 25)
    for row, (key, rest, step, argument, shown, title) in enumerate(STEPS.values()):
        strain, profiles = axes[row]
        for model, colour in COLOURS.items():
            if model == "biphasic" and row == 1:
                continue
            column, result = linear_column(model), linear_response(model, key, rest, step, times)
            fine = np.geomspace(1.0, 1500.0, 400)
            expected = column.global_strain(fine, **{argument: shown})[0]
            strain.semilogx(fine, 100 * expected, color=colour, lw=1, label=f"exact, {model}")
            ours = result["global_strain"].values * shown
            strain.semilogx(times, 100 * ours, "o", ms=3.5, color=colour)
            gap = np.abs(ours - column.global_strain(times, **{argument: shown})[0]).max() / np.abs(expected).max()
            print(f"  {model}, {title}: {100 * gap:.3f} % of the largest strain")
        for time, shade in zip((5.0, 30.0, 120.0, 500.0), (0.35, 0.55, 0.75, 0.95), strict=True):
            column = linear_column("electrochemical")
            result = linear_response("electrochemical", key, rest, step, np.array([time, 510.0]))
            position = np.linspace(0.0, column.current_height.item(), 200)
            J = column.profile(position, np.array([time]), **{argument: shown}).volume_ratio[0, 0]
            colour = plt.get_cmap("Greens")(shade)
            profiles.plot(position, 100 * J, color=colour, lw=1)
            cells = result["volume_ratio"].sel(time=time, method="nearest")
            centres = cells["x"] * column.volume_ratio.item()
            profiles.plot(centres[::3], 100 * shown * cells[::3], "o", ms=3, color=colour, label=f"{time:.0f} s")
        strain.set(ylabel=f"{title}\nglobal strain, %", xlabel="time, s")
        profiles.set(ylabel="change of J, %", xlabel="distance from the filter, mm")
        strain.legend(fontsize=8)
        profiles.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[0, 0].set_title("lines: exact; dots: fvswell, 50 cells")
    axes[0, 1].set_title("electrochemical, every third cell")
    return figure


def orders() -> plt.Figure:
    """Errors of the linear response over the number of cells, and of a nonlinear run over the length of the steps."""
    figure, (space, time) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    cells, times = np.array([6, 12, 24, 48]), np.array([20.0, 100.0, 400.0])
    for model, step in (("biphasic", "load"), ("electrochemical", "load"), ("electrochemical", "bath")):
        key, rest, size, argument, _, _ = STEPS[step]
        expected = linear_column(model).global_strain(times, **{argument: 1.0})[0]
        for grading, style in ((1.0, "o-"), (20.0, "s--")):
            error = []
            for n in cells:
                changes = {"geometry.cells": int(n), "geometry.grading": grading, "time.tolerance": 2e-6}
                ours = linear_response(model, key, rest, size, times, **changes)["global_strain"]
                error.append(np.abs(ours - expected).max() / np.abs(expected).max())
            order = np.log2(np.array(error[:-1]) / error[1:])
            print(f"  space, {model}, {step}, grading {grading:g}: orders {np.round(order, 2)}")
            colour = {"biphasic": "C0", "electrochemical": "C2"}[model] if step == "load" else "C4"
            label = f"{model}, {step}, {'even' if grading == 1 else 'graded'}"
            space.loglog(cells, error, style, ms=4, color=colour, label=label)
    space.loglog(cells, 2.5 * cells**-2.0, "k:", label="second order")
    space.set(xlabel="cells", ylabel="error of the strain, of the largest")
    space.xaxis.set_major_formatter(mpl.ticker.ScalarFormatter())
    space.xaxis.set_minor_formatter(mpl.ticker.NullFormatter())
    space.set_xticks(cells)
    _time_orders(time)
    for axis in (space, time):
        axis.legend(fontsize=7)
    return figure


def _time_orders(axis: plt.Axes) -> None:
    """Ramp of the load to 0.2 MPa in 300 s on 6 cells, against steps sixteen times shorter than the shortest shown."""
    ramp = {"piston": {"pressure": {"ramp_to": 0.2, "over": 300.0}}}
    grid = {"geometry.cells": 6, "geometry.grading": 1}
    counts = np.array([20, 40, 80, 160])

    def strain(model: str, time: dict[str, Any]) -> Array:
        changes = grid | {"output.times": [75.0, 150.0, 225.0, 300.0], "time": time}
        return fvswell.run(one_phase(ramp, 300.0, changes), model)["global_strain"].values

    for model, colour in (("biphasic", "C0"), ("electrochemical", "C2")):
        # a tolerance that never bites: steps as long as allowed
        reference = strain(model, {"scheme": "esdirk43", "tolerance": 0.99, "max_step": 300.0 / 2560})
        for scheme, style in (("backward-euler", "s--"), ("esdirk43", "o-")):
            error = []
            for n in counts:
                fixed = {"steps_per_phase": int(n)} if scheme == "backward-euler" else {
                    "tolerance": 0.99, "max_step": 300.0 / n}  # fmt: skip
                error.append(np.abs(strain(model, {"scheme": scheme} | fixed) - reference).max())
            error = np.array(error) / np.abs(reference).max()
            print(f"  time, {model}, {scheme}: orders {np.round(np.log2(error[:-1] / error[1:]), 2)}")
            axis.loglog(300.0 / counts, error, style, ms=4, color=colour, label=f"{model}, {scheme}")
    steps = 300.0 / counts
    axis.loglog(steps, 4e-4 * steps, "k:", label="first and fourth order")
    axis.loglog(steps, 4e-12 * steps**4, "k:")
    axis.set(xlabel="step, s", ylabel="error of the strain, of the largest")
    axis.xaxis.set_major_formatter(mpl.ticker.ScalarFormatter())
    axis.xaxis.set_minor_formatter(mpl.ticker.NullFormatter())
    axis.set_xticks([2, 4, 8, 16])


def limits() -> plt.Figure:
    """The full model as its ions get faster, and the balances of the reference compression."""
    figure, (fast, balances) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    speeds = 10.0 ** np.arange(0, 5)
    for file, style in (("confined_compression", "o-"), ("free_swelling", "s-")):
        gaps = []
        for up in speeds:
            case = changed(file, DURATIONS | {
                "geometry.cells": 25, "time.tolerance": 1e-7, "open_circuit_permeability": "state",
                "output.times": [5.0, 20.0, 100.0, 400.0, 605.0, 650.0, 900.0],
                "tissue.cation_diffusivity": 5e-4 * up, "tissue.anion_diffusivity": 8e-4 * up,
            })  # fmt: skip
            one, other = (
                fvswell.run(case, model)["volume_ratio"] for model in ("electrochemical", "biphasic-swelling")
            )
            gaps.append(float(np.abs(one - other).max()))
        print(f"  {file}, diffusivities up: {gaps}")
        fast.loglog(speeds, gaps, style, ms=4, label=file.replace("_", " "))
    fast.loglog(speeds, 3e-2 / speeds, "k:", label="in proportion to 1/D")
    fast.set(
        xlabel="diffusivities over the reference ones",
        ylabel="electrochemical less biphasic swelling,\nlargest difference of J",
    )
    for model, colour in COLOURS.items():
        result = fvswell.run(changed("confined_compression", DURATIONS | {"output.every": 1}), model)
        for balance, style in {"volume": "-", "anion": "--", "cation": "-.", "charge": ":"}.items():
            if f"{balance}_balance_error" in result:
                error = result[f"{balance}_balance_error"][1:]
                balances.semilogy(
                    error["time"], np.maximum(error, 1e-18), style, color=colour, lw=1, label=f"{model}, {balance}"
                )
                print(f"  {model}, {balance}: largest mismatch of a step {float(error.max()):.1e}")
    balances.axhline(1e-10, color="k", lw=0.8)
    balances.text(1190, 1.4e-10, "asserted", ha="right", va="bottom", fontsize=8)
    balances.set(xlabel="time, s", ylabel="mismatch of each step,\nof what crossed the boundary", ylim=(1e-18, 1e-8))
    fast.legend(fontsize=8)
    balances.legend(fontsize=7, ncols=2, loc="center right")
    return figure


if __name__ == "__main__":
    main()
