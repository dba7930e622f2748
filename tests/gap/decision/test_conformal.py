"""The conformal set: its threshold at finite n, its coverage on draws, and what it holds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gap.decision.conformal import FEWEST, Threshold, chosen, quantile, score, threshold, thresholds

ENTRIES = [(0.5, ("leak", "gauge_gain")), (0.3, ("none",)), (0.15, ("outside",)), (0.05, ("latency + jitter",))]


def test_the_threshold_is_the_order_statistic_that_finite_n_demands() -> None:
    assert quantile(range(1, 10)) == 9  # ⌈10 · 0.9⌉ = 9 of 9
    assert quantile(range(1, 9)) == math.inf  # too few for 90 %
    assert quantile(range(1, 100)) == 90


def test_a_score_is_that_of_the_truths_entry() -> None:
    assert score(ENTRIES, ["gauge_gain"]) == pytest.approx(0.5)
    assert score(ENTRIES, []) == pytest.approx(0.8 + 0.01)
    assert score(ENTRIES, ["latency", "jitter"]) == pytest.approx(1.0 + 0.03)
    assert score(ENTRIES, ["rim_leak"]) == pytest.approx(0.95 + 0.02)  # named nowhere: outside


def test_the_set_grows_with_the_threshold_and_holds_everything_without_one() -> None:
    assert chosen(ENTRIES, Threshold("all", 24, 0.1)) == ["leak", "gauge_gain"]
    assert chosen(ENTRIES, Threshold("all", 24, 0.9)) == ["leak", "gauge_gain", "none"]
    assert len(chosen(ENTRIES, Threshold("all", 5, math.inf))) == 5


def test_it_covers_what_it_says_whatever_the_probabilities_are_worth() -> None:
    """Overconfident probabilities: one minus a small number on a guess that is right in half of the cases."""
    rng = np.random.default_rng(3)

    def case() -> tuple[list[tuple[float, tuple[str, ...]]], list[str]]:
        rest = np.sort(rng.dirichlet(np.ones(5)))[::-1] * 0.02
        entries = [
            (0.98, ("a",)),
            *((float(p), (n,)) for p, n in zip(rest, ("none", "outside", "b", "c", "d"), strict=True)),
        ]
        return entries, [str(rng.choice(["a", "b", "c", "d"], p=[0.5, 0.3, 0.15, 0.05]))]

    held = []
    for _ in range(40):
        t = Threshold("all", 50, quantile([score(*case()) for _ in range(50)]))
        held += [set(truth) <= set(chosen(entries, t)) for entries, truth in (case() for _ in range(25))]
    assert 0.87 < np.mean(held) < 0.97


def test_the_shipped_table_is_used_by_group_only_where_it_has_enough_sessions() -> None:
    table = thresholds()
    assert table["all"].n >= 9
    assert math.isfinite(table["all"].score)
    for instrument in ("cutometer", "aspiration", "microrobot"):
        for references in (False, True):
            t = threshold(instrument, references)
            assert t.group == "all" or t.n >= FEWEST
