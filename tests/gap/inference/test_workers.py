"""Parts side by side: the same results in the same order, and one after the other where a fork is not safe."""

from __future__ import annotations

import multiprocessing
import os
import threading

import numpy as np
import pytest

from gap.inference.workers import each
from gap.search.compare import compare
from sim_devices.chain import Parameter

forked = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")


def place(part: int) -> tuple[int, int]:
    return part, os.getpid()


@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_results_come_in_order_whatever_the_number_of_processes(jobs: int) -> None:
    known = {k: object() for k in range(5)}  # which no pickle could carry
    assert each(lambda k: (k**2, k in known), range(5), jobs) == [(k**2, True) for k in range(5)]


@forked
def test_other_processes_do_the_work_and_none_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threading, "active_count", lambda: 1)  # one that reruns tests may keep a thread of its own
    assert os.getpid() not in {pid for _, pid in each(place, range(4), 2)}
    assert not multiprocessing.active_children()


def test_beside_another_thread_nothing_is_forked() -> None:
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    try:
        assert {pid for _, pid in each(place, range(4), 2)} == {os.getpid()}
    finally:
        done.set()
        other.join()


@forked
def test_a_part_that_fails_is_an_error_here() -> None:
    with pytest.raises(ZeroDivisionError):
        each(lambda k: 1 / k, range(3), 2)


@forked
def test_a_comparison_is_the_same_by_one_process_or_two(linear, candidate) -> None:
    time = np.linspace(0.0, 1.0, 300)
    shapes = {"wave": np.sin(9 * time), "ramp": time, "arch": time * (1 - time)}
    made = {name: lambda v, shape=shape: v["a"] * shape for name, shape in shapes.items()}
    known = [candidate(name, Parameter("a", "1", -30.0, 30.0)) for name in shapes]
    noise = np.random.default_rng(3).normal(size=len(time))
    measured = 5 * shapes["wave"] + 2 * shapes["ramp"] + noise
    alone, shared = (compare([linear(measured, np.ones((len(time), 1)), made)], known, jobs=jobs) for jobs in (1, 2))
    assert [h.name for h in shared.hypotheses] == [h.name for h in alone.hypotheses]
    assert [h.chi2 for h in shared.hypotheses] == [h.chi2 for h in alone.hypotheses]
    assert shared.simulations == alone.simulations
