"""Chains that are run thousands of times: what is not run again, and that it would have given the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from gap.null.chains import Kept, Memo, needed, undone
from sim_devices.chain import FloatArray, Signals
from sim_devices.stages import nominal
from sim_devices.stages.operators import Map, Wired

TIME = np.linspace(0.0, 4.0, 400)
RUNS: list[str] = []


@dataclass(frozen=True)
class Counted(Wired):
    factor: float

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        RUNS.append(self.name)
        signals[self.target[0]] = self.factor * signals[self.source[0]]


@pytest.fixture(autouse=True)
def nothing_run_yet() -> None:
    RUNS.clear()


def chain(first: float, second: float) -> list[Counted]:
    return [Counted("first", "tissue", ("u",), ("v",), first), Counted("second", "sensor", ("v",), ("w",), second)]


def test_only_what_lies_behind_a_change_runs_again() -> None:
    memo, u = Memo(TIME), np.sin(TIME)
    memo.run(chain(2.0, 3.0), {"u": u})
    changed = memo.run(chain(2.0, 5.0), {"u": u})
    assert RUNS == ["first", "second", "second"]
    np.testing.assert_allclose(changed["w"], 10.0 * u)


def test_another_input_runs_everything_again() -> None:
    memo = Memo(TIME)
    for u in (np.sin(TIME), np.cos(TIME)):
        np.testing.assert_allclose(memo.run(chain(2.0, 3.0), {"u": u})["w"], 6.0 * u)
    assert len(RUNS) == 4


def test_what_was_not_asked_for_lately_is_forgotten() -> None:
    kept = Kept(2)
    for key in (1, 2, 1, 3, 1, 2):
        kept.get(key, lambda key=key: RUNS.append(str(key)) or key)
    assert RUNS == ["1", "2", "3", "2"]


def test_an_operator_that_cannot_be_a_key_runs_every_time() -> None:
    def doubled(time: FloatArray, u: FloatArray, table: FloatArray) -> FloatArray:
        RUNS.append("doubled")
        return np.asarray(np.interp(u, table, 2.0 * table))

    operator = Map("doubled", "tissue", ("u",), ("v",), doubled, (TIME,))  # type: ignore[arg-type]
    memo = Memo(TIME)
    for _ in range(2):
        np.testing.assert_allclose(memo.run([operator], {"u": TIME})["v"], 2.0 * TIME)
    assert RUNS == ["doubled", "doubled"]


def test_it_gives_what_the_chain_gives() -> None:
    suction = nominal("cutometer", marks=(0.0,))
    command = np.where((TIME > 1.0) & (TIME < 2.0), -20e3, 0.0)
    direct = suction.run(TIME, {"command_pressure": command})
    memo = Memo(TIME)
    for _ in range(2):
        again = memo.run(needed(suction, ("apex_height",)), {"command_pressure": command})
        np.testing.assert_array_equal(again["apex_height"], direct["apex_height"])


def test_errors_of_sensors_are_undone_small_ones_and_exchanges() -> None:
    true = np.random.default_rng(0).normal(size=(3, 50))
    assert np.allclose(undone(lambda x: 1.1 * x + 0.02, 1.1 * true + 0.02), true, atol=5e-3)
    assert np.allclose(undone(lambda x: x[[1, 0, 2]], true[[1, 0, 2]]), true)
