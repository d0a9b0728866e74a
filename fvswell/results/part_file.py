"""A netCDF file under way: ``NAME.new`` until it is whole, then NAME; nothing if the work on it ends early."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from fvswell.errors import OutputError

if TYPE_CHECKING:
    import netCDF4

__all__ = ["NETCDF", "PartFile"]

NETCDF = threading.RLock()  # the netCDF library cannot be used by two threads at once


class PartFile:
    """A netCDF file that is written bit by bit, as a context: left before `finish`, it leaves nothing behind.

    Parameters
    ----------
    path
        Name of the finished file.
    define
        Given the new file, defines what is in it.
    """

    def __init__(self, path: Path, define: Callable[[netCDF4.Dataset], None]) -> None:
        self.path, self._define = path, define
        self._part = path.with_name(path.name + ".new")
        self._file: netCDF4.Dataset | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._discard()

    @contextmanager
    def writing(self) -> Iterator[netCDF4.Dataset]:
        """Context to write in; gives the file, which comes into being with the first of them.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        with NETCDF, _uninterrupted(), self._reported_errors():
            import netCDF4

            if self._file is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._file = netCDF4.Dataset(self._part, "w", format="NETCDF4")
                self._define(self._file)
            yield self._file

    def finish(self) -> None:
        """Close the file and give it its name.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        with self.writing() as file:
            file.close()
            self._part.replace(self.path)

    def _discard(self) -> None:
        with NETCDF, _uninterrupted():
            if self._file is not None:
                with suppress(RuntimeError):  # of what cannot be flushed to a full disk, or is closed already
                    self._file.close()
            with suppress(OSError):  # of a place where nothing could be written in the first place
                self._part.unlink(missing_ok=True)

    @contextmanager
    def _reported_errors(self) -> Iterator[None]:
        """Errors of the file system and of the netCDF library, reported with the file's name."""
        try:
            yield
        except (OSError, RuntimeError) as error:  # netCDF4 raises RuntimeError when the disk is full
            reason = getattr(error, "strerror", None) or error
            raise OutputError(f"{self.path}: cannot be written: {reason}") from None


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until the end: inside the netCDF library, a bare ``except:`` may swallow it."""
    usual: Any = signal.getsignal(signal.SIGINT)
    if not callable(usual) or threading.current_thread() is not threading.main_thread():
        yield  # nothing is raised here
        return
    held: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: held.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        if held:
            signal.raise_signal(signal.SIGINT)
