"""Finished batches on disk until the result of a study is whole: what makes an interrupted study go on where it was.

Each batch is one file, written under a temporary name, forced to disk and renamed, so a file that is there is whole,
whatever interrupts the program.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fvswell.errors import OutputError
from fvswell.study.batches import BatchResult

__all__ = ["StudyParts"]

_KEY = "study.sha256"
_SUFFIX = ".npz"


class StudyParts:
    """Directory of the finished batches of one study, ``RESULT.parts`` beside the result.

    Raises
    ------
    OutputError
        If the directory holds batches of another study, or cannot be made.
    """

    def __init__(self, result: Path, key: str) -> None:
        self.directory = result.with_name(result.name + ".parts")
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            label = self.directory / _KEY
            if not any(self.directory.glob("*" + _SUFFIX)):
                self._write(label, lambda file: file.write(key.encode()))
            elif not label.exists():
                raise OutputError(f"{self.directory}: holds files of unknown origin; remove it")
            elif label.read_text() != key:
                raise OutputError(
                    f"{self.directory}: holds finished batches of another study or of another version of fvswell; "
                    "remove it, or choose another output"
                )
        except OSError as error:
            raise OutputError(f"{self.directory}: cannot be written: {error.strerror}") from None

    def finished(self) -> set[int]:
        """Indices of the batches that are there."""
        return {int(path.stem) for path in self.directory.glob("*" + _SUFFIX)}

    def store(self, index: int, result: BatchResult) -> None:
        """Keep the result of a batch, for good when this returns.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        arrays: dict[str, Any] = result
        try:
            self._write(self._path(index), lambda file: np.savez(file, **arrays))
        except OSError as error:
            raise OutputError(
                f"{self.directory}: cannot be written: {error.strerror}; the finished batches are kept, and the same "
                "command goes on with the others"
            ) from None

    def results(self) -> Iterator[tuple[int, BatchResult]]:
        """Index and result of every batch, one at a time."""
        for index in sorted(self.finished()):
            with np.load(self._path(index)) as file:
                yield index, dict(file)

    def remove(self) -> None:
        """Delete everything."""
        shutil.rmtree(self.directory)

    def _path(self, index: int) -> Path:
        return self.directory / f"{index:06d}{_SUFFIX}"

    def _write(self, path: Path, write: Callable[[BinaryIO], Any]) -> None:
        temporary = path.with_name(path.name + ".new")
        with temporary.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        directory = os.open(self.directory, os.O_RDONLY)
        try:
            os.fsync(directory)  # the new name, too
        finally:
            os.close(directory)
