"""The conformal set: its threshold at finite n, its coverage on draws, and what it holds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gap.decision.conformal import (
    FEWEST,
    PENALTY,
    Threshold,
    chosen,
    quantile,
    score,
    shares,
    threshold,
    thresholds,
)

CLASSES = [(0.6, ("leak", "gauge_gain")), (0.03, ("latency + jitter",)), (0.001, ("rim_leak",))]
ENTRIES = shares(CLASSES, 0.25, 0.119)


def test_the_threshold_is_the_order_statistic_that_finite_n_demands() -> None:
    assert quantile(range(1, 10)) == 9  # ⌈10 · 0.9⌉ = 9 of 9
    assert quantile(range(1, 9)) == math.inf  # too few for 90 %
    assert quantile(range(1, 100)) == 90


def test_a_class_s_probability_is_its_members_and_a_negligible_class_is_outside() -> None:
    assert dict((name, p) for p, name in ENTRIES) == pytest.approx(
        {"leak": 0.4, "none": 0.25, "gauge_gain": 0.2, "outside": 0.119, "latency + jitter": 0.03}
    )
    assert shares([(0.001, ("rim_leak",))], 0.9, 0.099)[-1] == (0.001, "rim_leak")  # the first is there whatever it is


def test_a_score_is_that_of_the_truth_s_name() -> None:
    assert score(ENTRIES, ["leak"]) == pytest.approx(0.4)
    assert score(ENTRIES, []) == pytest.approx(0.65 + PENALTY)
    assert score(ENTRIES, ["gauge_gain"]) == pytest.approx(0.85 + 2 * PENALTY)
    assert score(ENTRIES, ["rim_leak"]) == pytest.approx(0.969 + 3 * PENALTY)  # of no weight: outside
    assert score(ENTRIES, ["latency", "jitter"]) == pytest.approx(0.999 + 4 * PENALTY)


def test_the_set_grows_with_the_threshold_and_holds_everything_without_one() -> None:
    assert chosen(ENTRIES, Threshold("all", 24, 0.1)) == ["leak"]
    assert chosen(ENTRIES, Threshold("all", 24, 0.9)) == ["leak", "none"]
    assert len(chosen(ENTRIES, Threshold("all", 5, math.inf))) == 5


def test_it_covers_what_it_says_whatever_the_probabilities_are_worth() -> None:
    """Overconfident probabilities: one minus a small number on a guess that is right in half of the cases."""
    rng = np.random.default_rng(3)

    def case() -> tuple[list[tuple[float, str]], list[str]]:
        rest = np.sort(rng.dirichlet(np.ones(5)))[::-1] * 0.02
        entries = [(0.98, "a"), *((float(p), n) for p, n in zip(rest, ("none", "outside", "b", "c", "d"), strict=True))]
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
