"""What Wilson, van Donkelaar & Huyghe (2005) report, beside what comes out here.

Our copy of the paper lost figures and some numbers; what is known of its results is listed here, and nothing was tuned
to meet it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from fvswell.analysis.comparison import ColumnDifference, Comparison
from fvswell.fitting.reduced_model import ReducedFit
from fvswell.paper.reproduction import PaperResults
from fvswell.physics.tissue import Array
from fvswell.reporting.console import percent
from fvswell.results.table import write_table
from fvswell.study.points import CURVES, PAPER_MODELS, StudyPoints

__all__ = ["Claim", "claims", "write_claims"]

_CLOSE = 0.1  # relative: as near as the paper's own numbers can be known
_PERMEABILITY_REDUCTION = 0.1196  # of the tissue's, by the paper's fit to its block
_REDUCED, _FULL = PAPER_MODELS


@dataclass(frozen=True)
class Claim:
    """Something that the paper reports."""

    subject: str
    paper: str
    here: str
    agrees: str  # yes, no, or partly


def claims(results: PaperResults) -> list[Claim]:
    """The paper's findings in the order of its figures, with ours."""
    return [*_of_equilibria(results), *_of_differences(results), *_of_sweep(results), *_of_block(results.block)]


def write_claims(path: Path, table: list[Claim]) -> None:
    """Write the findings as text with commas.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    write_table(path, [field.name for field in fields(Claim)], map(astuple, table))


def _of_equilibria(results: PaperResults) -> Iterator[Claim]:
    strains = {
        name: [(d.equilibrium_strain, d.reference_equilibrium_strain) for d in _differences(comparison, _REDUCED)]
        for name, comparison in (("compression", results.compression), ("swelling", results.swelling))
    }
    apart = max(abs(own - full) for pairs in strains.values() for own, full in pairs)
    yield Claim("strains in equilibrium of the two swelling models", "equal", f"{apart:.2g} apart", _yes(apart < 1e-6))
    biphasic = _differences(results.compression, "biphasic")[0]
    own, full = biphasic.equilibrium_strain, biphasic.reference_equilibrium_strain
    yield Claim(
        "compression in equilibrium, biphasic",
        "larger than with swelling",
        f"{percent(own)}, else {percent(full)}",
        _yes(own < full),
    )
    most = float(np.abs(results.swelling.results["biphasic"]["global_strain"]).max())
    yield Claim("swelling, biphasic", "none", f"{most:.2g}", _yes(most < 1e-9))


def _of_differences(results: PaperResults) -> Iterator[Claim]:
    """Where and when biphasic-swelling and electrochemical are farthest apart, and their R^2."""
    reported = ((results.compression, "compression", 144.0, 0.39), (results.swelling, "swelling", 149.0, 0.30))
    for comparison, name, time, local in reported:
        both = _differences(comparison, _REDUCED)
        ends = comparison.results[_FULL]["phase_end"].values
        shares = [d.time_in_phase / length for d, length in zip(both, np.diff(ends, prepend=0.0), strict=True)]
        found = " and ".join(f"{100.0 * share:.0f} %" for share in shares)
        yield Claim(
            f"{name}: errors are largest",
            "right after each change",
            f"at {found} of the phases",
            _yes(max(shares) < 0.33),
        )
        yield Claim(
            f"{name}: time of the largest global error", f"{time:.0f} s",
            " and ".join(f"{d.time_in_phase:.0f} s" for d in both) + " after the change",
            _agreement([_close(d.time_in_phase, time) for d in both]),
        )  # fmt: skip
        yield Claim(
            f"{name}: local strain error then, up to", f"{100.0 * local:.0f} %",
            " and ".join(f"{100.0 * d.local_strain_ratio:.0f} %" for d in both) + " of the local strain",
            _agreement([_close(d.local_strain_ratio, local) for d in both]),
        )  # fmt: skip
        height = float(comparison.results[_FULL]["x_node"][-1])
        yield Claim(
            f"{name}: where", "at the wall", " and ".join(f"x/h = {d.depth / height:.2f}" for d in both),
            _agreement([d.depth > 0.9 * height for d in both]),
        )  # fmt: skip
    yield from _of_r_squared(results)


def _of_r_squared(results: PaperResults) -> Iterator[Claim]:
    points = results.points
    loading, unloading = (d.r_squared for d in _differences(results.compression, _REDUCED))
    above = float(np.mean(np.greater(*_by_run(points, points.curve != CURVES.index("swelling"))[::-1])))
    yield Claim(
        "compression: R^2", "unloading above loading",
        f"{loading:.4f} and {unloading:.4f}; above in {100.0 * above:.0f} % of the sweep", _yes(unloading > loading),
    )  # fmt: skip
    loading, unloading = (d.r_squared for d in _differences(results.swelling, _REDUCED))
    first, second = _by_run(points, points.of_curve("swelling"))
    typical = float(np.median(np.abs(second - first)))
    yield Claim(
        "swelling: R^2", "loading and unloading alike",
        f"{loading:.3f} and {unloading:.3f}; sweep's medians {np.median(first):.2f} and {np.median(second):.2f}, "
        f"typically {typical:.2f} apart", _yes(typical < 0.1),
    )  # fmt: skip


def _of_sweep(results: PaperResults) -> Iterator[Claim]:
    points = results.points
    compressed = -points.strain[points.of_curve("compression, loading") & (points.phase == 0)]
    swollen = points.strain[points.of_curve("swelling") & (points.phase == 0)]
    for name, strain, low, high in (("compression", compressed, 0.04, 0.40), ("swelling", swollen, -0.30, 0.07)):
        least, most = float(strain.min()), float(strain.max())
        yield Claim(
            f"sweep: strains in equilibrium in {name}", f"{100.0 * low:.0f} to {100.0 * high:.0f} %",
            f"{100.0 * least:.0f} to {100.0 * most:.0f} %", _agreement([_close(least, low), _close(most, high)]),
        )  # fmt: skip
    for curve, fit in results.fits.items():
        yield Claim(
            f"R^2 = 1 - a exp(-b f), {curve}", "a, b illegible",
            f"a = {fit.a:.3g}, b = {fit.b:.3g}, explains {100.0 * fit.explained:.0f} % of the variance", "-",
        )  # fmt: skip


def _of_block(fitted: ReducedFit) -> Iterator[Claim]:
    (quantity,) = fitted.quantities
    swelling = fitted.reference_result.sel(time=slice(fitted.reference_result["phase_end"].values[0]))
    probe, volume_ratio = swelling[quantity].values, swelling["volume_ratio"].values
    back = float((probe[0] - probe.min()) / np.ptp(probe))
    lost = float(1.0 - (volume_ratio / volume_ratio[0]).min())
    yield Claim(
        "2D: shrinks before it swells", "in the full model",
        f"the corner goes back by {100.0 * back:.2g} % of its way, cells lose {100.0 * lost:.2g} % of volume at most",
        _agreement([back > 1e-4, lost > 1e-4]),
    )  # fmt: skip
    reported = 1.0 - _PERMEABILITY_REDUCTION
    yield Claim(
        "2D: best permeability, over the tissue's", f"{reported:.4f}",
        f"{fitted.ratio:.3f} in {fitted.problem.phases[0]}", _agreement([_close(fitted.ratio, reported)]),
    )  # fmt: skip
    (before,), (after,) = fitted.before, fitted.after
    yield Claim("2D: R^2 with it", "better", f"{after:.5f}, else {before:.5f}", _yes(after > before))


def _differences(comparison: Comparison, model: str) -> list[ColumnDifference]:
    """Differences of a model from the reference, phase by phase."""
    return [d for d in comparison.differences if isinstance(d, ColumnDifference) and d.model == model]


def _by_run(points: StudyPoints, chosen: Array) -> tuple[Array, Array]:
    """R^2 of loading and unloading in the runs that have both among some points."""
    first, second = (
        dict(zip(points.run[own], points.r_squared[own], strict=True))
        for own in (chosen & (points.phase == 0), chosen & (points.phase == 1))
    )
    runs = [run for run in first if run in second]
    return np.array([first[run] for run in runs]), np.array([second[run] for run in runs])


def _close(value: float, reported: float) -> bool:
    return abs(value - reported) <= _CLOSE * abs(reported)


def _yes(true: bool | np.bool_) -> str:
    return "yes" if true else "no"


def _agreement(parts: list[bool]) -> str:
    return "yes" if all(parts) else "partly" if any(parts) else "no"
