"""The effects that may be hidden in a session, by its instrument and its recordings."""

from __future__ import annotations

import numpy as np

from gap.inference.hypothesis import Candidate
from gap.null.instruments import _possible


def test_a_clock_that_begins_anew_does_not_wander_through_the_session(recording) -> None:
    time = np.arange(0.0, 10.0, 0.01)
    own = [recording({"pressure": 0 * time}, time, {"pressure": ([0, 10], [0, 0])}) for _ in range(2)]
    one = [own[0], recording({"pressure": 0 * time}, time + 20, {"pressure": ([20, 30], [0, 0])})]
    candidates = [
        Candidate(f"{name}[form={form}]", name, "timing", (), ("pressure",), form=form)
        for name, form in (("clock_skew", 0), ("clock_skew", 1), ("clock_skew", 2), ("latency", 1), ("latency", 2))
    ]
    assert [(c.name, c.form) for c in _possible(candidates, own)] == [("clock_skew", 0), ("latency", 2)]
    assert list(_possible(candidates, one)) == candidates
