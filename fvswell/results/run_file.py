"""The file of a run: while it goes on ``NAME.part``, from which it can be resumed if it is killed; in the end NAME."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path

from fvswell.physics.tissue import Array
from fvswell.results.file import refuse_existing, write_result
from fvswell.results.layout import Content, Layout

__all__ = ["RUNNING", "RunFile", "part_path"]

RUNNING = "running"  # run_status of a file whose run was killed
_PATIENCE = 2.0  # s before the first file and between two, at least
_SHARE = 0.05  # of the time that may go into writing files


def part_path(path: Path) -> Path:
    """Where a run that writes to a file keeps what there is."""
    return path.with_name(path.name + ".part")


class RunFile:
    """Result file of a run.

    Every file is written whole and then renamed, so what is there can be read, whenever the program is killed.

    Parameters
    ----------
    path
        Of the result.
    layout
        Of the result.
    replace
        Whether a file of that name may be replaced.

    Raises
    ------
    OutputError
        If the file exists already and may not be replaced.
    """

    def __init__(self, path: Path, layout: Layout, replace: bool = False) -> None:
        refuse_existing([path], replace)
        self.path, self.layout = path, layout
        self._due = time.monotonic() + _PATIENCE  # a run that is over by then needs no other file than its result

    def keep(self, content: Callable[[], Content], state: Mapping[str, Array]) -> None:
        """Keep what there is in ``NAME.part``, unless that has been done, or the run has begun, a moment ago.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        began = time.monotonic()
        if began < self._due:
            return
        write_result(part_path(self.path), self.layout, content(), RUNNING, state)
        ended = time.monotonic()
        self._due = ended + max(_PATIENCE, (ended - began) / _SHARE)

    def close(self, content: Content, status: str, state: Mapping[str, Array]) -> None:
        """Write the file under its own name.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        write_result(self.path, self.layout, content, status, state)
        part_path(self.path).unlink(missing_ok=True)

    def interrupt(self, content: Content, status: str, state: Mapping[str, Array]) -> None:
        """Write what there is under the file's own name; as ``NAME.part`` if there is a file that would be replaced."""
        if self.path.exists():
            write_result(part_path(self.path), self.layout, content, status, state)
        else:
            self.close(content, status, state)
