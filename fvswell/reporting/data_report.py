"""What `fvswell data` shows: the columns of a data file, the stages of its drive, and a figure of both."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from fvswell.fitting.data_file import DataFile
from fvswell.fitting.starter import Recording
from fvswell.reporting.console import TextTable
from fvswell.reporting.plots import PAGE_WIDTH, handy_time, in_print_style

__all__ = ["about_lines", "column_table", "data_figure", "stage_table"]

_MOST_LINES = 12
_MOST_DRAWN = 5000


def about_lines(data: DataFile) -> list[str]:
    """What the file says of itself."""
    lines = [f"{data.source}: {len(data.lines)} rows"]
    told = [f"  {name}: {value}" for name, value in data.about.items() if value]
    more = [f"  and {len(told) - _MOST_LINES} more lines"] if len(told) > _MOST_LINES else []
    return lines + told[:_MOST_LINES] + more


def column_table(data: DataFile) -> TextTable:
    """The columns with their units and ranges."""
    rows = [
        [heading, data.units[heading] or "-", f"{values.min():.6g}", f"{values.max():.6g}"]
        for heading, values in data.columns.items()
    ]
    return TextTable("Columns", ["heading", "unit", "least", "largest"], rows)


def stage_table(recording: Recording) -> TextTable:
    """Ramps and holds, and what the response does in them."""
    response = recording.data.columns[recording.response]
    unit = recording.data.units[recording.drive]
    rows = []
    for number, stage in enumerate(recording.stages, start=1):
        own = response[(recording.seconds >= stage.start) & (recording.seconds <= stage.end)]
        peak = own[np.abs(own - own[0]).argmax()]
        rows.append(
            [f"{number} {stage.kind}", f"{stage.start:.5g}", f"{stage.duration:.5g}", f"{stage.before:.5g}",
             f"{stage.after:.5g}", f"{stage.rate:.3g}", f"{own[0]:.5g}", f"{peak:.5g}", f"{own[-1]:.5g}"]
        )  # fmt: skip
    header = ["stage", "start (s)", "lasts (s)", "from", "to", "rate (1/s)", "before", "farthest", "after"]
    title = f"Stages of {recording.drive}{f' ({unit})' if unit else ''}, and what {recording.response} does in them"
    return TextTable(title, header, rows)


@in_print_style
def data_figure(recording: Recording) -> Figure:
    """The response above the drive, with the stages shaded."""
    scale, unit = handy_time(float(recording.seconds[-1]))
    figure = Figure(figsize=(PAGE_WIDTH, 3.8), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    every = slice(None, None, max(len(recording.seconds) // _MOST_DRAWN, 1))
    for panel, heading, color in ((above, recording.response, "0.25"), (below, recording.drive, "#0072B2")):
        panel.plot(recording.seconds[every] * scale, recording.data.columns[heading][every], color=color, linewidth=0.9)
        panel.set_ylabel(heading)
        for stage in recording.stages:
            if stage.kind == "ramp":
                panel.axvspan(stage.start * scale, stage.end * scale, color="#56B4E9", alpha=0.25, linewidth=0.0)
    for stage in recording.stages:
        ends = np.array([stage.start, stage.end]) * scale
        below.plot(ends, [stage.before, stage.after], color="#D55E00", linewidth=0.8, marker="o", markersize=2.0)
    below.set_xlabel(f"time ({unit})")
    above.margins(x=0.01)
    figure.align_ylabels()
    return figure
