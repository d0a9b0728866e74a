"""Curves that have been simulated already, in memory and on disk: what makes an interrupted fit go on where it was.

A fit is the same sequence of runs whenever it is begun with the same problem, so one that is begun again finds the
first of them here and is soon where it was. Each run is one record of a binary file: the parameters, and the curves.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import numpy as np

from fvswell.errors import OutputError
from fvswell.physics.tissue import Array

__all__ = ["KeptRuns"]

_HEADER = 64  # bytes: the checksum of the problem in hexadecimal digits


class KeptRuns:
    """Curves by parameters, ``(points,)`` each; a context that closes the file.

    Parameters
    ----------
    parameters, points
        Lengths of a vector of parameters and of the curves.
    path, key
        File to keep them in, and the checksum of the problem; without a path they are in memory only.

    Raises
    ------
    OutputError
        If the file belongs to another problem, or cannot be written.
    """

    def __init__(self, parameters: int, points: int, path: Path | None = None, key: str = "") -> None:
        self.path, self._file = path, None
        self._width = parameters
        self._curves: dict[bytes, Array] = {}
        if path is not None:
            self._file = self._opened(path, key, 8 * (parameters + points))
        self.earlier = len(self._curves)  # runs that an earlier session has left

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()

    def get(self, parameters: Array) -> Array | None:
        """The curves of these very parameters, if they have been simulated."""
        return self._curves.get(parameters.tobytes())

    def keep(self, parameters: Array, curves: Array) -> None:
        """Keep the curves of parameters; on disk when this returns."""
        self._curves[parameters.tobytes()] = curves
        if self._file is None:
            return
        try:
            self._file.write(np.concatenate([parameters, curves]).tobytes())
            self._file.flush()
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written: {error.strerror}") from None

    def remove(self) -> None:
        """Delete the file."""
        if self._file is not None and self.path is not None:
            self._file.close()
            self.path.unlink(missing_ok=True)

    def _opened(self, path: Path, key: str, record: int) -> BinaryIO:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            kept = path.read_bytes() if path.exists() else b""
            if kept and kept[:_HEADER] != key.encode():
                raise OutputError(
                    f"{path}: holds runs of another fit or of another version of fvswell; remove it, or choose another "
                    "output"
                )
            whole = (len(kept) - _HEADER) // record if kept else 0  # the last record may have been cut off
            for row in (
                np.frombuffer(kept, offset=_HEADER, count=whole * record // 8).reshape(whole, -1) if whole else ()
            ):
                self._curves[row[: self._width].tobytes()] = row[self._width :]
            file = path.open("r+b" if kept else "w+b")
            if kept:
                file.truncate(_HEADER + whole * record)
                file.seek(0, 2)
            else:
                file.write(key.encode())
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
        return file
