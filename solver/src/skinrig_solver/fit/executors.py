"""Where runs of the model happen: this process, worker processes, or a dask.distributed cluster."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context


@contextmanager
def workers(jobs: int = 1, cluster: str = "") -> Iterator[Executor | None]:
    """An executor of ``jobs`` processes, or of the dask cluster whose scheduler listens at ``cluster``; None for one.

    Raises ImportError that says what to install if there is no dask; OSError if nobody listens there.
    """
    if cluster:
        try:
            from distributed import Client
        except ImportError as error:
            raise ImportError("a cluster needs dask.distributed: pip install 'skinrig-solver[cluster]'") from error
        with Client(cluster, timeout="10s", set_as_default=False) as client:
            yield client.get_executor()
    elif jobs > 1:
        # a spawned process has no locks or threads of ours in an unknown state
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            yield pool
    else:
        yield None
