"""The laws of a case's tissue on one sheet, with the states that its protocol comes to."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from fvswell.analysis.tissue_curves import BATHS, TissueCurves, tissue_curves
from fvswell.case.case import Case
from fvswell.physics.osmotic import osmotic_pressure_difference
from fvswell.physics.tissue import Array
from fvswell.reporting.plots import PAGE_WIDTH, in_print_style, lines_in_order

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["show", "tissue_figure"]

_HEIGHT = 1.3 * PAGE_WIDTH
_TITLE_WIDTH = 90  # letters across the page
_MARK: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 4.5, "zorder": 6}
_SHADES = ("black", "0.45", "0.7", "white")
_BATH_LABEL = "salt concentration of the bath (M)"
_J_LABEL = "volume ratio $J$ (stretch along one axis)"
_LEAST_PRESSURE = 1e-3  # MPa
_ROOM = 0.45  # of a panel's height, for the legend below the curves


def show(case: Case) -> Figure:
    """The laws of the tissue of a case as curves on one sheet; the points where the case works are marked.

    Parameters
    ----------
    case
        To be looked at; nothing is run.

    Returns
    -------
    matplotlib.figure.Figure
        Shown by itself in a notebook; ``figure.savefig("tissue.pdf")`` writes it.
    """
    return tissue_figure(case, tissue_curves(case))


@in_print_style
def tissue_figure(case: Case, curves: TissueCurves) -> Figure:
    """The sheet of a case, from its curves."""
    figure = Figure(figsize=(PAGE_WIDTH, _HEIGHT), layout="constrained")
    panels = figure.subplots(3, 2)
    drawings = (_stress, _swelling, _permeability, _by_load, _by_bath, _partition)
    for letter, axes, draw in zip("abcdef", panels.flat, drawings, strict=True):
        axes.set_title(letter, loc="left", fontweight="bold")
        draw(axes, curves)
    names = [_state_text(curves, index) for index in range(len(curves.working_points))]
    handles = [panels[0, 0].plot([], [], **_marker(index))[0] for index in range(len(names))]
    varies = ", mean properties of a tissue that varies" if curves.varies else ""
    laws = f"{case.tissue.solid} solid, {case.tissue.osmotic} law of the ions{varies}"
    figure.suptitle(f"{fill(case.title, _TITLE_WIDTH)}\n{laws}", fontsize=9)
    figure.legend(handles, names, loc="outside lower center", ncols=2, title="states in equilibrium", title_fontsize=8)
    return figure


def _marker(index: int) -> dict[str, Any]:
    return _MARK | {"markerfacecolor": _SHADES[index % len(_SHADES)], "markeredgecolor": "black"}


def _state_text(curves: TissueCurves, index: int) -> str:
    point = curves.working_points[index]
    load = f", {point.pressure:g} MPa" if point.pressure else ", no load"
    return f"{point.name}: {1e3 * point.bath:g} M{load}, $J$ = {point.volume_ratio:.4f}"


def _mark(axes: Axes, curves: TissueCurves, x: Array, y: Array) -> None:
    for index in range(len(curves.working_points)):
        axes.plot(x[index], y[index], **_marker(index))


def _states(curves: TissueCurves) -> tuple[Array, Array, Array]:
    """J, pressures and baths of the working points."""
    numbers = [(point.volume_ratio, point.pressure, point.bath) for point in curves.working_points]
    J, pressure, bath = np.array(numbers).T
    return J, pressure, bath


def _draw(axes: Axes, x: Array, family: Mapping[float, Array], label: str, factor: float = 1.0) -> None:
    """A line for each member of a family of curves."""
    for (value, y), line in zip(family.items(), lines_in_order(map(str, family)).values(), strict=True):
        axes.plot(x, y, color=line.color, linestyle=line.style, label=label.format(factor * value))


def _show_at_least(axes: Axes, low: float, high: float) -> None:
    """Widen a panel in which nothing but rounding would be seen."""
    own_low, own_high = axes.get_ylim()
    if own_low > low and own_high < high:
        axes.set_ylim(low, high)


def _stress(axes: Axes, curves: TissueCurves) -> None:
    """Stress of the solid and its parts, of the ions, and of both together in the first bath."""
    J, points = curves.volume_ratio, curves.working_points
    fibres = curves.fibre_stress.get("y", np.zeros_like(J))
    solid, first = curves.ground_stress + fibres, points[0].bath
    name = "ground substance" if curves.fibre_stress else "solid"
    axes.plot(J, curves.ground_stress, color="black", label=name)
    for axis, stress in curves.fibre_stress.items():
        where = "" if len(curves.fibre_stress) == 1 else (" along the axis" if axis == "y" else " along $x$")
        axes.plot(J, stress, color="#009E73", linestyle="-" if axis == "y" else ":", label=f"fibres{where}")
    for (bath, pressure), line in zip(
        curves.swelling_pressure.items(), lines_in_order(map(str, curves.swelling_pressure)).values(), strict=True
    ):
        axes.plot(J, -pressure, color=line.color, linestyle="--", linewidth=0.9, label=f"ions, {1e3 * bath:g} M")
    total = solid - curves.swelling_pressure[first]
    axes.plot(J, total, color="black", linewidth=2.0, alpha=0.55, label=f"total, {1e3 * first:g} M")
    at, pressure, _ = _states(curves)
    _mark(axes, curves, at, -pressure)
    axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)
    shown = [total, curves.ground_stress, *(-each for each in curves.swelling_pressure.values())]
    low, high = (limit(list(map(limit, shown))) for limit in (np.nanmin, np.nanmax))  # stiff fibres may leave the panel
    axes.set_ylim(low - _ROOM * (high - low), high + 0.05 * (high - low))
    axes.set(xlabel=_J_LABEL, ylabel="stress, tension positive (MPa)")
    axes.legend(loc="lower right", ncols=2)


def _swelling(axes: Axes, curves: TissueCurves) -> None:
    _draw(axes, 1e3 * BATHS, curves.swelling_by_bath, "$J$ = {:.3f}")
    J, _, bath = _states(curves)
    _mark(axes, curves, 1e3 * bath, _at(curves, J, bath))
    axes.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)
    axes.set_xscale("log")
    axes.set(xlabel=_BATH_LABEL, ylabel=r"swelling pressure $\pi - \pi_\mathrm{bath}$ (MPa)")
    _show_at_least(axes, -_LEAST_PRESSURE, _LEAST_PRESSURE)
    axes.legend()


def _at(curves: TissueCurves, J: Array, bath: Array) -> Array:
    """Swelling pressure in the working points."""
    value: Array = np.broadcast_to(osmotic_pressure_difference(curves.tissue, J, bath), J.shape)
    return value


def _permeability(axes: Axes, curves: TissueCurves) -> None:
    J, exponent = curves.volume_ratio, int(np.floor(np.log10(np.nanmax(curves.permeability))))
    scale = 10.0**-exponent
    axes.plot(J, scale * curves.permeability, color="black", linewidth=1.6, label="$k$")
    open_circuit = {bath: scale * k for bath, k in curves.open_circuit_permeability.items()}
    _draw(axes, J, open_circuit, "$k_\\mathrm{{open}}$, {:g} M", 1e3)
    at, _, bath = _states(curves)
    values = [np.interp(x, J, open_circuit[b]) for x, b in zip(at, bath, strict=True)]
    _mark(axes, curves, at, np.array(values))
    axes.set_ylim(bottom=0.0)
    axes.set(xlabel=_J_LABEL, ylabel=f"permeability ($10^{{{exponent}}}$ mm$^4$/(N s))")
    axes.legend(loc="lower right")


def _by_load(axes: Axes, curves: TissueCurves) -> None:
    _draw(axes, curves.loads, curves.equilibrium_by_load, "{:g} M", 1e3)
    J, pressure, _ = _states(curves)
    _mark(axes, curves, pressure, J)
    axes.set(xlabel="pressure of the piston (MPa)", ylabel="$J$ in equilibrium")
    axes.legend(title="bath", title_fontsize=7)


def _by_bath(axes: Axes, curves: TissueCurves) -> None:
    _draw(axes, 1e3 * BATHS, curves.equilibrium_by_bath, "{:.3g} MPa")
    J, _, bath = _states(curves)
    _mark(axes, curves, 1e3 * bath, J)
    axes.set_xscale("log")
    axes.set(xlabel=_BATH_LABEL, ylabel="$J$ in equilibrium")
    axes.legend(title="pressure of the piston", title_fontsize=7)


def _partition(axes: Axes, curves: TissueCurves) -> None:
    first = curves.working_points[0]
    for ion, values, color in zip(("cation", "anion"), curves.partition, ("#D55E00", "#0072B2"), strict=True):
        axes.plot(1e3 * BATHS, values, color=color, linestyle="-" if ion == "cation" else "--", label=ion)
        y = np.exp(np.interp(np.log(first.bath), np.log(BATHS), np.log(values)))
        axes.plot(1e3 * first.bath, y, **_marker(0))
    axes.axhline(1.0, color="0.75", linewidth=0.6, zorder=0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set(xlabel=_BATH_LABEL, ylabel="ions in the tissue over the bath")
    _show_at_least(axes, 0.5, 2.0)
    axes.legend(title=f"$J$ = {first.volume_ratio:.3f}", title_fontsize=7)
