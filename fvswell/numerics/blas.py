"""BLAS on one thread: where its threads have to share the cores with other work they mostly wait for each other."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController

__all__ = ["THREAD_VARIABLES", "one_blas_thread"]

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keep BLAS on one thread, unless one of THREAD_VARIABLES in the environment says how many."""
    if any(name in os.environ for name in THREAD_VARIABLES):
        yield
    else:
        with _libraries().limit(limits=1, user_api="blas"):
            yield


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()  # looking for them takes milliseconds
