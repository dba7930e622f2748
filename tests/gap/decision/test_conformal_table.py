"""The script that makes the conformal table, from reports and keys."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from benchmarks.blind import conformal
from gap.blind.lock import seal
from gap.decision.conformal import FEWEST


def made(root: Path, instrument: str, n: int, right: float) -> tuple[Path, Path]:
    """Reports and key of ``n`` sessions with a leak, of which a share is right; and one that is too faint to count."""
    rng, cases = np.random.default_rng(1), []
    (root / "reports").mkdir(parents=True)
    for k in range(n + 1):
        name = f"case-{instrument}-{k}"
        hidden = [{"concept": "leak"}]
        cases.append({"case": name, "tier": "T2", "instrument": instrument, "reference": False, "effects": hidden,
                      "delta_free": 9.0 if k < n else 1.0})  # fmt: skip
        first = "leak" if rng.random() < right else "latency"
        report = {"causes": [{"probability": 0.8, "class": [first, "gauge_gain"]}], "none_probability": 0.05,
                  "outside_probability": 0.15}  # fmt: skip
        (root / "reports" / f"{name}.json").write_text(json.dumps(report))
    (root / "key.bin").write_bytes(seal(json.dumps({"cases": cases}).encode(), ""))
    return root / "reports", root / "key.bin"


def test_a_group_has_its_own_threshold_where_it_has_enough_sessions(tmp_path: Path) -> None:
    sure = conformal.cases(*made(tmp_path / "a", "cutometer", FEWEST + 10, 1.0), 5.0, "")
    poor = conformal.cases(*made(tmp_path / "b", "aspiration", 20, 0.5), 5.0, "")
    assert (len(sure), len(poor)) == (FEWEST + 10, 20)
    groups, scores = conformal.table([*sure, *poor])
    assert groups["cutometer"]["n"] == FEWEST + 10
    assert groups["cutometer"]["score"] < groups["all"]["score"]
    held, sizes = conformal.left_out([*sure, *poor], scores)
    assert all(held)
    assert set(sizes[: len(sure)]) == {1}  # the leader alone is right: its class need not be taken whole
    assert min(sizes[len(sure) :]) > 1
