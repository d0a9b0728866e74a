"""Kernels: functions that run compiled, from a cache on disk where there is one.

numba looks for changes in the file of a cached function only, so a law that is edited elsewhere would go on giving its
old answers. The cache therefore lies in a folder named after everything that compiled code depends on: the sources of
all functions of a point and of all kernels, and the versions of Python, numba, llvmlite and numpy.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import platform
import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from fvswell.compiled.dispatch import give_to_numba, noted_functions

__all__ = ["COMPILING", "Kernel", "cache_directory", "compiled_type", "kernel", "law_kernel", "report_compilation"]

COMPILING = "compiling, once for this version of fvswell and these laws (about half a minute)"

_KEPT_FOLDERS = 4  # of the cache: that of this program, and of a few others of other versions
_lock = threading.RLock()  # numba compiles one function at a time
_law_kernels: dict[tuple[Any, ...], Any] = {}
_types: dict[type, Any] = {}
_report: Callable[[str], None] | None = None  # of the first compilation
_listening = False
_OPTIONS = {"error_model": "numpy", "nogil": True, "_nrt": False}


class Kernel:
    """A function that is compiled when it is first called; several threads may call it at once."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self._compiled: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        """Run the compiled function."""
        return (self._compiled or self._compile(arguments))(*arguments)

    def _compile(self, arguments: tuple[Any, ...]) -> Callable[..., Any]:
        with _lock:
            if self._compiled is None:
                numba = _numba()
                if numba.config.DISABLE_JIT:
                    self._compiled = self.function
                else:
                    dispatcher = numba.njit(**_OPTIONS)(self.function)
                    with _cache_in_place(numba) as cache:
                        if cache:
                            dispatcher.enable_caching()
                        dispatcher.compile(tuple(map(dispatcher.typeof_pyval, arguments)))
                    self._compiled = dispatcher
            return self._compiled


def kernel(function: Callable[..., Any]) -> Kernel:
    """Mark a function to run compiled."""
    return Kernel(function)


def law_kernel(make: Callable[..., Callable[..., Any]], dimensions: tuple[int, ...], *parts: Any) -> Any:
    """What a kernel calls to evaluate one combination of laws; compiled once for each combination.

    Parameters
    ----------
    make
        Given the parts, makes the function. It takes contiguous arrays of floats and returns nothing.
    dimensions
        Number of dimensions of each array that the function takes.
    parts
        Classes of laws and other constants that are compiled in.

    Returns
    -------
    object
        Compiled code that other kernels take as an argument. A combination costs a few seconds once, and the kernels
        that call it do not depend on it.
    """
    key = (make, dimensions, *parts)
    with _lock:
        if key not in _law_kernels:
            numba = _numba()
            function = make(*parts)
            if numba.config.DISABLE_JIT:
                _law_kernels[key] = function
            else:
                arrays = [numba.types.Array(numba.float64, ndim, "C") for ndim in dimensions]
                with _cache_in_place(numba) as cache:
                    compiled = numba.cfunc(numba.void(*arrays), cache=cache, nopython=True, error_model="numpy")(
                        function
                    )
                compiled._numba_type_ = numba.typeof(compiled)  # else it is found in every call that takes it along
                _law_kernels[key] = compiled
        return _law_kernels[key]


def report_compilation(report: Callable[[str], None] | None) -> None:
    """Have the first compilation from here on reported, as it begins; what is loaded from the cache is not reported.

    Parameters
    ----------
    report
        Called once, with a text; None for no report.
    """
    global _report
    _report = report


def compiled_type(value: Any) -> Any:
    """Type of a value in compiled code, found once for its class: all values of the class must have the same.

    For the property ``_numba_type_`` of a class with many fields, the type of which takes long to find.
    """
    own = type(value)
    if own not in _types:
        _types[own] = _numba().typeof(value)
    return _types[own]


def cache_directory() -> Path | None:
    """Folder of compiled code for this program as it is now; None where none can be written."""
    root = os.environ.get("FVSWELL_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    try:
        base = Path(root) if root else Path.home() / ".cache"
        folder = base / "fvswell" / _key(len(noted_functions()))
        if not folder.exists():
            folder.mkdir(parents=True)
            _remove_old(folder)
        if not os.access(folder, os.W_OK):
            return None
    except (OSError, RuntimeError):  # no home, or one that cannot be written to
        return None
    return folder


@cache
def _key(functions: int) -> str:
    """Name for everything that compiled code depends on; functions of a point have been defined in that number."""
    digest = hashlib.sha256()
    package = Path(__file__).parent.parent
    files = {path for folder in ("compiled", "physics", "numerics", "column", "block")
             for path in (package / folder).glob("*.py")}  # fmt: skip
    files |= {Path(inspect.getsourcefile(function) or "") for function in noted_functions()}
    for path in sorted(files):
        if path.is_file():
            digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    versions = [metadata.version(name) for name in ("numba", "llvmlite", "numpy")]
    digest.update(" ".join([sys.version, platform.machine(), str(package), *versions]).encode())
    return digest.hexdigest()[:24]


def _remove_old(folder: Path) -> None:
    """Delete the oldest folders beside a new one."""
    others = sorted((path for path in folder.parent.iterdir() if path != folder), key=lambda path: path.stat().st_mtime)
    for path in others[: max(0, len(others) - _KEPT_FOLDERS + 1)]:
        shutil.rmtree(path, ignore_errors=True)


def _numba() -> Any:
    with _lock:
        import numba

        _import_without_blas()
        give_to_numba()
        _listen()
        return numba


def _import_without_blas() -> None:
    """Import what numba asks for BLAS as it is imported: that takes scipy.linalg along, a quarter of a second.

    Whoever compiles a product of matrices has numba ask again, and then gets it.
    """
    if "numba.np.arraymath" in sys.modules:
        return
    from numba.np import linalg

    ask = linalg.ensure_blas
    linalg.ensure_blas = lambda: None  # scipy is there: fvswell needs it
    try:
        import numba.np.arraymath  # noqa: F401
    finally:
        linalg.ensure_blas = ask


def _listen() -> None:
    """Have numba say when it compiles anything."""
    global _listening
    if _listening:
        return
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            global _report
            report, _report = _report, None
            if report is not None:
                report(COMPILING)

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", Listener())
    _listening = True


class _cache_in_place:
    """Context in which numba caches into our folder; gives whether it can.

    One process at a time is in here: the others wait, and then find compiled what they need.
    """

    def __init__(self, numba: Any) -> None:
        self.config = numba.config
        self.folder = cache_directory()
        numba.core.registry.cpu_target.target_context.refresh()  # takes long, and nobody has to wait for it

    def __enter__(self) -> bool:
        self.usual = self.config.CACHE_DIR
        self.alone = ExitStack()
        if self.folder is not None:
            self.config.CACHE_DIR = str(self.folder)
            self.alone.enter_context(_one_process(self.folder))
        return self.folder is not None

    def __exit__(self, *error: object) -> None:
        self.config.CACHE_DIR = self.usual
        self.alone.close()


@contextmanager
def _one_process(folder: Path) -> Iterator[None]:
    """Context that one process is in at a time, where the system can see to it; it ends with the process, too."""
    try:
        import fcntl
    except ImportError:  # Windows: processes may compile the same twice
        yield
        return
    with ExitStack() as stack:
        with suppress(OSError):  # of a file system that has no locks
            fcntl.flock(stack.enter_context((folder / "lock").open("a")), fcntl.LOCK_EX)
        yield
