"""Writes relaxation.mach1.txt: a file as a Mach-1 tester writes it, of two ramps with holds, its numbers made up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

_HEAD = """<Mach-1 File>
<INFO>
Date:\tMon, Jan 01, 2024
Mach-1 System Model:\tmade up
<END INFO>
<Stress Relaxation>
Stage Axis:\tPosition (z)
Load Cell Axis:\tFz
Amplitude, mm:\t0.0400
Velocity, mm/s:\t0.0020
Number of Ramp:\t2
<DATA>
Time, s\tPosition (z), mm\tFx, N\tFz, N
"""


def text() -> str:
    """The file."""
    lines = []
    for ramp in range(2):
        for since in np.arange(0.0, 120.0, 1.0):
            position = 0.5 + 0.04 * (ramp + min(since / 20.0, 1.0))
            relaxing = np.exp(-max(since - 20.0, 0.0) / 15.0)
            force = -0.2 - 0.1 * ramp - 0.1 * min(since / 20.0, 1.0) - 0.5 * min(since / 20.0, 1.0) * relaxing
            lines.append(f"{120.0 * ramp + since:.6f}\t{position:.6f}\t0.001000\t{force:.6f}\n")
        lines.append("<divider>\n")
    return _HEAD + "".join(lines) + "<END DATA>\n"


if __name__ == "__main__":
    Path(__file__).with_name("relaxation.mach1.txt").write_text(text(), encoding="utf-8")
