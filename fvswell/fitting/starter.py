"""A case and a fit file to begin with, from a data file: what was done gives phases, what was measured the curve."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources

import numpy as np

from fvswell.case.errors import CaseError, Problem, shown
from fvswell.fitting.data_file import DataFile, split_heading
from fvswell.fitting.stages import Stage, Step, corners, recognised, steps_of
from fvswell.physics.tissue import Array
from fvswell.units import QuantityError, parse

__all__ = ["Recording", "recording_of", "starter_case", "starter_fit"]

_DRIVES = ("position (z)", "position", "displacement", "piston", "strain", "gap", "height")
_RESPONSES = ("fz", "force", "load", "pressure", "stress", "strain")
_THICKNESS, _RADIUS = 1.0, 1.5  # mm, where they are not given


@dataclass(frozen=True)
class Recording:
    """The columns of a data file that say what was done and what came of it.

    Parameters
    ----------
    data
        The file.
    time, drive, response
        Headings of the columns.
    seconds
        Times, s, shape (rows,).
    stages
        Ramps and holds of the drive, in its own unit; none if it is no row of them.
    """

    data: DataFile
    time: str
    drive: str
    response: str
    seconds: Array
    stages: tuple[Stage, ...]

    @property
    def steps(self) -> tuple[Step, ...]:
        """Ramps, each with the hold after it."""
        return steps_of(self.stages)

    @property
    def compression(self) -> float:
        """1 if the drive grows in compression, which makes the response larger, else -1."""
        drive, response = self.data.columns[self.drive], np.abs(self.data.columns[self.response])
        return 1.0 if np.cov(drive - drive.mean(), response - response.mean())[0, 1] >= 0.0 else -1.0

    @property
    def sign(self) -> float:
        """1 if the response is positive in compression, else -1."""
        response = self.data.columns[self.response]
        return 1.0 if response[np.abs(response).argmax()] > 0.0 else -1.0


def recording_of(data: DataFile, time: str | None, drive: str | None, response: str | None) -> Recording:
    """The recording in a data file, its columns by name or by what such columns are usually called.

    Raises
    ------
    CaseError
        If there is no such column, or the times do not increase.
    """
    problems = []
    found: dict[str, str] = {}
    for key, name in (("time", time), ("drive", drive), ("value", response)):
        if name is not None:
            try:
                found[key] = data.column(name)
            except ValueError as error:
                problems.append(Problem(key, shown(name), str(error)))
    if problems:
        raise CaseError(problems, data.source)
    found.setdefault("time", next(iter(data.columns)))
    for key, usual in (("drive", _DRIVES), ("value", _RESPONSES)):
        if key not in found:
            other = [heading for heading in data.columns if heading not in found.values()]
            guess = next((h for word in usual for h in other if word in h.casefold()), None)
            if guess is None:
                message = f"missing; say which column it is, of {', '.join(map(shown, other))}"
                raise CaseError([Problem(key, "", message)], data.source)
            found[key] = guess
    unit = data.units[found["time"]] or "s"
    try:
        seconds = data.columns[found["time"]] * parse(f"1 {unit}", "time")
    except QuantityError as error:
        raise CaseError([Problem("time", shown(found["time"]), str(error))], data.source) from None
    if len(seconds) < 3 or not (np.diff(seconds) > 0.0).all():
        message = "times must increase from row to row, and there must be 3 of them"
        raise CaseError([Problem("time", shown(found["time"]), message)], data.source)
    stages = recognised(seconds, data.columns[found["drive"]])
    return Recording(data, found["time"], found["drive"], found["value"], seconds, stages)


def starter_case(recording: Recording, height: float | None, radius: float | None) -> str:
    """Text of a case with the phases of a recording: of a disc where a radius is given, else of a column.

    Parameters
    ----------
    recording
        What was done.
    height, radius
        Of the sample, mm; a height that is not known is a placeholder, and says so.
    """
    template = "starter_disc.toml" if radius is not None else "starter_column.toml"
    text = resources.files(__package__).joinpath(template).read_text(encoding="utf-8")
    thickness = _THICKNESS if height is None else height
    mark = "# not known from the data: measure it" if height is None else "# of the stress-free solid"
    text = text.replace("HEIGHT", f'"{thickness:g} mm"').replace("THICKNESS_NOTE", mark)
    text = text.replace("RADIUS", f'"{radius or _RADIUS:g} mm"')
    return text + "\n" + "\n".join(_phases(recording, thickness, "top" if radius is not None else "piston"))


def starter_fit(recording: Recording, case_file: str, data_file: str, radius: float | None) -> str:
    """Text of a fit file for a starter case."""
    name, unit = split_heading(recording.response)
    dimension = _dimension(unit)
    part = "top" if radius is not None else "piston"
    quantity = f"{part}_{'force' if dimension == 'force' else 'pressure'}" if dimension else "global_strain"
    first = recording.data.columns[recording.response][0]
    lines = [
        f'title = "Fit of {recording.response}"'.replace("\\", ""),
        f'case = "{case_file}"',
        "",
        "[[measurement]]",
        f'name = "{_plain(name)}"',
        f'file = "{data_file}"',
        f'time = "{recording.time}"',
        f'value = "{recording.response}"',
        *([] if unit else ['unit = ""                  # the heading does not say it']),
        f'quantity = "{quantity}"',
        f"start = {recording.seconds[0]:g}                  # s, time in the file at which the first phase begins",
        f"zero = {first:g}             # taken off: the case begins without a load. 0 if it has its preload in a phase",
        f"factor = {recording.sign:g}                  # so that compression is positive",
        "points = 300                # spread over the time and the way of the curve; all without it",
        "",
    ]
    keys = {"youngs_modulus": "tissue.youngs_modulus", "permeability": "tissue.hydraulic_permeability"}
    if radius is not None:
        keys["fibre_stiffness"] = "tissue.fibres.0.modulus"
    for own, key in keys.items():
        lines += ["[[parameter]]", f'name = "{own}"', f'key = "{key}"', ""]
    return "\n".join(lines)


def _phases(recording: Recording, thickness: float, part: str) -> list[str]:
    """Lines of the phases."""
    drive = recording.data.columns[recording.drive]
    scale, unit = _displacement_scale(recording, thickness)
    sign = -recording.compression * scale
    if not recording.steps:
        at = corners(recording.seconds, drive)
        times = ", ".join(f"{recording.seconds[row] - recording.seconds[0]:.6g}" for row in at)
        values = ", ".join(f"{sign * (drive[row] - drive[0]):.6g}" for row in at)
        length = recording.seconds[-1] - recording.seconds[0]
        return [
            "# the drive as it was recorded: it is no row of ramps and holds",
            "[[phase]]",
            'name = "recorded"',
            f'duration = "{length:.8g} s"',
            f"{part}.displacement = {{ times = [{times}], values = [{values}] }}",
            "",
        ]
    lines = [f"# what was recorded, from {recording.drive}{unit}"]
    for number, step in enumerate(recording.steps, start=1):
        target = sign * (step.after - drive[0])
        load = f'{{ ramp_to = "{target:.6g} mm", over = "{step.over:.6g} s" }}' if step.over else f'"{target:.6g} mm"'
        lines += [
            "[[phase]]",
            f'name = "step {number}"',
            f'duration = "{step.end - step.start:.8g} s"',
            f"{part}.displacement = {load}",
            "",
        ]
    return lines


def _displacement_scale(recording: Recording, thickness: float) -> tuple[float, str]:
    """Millimetres in a unit of the drive, and what to say of it; a drive that is no length is a strain."""
    unit = recording.data.units[recording.drive]
    try:
        return parse(f"1 {unit}", "length"), ""
    except QuantityError:
        pass
    try:
        strain = parse(f"1 {unit}", "plain number") if unit else 1.0
    except QuantityError:
        strain = 1.0
    return strain * thickness, ", taken as a strain of the height"


def _dimension(unit: str) -> str | None:
    for name in ("force", "pressure"):
        try:
            parse(f"1 {unit}", name)
        except QuantityError:
            continue
        return name
    return None


def _plain(name: str) -> str:
    letters = "".join(letter if letter.isalnum() or letter in " -_" else " " for letter in name).strip()
    return letters if letters and letters[0].isalpha() else f"curve {letters}".strip()
