"""Independent parts of one diagnosis side by side, in forked processes: they know all that is known here, and only
results go between.

A fork copies no threads, and their locks stay locked: beside threads, or where there is no fork, the parts are
done one after the other. The results are the same.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, TypeVar

Part = TypeVar("Part")
Result = TypeVar("Result")

_work: Callable[[int], Any] | None = None
"""The function that a worker applies to a number; set while it is forked, as functions and data need not be picklable
so."""


def each(function: Callable[[Part], Result], parts: Sequence[Part], jobs: int) -> list[Result]:
    """``function`` of each of the ``parts``, in order, on up to ``jobs`` processes. Its changes here may be lost:
    only its result counts."""
    jobs = min(jobs, len(parts))
    if jobs < 2 or not hasattr(os, "fork") or threading.active_count() > 1:
        return [function(part) for part in parts]

    def work(k: int) -> Result:
        return function(parts[k])

    global _work
    _work = work
    with warnings.catch_warnings():
        # Python warns of any thread; those that are left are of linear algebra, which minds forks itself.
        warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
        with ProcessPoolExecutor(jobs, multiprocessing.get_context("fork")) as pool:
            try:
                return list(pool.map(_do, range(len(parts))))
            finally:
                _work = None


def _do(k: int) -> Any:
    assert _work is not None
    return _work(k)
