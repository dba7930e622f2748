"""The conformal set: names that hold the right one with a stated probability, whatever the model's errors.

Split-conformal prediction with the regularised cumulative score (Romano, Sesia and Candès 2020; Angelopoulos et al.
2021): names — of effects, none, outside — are ranked by their share of the probability, and a name's score is the
share of those down to it plus a penalty for its rank. The threshold is that quantile of the true names' scores in
simulated sessions that finite n demands (``conformal.yaml``; ``benchmarks/blind/conformal.py`` makes it). An effect
that no class of any weight names is covered by ``outside``: none of these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import yaml

PENALTY = 0.05
"""Score of one rank: where probabilities are near 0 or 1, ranks tell more than sums."""
NEGLIGIBLE = 0.005
"""Probability of a class below which its names are not in the set: what it stands for is ``outside`` then."""
NEXT = 0.5
"""Share of a class's next member in that of the one before: data cannot split them, and yet the first leads more often
than chance."""
COVERAGE = 0.9
FEWEST = 30
"""Sessions from which an instrument has a threshold of its own; below, that of all together holds."""
NONE, OUTSIDE = "none", "outside"

Entry = tuple[float, str]
"""Share of the probability, and the name: of an effect, of a pair (``a + b``), none or outside."""


@dataclass(frozen=True)
class Threshold:
    """Largest score of an entry in the set, from ``n`` sessions of the ``group``; inf where n is too small for any."""

    group: str
    n: int
    score: float


def shares(classes: Sequence[tuple[float, Sequence[str]]], none: float, outside: float) -> list[Entry]:
    """The simplex by names: a class's probability is shared among its members, the leader first. The first class is
    always there, others unless they are negligible."""
    out = [(none, NONE), (outside, OUTSIDE)]
    for k, (probability, members) in enumerate(sorted(classes, key=lambda c: -c[0])):
        if k and probability < NEGLIGIBLE:
            break
        names = list(dict.fromkeys(members))
        weights = [NEXT**j for j in range(len(names))]
        out += [(probability * w / sum(weights), name) for w, name in zip(weights, names, strict=True)]
    return out


def ranked(entries: Sequence[Entry]) -> list[tuple[float, str]]:
    """Names with their scores, the most probable first."""
    out, total = [], 0.0
    for k, (probability, name) in enumerate(sorted(entries, key=lambda e: -e[0])):
        total += probability
        out.append((total + PENALTY * k, name))
    return out


def score(entries: Sequence[Entry], truth: Sequence[str]) -> float:
    """The least threshold whose set holds ``truth`` (effects; nothing for none), or ``outside`` where no name does."""
    first: dict[str, float] = {}
    for reached, name in ranked(entries):
        for part in name.split(" + "):
            first.setdefault(part, reached)
    wanted = set(truth) or {NONE}
    return max(first[name] for name in wanted) if wanted <= first.keys() else first[OUTSIDE]


def quantile(scores: Sequence[float], coverage: float = COVERAGE) -> float:
    """The score below which a further session's lies with a probability of ``coverage`` at least: the
    ⌈(n + 1) coverage⌉-th smallest, inf where there are too few."""
    k = math.ceil((len(scores) + 1) * coverage)
    return sorted(scores)[k - 1] if k <= len(scores) else math.inf


def chosen(entries: Sequence[Entry], threshold: Threshold) -> list[str]:
    """The names in the set, the most probable first; the first one is always in it."""
    rows = ranked(entries)
    return list(dict.fromkeys(name for k, (reached, name) in enumerate(rows) if k == 0 or reached <= threshold.score))


@cache
def thresholds() -> dict[str, Threshold]:
    """Thresholds by group: ``all``, and instruments with (``+``) or without references."""
    table = yaml.safe_load(files("gap.decision").joinpath("conformal.yaml").read_text(encoding="utf-8"))
    return {g: Threshold(g, int(t["n"]), float(t["score"])) for g, t in table["groups"].items()}


def group(instrument: str, references: bool) -> str:
    return f"{instrument}+" if references else instrument


def threshold(instrument: str, references: bool) -> Threshold:
    """The threshold for a session: that of its group if it has `FEWEST` sessions, else that of all."""
    own = thresholds().get(group(instrument, references))
    return own if own is not None and own.n >= FEWEST else thresholds()["all"]
