"""The gap before and after by channel, phase, level, direction and repeat."""

from __future__ import annotations

import numpy as np

from gap.data.labels import LABELS
from gap.diagnosis import Diagnosis
from gap.report.parameters import rounded


def breakdown(d: Diagnosis) -> dict[str, dict[str, dict[str, float]]]:
    """Gap before and after by each label's values."""
    out: dict[str, dict[str, dict[str, float]]] = {}
    for label in LABELS:
        sums: dict[str, np.ndarray] = {}
        for name, problem in d.problems.items():
            codes, names = problem.rows.labels[label]
            before = d.null.fits[name].residual ** 2
            after = d.best.fits[name].residual ** 2
            for k, value in enumerate(names):
                at = codes == k
                part = np.array([before[at].sum(), after[at].sum(), at.sum()])
                sums[value] = sums.get(value, np.zeros(3)) + part
        out[label] = {
            value: {"before": rounded(np.sqrt(s[0] / s[2])), "after": rounded(np.sqrt(s[1] / s[2]))}
            for value, s in sums.items()
            if s[2] and value != "-"
        }
    return out
