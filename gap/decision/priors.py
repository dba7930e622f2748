"""The probability of hypotheses before any data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gap.decision.thresholds import Thresholds
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from sim_devices.chain import FloatArray


def log_priors(every: Sequence[Hypothesis], candidates: Sequence[Candidate], t: Thresholds) -> FloatArray:
    """log prior of each hypothesis: concepts are equally probable, and the forms of one share its prior."""
    names = [c.name for c in candidates]
    n = len(set(names)) or 1
    pairs = max(n * (n - 1) / 2, 1)
    one, two = np.log(t.prior_effect / n), np.log(t.prior_pair / pairs)
    out = np.full(len(every), np.log(1.0 - t.prior_effect - t.prior_pair))
    for k, h in enumerate(every):
        if h.effects:
            shared = sum(np.log(max(names.count(e.name), 1)) for e in h.effects)
            out[k] = (one if len(h.effects) == 1 else two) - shared
    return out
