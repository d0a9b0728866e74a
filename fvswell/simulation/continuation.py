"""Runs that start where another one ended, or go on where they were interrupted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fvswell.case.case import Case
from fvswell.case.errors import CaseError, Problem, shown
from fvswell.case.values import RelaxationTimes
from fvswell.errors import OutputError
from fvswell.numerics.loads import TARGET, Protocol
from fvswell.numerics.state import State
from fvswell.physics.tissue import Array
from fvswell.results.file import read_result, read_state
from fvswell.results.layout import COMPLETE, Content
from fvswell.results.run_file import RUNNING, part_path

__all__ = ["Ending", "Interrupted", "kept_state"]

_CHANGED = ("phase_start", "duration")  # what a run changes in its protocol
_HELD, _HELD_BEFORE = "held", "held_before"  # loads that a run ends with, and begins with; nan where they are found
_SAME = ("model", "geometry", "tissue", "bath", "open_circuit_permeability")  # what a sample and its grid depend on
_MOST_NAMED = 5  # differences that are reported


def kept_state(state: State, protocol: Protocol, held: Array | None) -> dict[str, Array]:
    """Copy of all that a run needs to be continued, by name; ``held`` are the loads that it began with, if any."""
    arrays = state._asdict() | {f"protocol_{name}": getattr(protocol, name) for name in _CHANGED}
    arrays[_HELD] = np.where(np.isnan(protocol.table[-1, :, TARGET]), np.nan, state.loads)
    if held is not None:
        arrays[_HELD_BEFORE] = held
    return {name: values.copy() for name, values in arrays.items()}


@dataclass(frozen=True)
class Ending:
    """What a run that is over has left."""

    started_from: str  # its file
    kept: Mapping[str, Array]

    @property
    def held(self) -> Array:
        """Loads that it ended with, nan where they were found."""
        return self.kept[_HELD]

    @classmethod
    def of(cls, path: Path, case: Case) -> Ending:
        """Read it from a result.

        Parameters
        ----------
        path
            Of the result.
        case
            To be started from there.

        Raises
        ------
        OutputError
            If the result is not complete, or of another tissue, grid or model.
        CaseError
            If the case asks for relaxation times, which are those of a sample in equilibrium.
        """
        result = read_result(path)
        if result.attrs["run_status"] != COMPLETE:
            raise OutputError(f"{path}: cannot be started from: it is not complete ({result.attrs['run_status']})")
        other = Case.from_toml(result.attrs["case_toml"], str(path))
        if differing := list(_differences(_sample(other), _sample(case))):
            more = len(differing) - _MOST_NAMED
            named = [*differing[:_MOST_NAMED], *([f"{more} more"] if more > 0 else [])]
            raise OutputError(f"{path}: cannot be started from, the case is of another sample: {', '.join(named)}")
        relative = [phase for phase in case.phase if isinstance(phase.duration, RelaxationTimes)]
        if relative:
            message = "must be given in s in a run that starts from another: relaxation times begin in equilibrium"
            raise CaseError(
                [Problem(f"phase[{each.name}].duration", shown(str(each.duration)), message) for each in relative],
                case.source,
            )
        return cls(str(path), read_state(path))

    def restore(self, state: State) -> None:
        """Put a state to where the run ended; time begins anew."""
        for name in ("unknowns", "contents", "loads"):
            getattr(state, name)[...] = self.kept[name]


@dataclass(frozen=True)
class Interrupted:
    """What an interrupted run has left."""

    content: Content
    durations: list[float]
    started_from: str | None  # file that it was started from
    kept: Mapping[str, Array]

    @property
    def held(self) -> Array | None:
        """Loads that it began with, if it was started from another run."""
        return self.kept.get(_HELD_BEFORE)

    @classmethod
    def of(cls, path: Path, case: Case) -> Interrupted:
        """Read it from ``NAME.part`` if that is there, else from the file itself.

        Raises
        ------
        OutputError
            If there is nothing to go on with, or it is of another case.
        """
        part = part_path(path)
        source = part if part.exists() else path
        if not source.exists():
            raise OutputError(f"{path}: there is nothing to resume: neither this file nor {part.name} exists")
        result = read_result(source)
        status = result.attrs["run_status"]
        if result.attrs["case_sha256"] != case.sha256:
            raise OutputError(f"{source}: cannot be resumed: it is of another case")
        if status == COMPLETE:
            raise OutputError(f"{source}: is complete, there is nothing to resume")
        if status != RUNNING and not status.startswith("interrupted"):
            raise OutputError(f"{source}: cannot be resumed: the run has {status}")
        fields, history = (
            {str(name): value.values for name, value in result.data_vars.items() if value.dims[0] == dimension}
            for dimension in ("time", "step")
        )
        durations = np.diff(result["phase_end"].values, prepend=0.0).tolist()
        content = Content(result["time"].values, fields, history)
        return cls(content, durations, result.attrs.get("started_from"), read_state(source))

    def restore(self, state: State, protocol: Protocol) -> None:
        """Put a state and a protocol back to where the run was."""
        for name in State._fields:
            getattr(state, name)[...] = self.kept[name]
        for name in _CHANGED:
            getattr(protocol, name)[...] = self.kept[f"protocol_{name}"]


def _sample(case: Case) -> dict[str, Any]:
    """What a sample and its grid depend on, by dotted key."""
    content = case.model_dump(include=set(_SAME))
    content["geometry"].pop("probe", None)  # a matter of what is recorded
    return dict(_flat(content, ""))


def _flat(content: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> Iterator[str]:
    """What differs between two samples, in words."""
    for key in dict.fromkeys([*there, *here]):
        if there.get(key) != here.get(key):
            values = ("not given" if each.get(key) is None else shown(each[key]) for each in (there, here))
            yield "{} is {} there and {} here".format(key, *values)
