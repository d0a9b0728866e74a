"""Who computes the batches of a study: this process, the cores of this machine, or a Dask cluster.

Each way yields the index and the result of every batch once, as they are finished. Closing the iterator early gives up
the batches that have not begun.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from fvswell.errors import SolverError
from fvswell.numerics.blas import THREAD_VARIABLES
from fvswell.study.batches import Batch, BatchResult, run_batch

__all__ = [
    "Finished", "SchedulerError", "available_cores", "connected", "in_this_process", "on_cores", "on_dask",
    "one_thread_each", "start_worker",
]  # fmt: skip

Finished = Generator[tuple[int, BatchResult], None, None]

_PATIENCE = 30.0  # s, for a cluster to answer


class SchedulerError(SolverError):
    """Whoever should compute the batches cannot be reached or has given up."""


def available_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_this_process(batches: Sequence[Batch]) -> Finished:
    """One batch after the other."""
    for batch in batches:
        yield batch.index, run_batch(batch)


def on_cores(batches: Sequence[Batch], processes: int) -> Finished:
    """In processes of this machine, each with one thread.

    Processes are spawned, so a program that calls this needs the usual ``if __name__ == "__main__"``.

    Raises
    ------
    SchedulerError
        If a process is killed from outside.
    """
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(min(processes, len(batches)), context, initializer=start_worker)
    try:
        with one_thread_each():
            pending = {executor.submit(run_batch, batch): batch.index for batch in batches}
        while pending:
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                index = pending.pop(future)
                yield index, future.result()
    except BrokenProcessPool:
        raise SchedulerError(
            "a process of the study was killed, perhaps because memory ran out; the finished batches are kept, and the "
            "same command goes on with the others"
        ) from None
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def on_dask(batches: Sequence[Batch], address: str) -> Finished:
    """On a Dask cluster that exists already; batches of workers that are lost are computed again by others.

    Parameters
    ----------
    batches
        The work.
    address
        Of the scheduler, such as "tcp://127.0.0.1:8786".

    Raises
    ------
    SchedulerError
        If Dask is not installed, no scheduler answers at the address, or it has no workers.
    """
    client = connected(address)
    from distributed import as_completed

    with client:
        pending = {client.submit(run_batch, batch, pure=False): batch.index for batch in batches}
        for future in as_completed(list(pending), loop=client.loop):
            index = pending.pop(future)
            yield index, future.result()


def connected(address: str) -> Any:
    """Client of a Dask cluster that exists already.

    Raises
    ------
    SchedulerError
        If Dask is not installed, no scheduler answers at the address, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise SchedulerError('a Dask scheduler needs the extra "study": pip install "fvswell[study]"') from None
    try:
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise SchedulerError(f"{address}: no Dask scheduler answers there ({error})") from None
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except TimeoutError:
        client.close()
        raise SchedulerError(f"{address}: the Dask cluster has no workers") from None
    return client


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Processes started in here compute on one thread: the work is shared out among processes already."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def start_worker() -> None:
    """Leave Ctrl-C to the parent, and end with it even if it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)
