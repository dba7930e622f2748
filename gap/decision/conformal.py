"""The conformal set: classes that hold the right one with a stated probability, whatever the model's errors.

Split-conformal prediction with the regularised cumulative score (Romano, Sesia and Candès 2020; Angelopoulos et al.
2021): entries — classes, none, outside — are ranked by probability, and an entry's score is the probability of those
down to it plus a penalty for its rank. The threshold is that quantile of the true entries' scores in simulated sessions
that finite n demands (``conformal.yaml``; ``benchmarks/blind/conformal.py`` makes it). An effect that no class names is
covered by ``outside``: none of these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import yaml

PENALTY = 0.01
"""Score of one rank: where probabilities are near 0 or 1, ranks tell more than sums."""
COVERAGE = 0.9
FEWEST = 30
"""Sessions from which an instrument has a threshold of its own; below, that of all together holds."""
NONE, OUTSIDE = "none", "outside"

Entry = tuple[float, tuple[str, ...]]
"""Probability, and the names that it stands for."""


@dataclass(frozen=True)
class Threshold:
    """Largest score of an entry in the set, from ``n`` sessions of the ``group``; inf where n is too small for any."""

    group: str
    n: int
    score: float


def ranked(entries: Sequence[Entry]) -> list[tuple[float, tuple[str, ...]]]:
    """Entries with their scores, the most probable first."""
    out, total = [], 0.0
    for k, (probability, names) in enumerate(sorted(entries, key=lambda e: -e[0])):
        total += probability
        out.append((total + PENALTY * k, names))
    return out


def score(entries: Sequence[Entry], truth: Sequence[str]) -> float:
    """The score of the entry that holds ``truth`` (effects; nothing for none): a class, else ``outside``."""
    rows = ranked(entries)
    wanted = set(truth) or {NONE}
    held = [s for s, names in rows if wanted <= {part for name in names for part in name.split(" + ")}]
    return held[0] if held else next(s for s, names in rows if OUTSIDE in names)


def quantile(scores: Sequence[float], coverage: float = COVERAGE) -> float:
    """The score below which a further session's lies with a probability of ``coverage`` at least: the
    ⌈(n + 1) coverage⌉-th smallest, inf where there are too few."""
    k = math.ceil((len(scores) + 1) * coverage)
    return sorted(scores)[k - 1] if k <= len(scores) else math.inf


def chosen(entries: Sequence[Entry], threshold: Threshold) -> list[str]:
    """The names in the set, the most probable first; the first entry is always in it."""
    names: list[str] = []
    for k, (reached, members) in enumerate(ranked(entries)):
        if k == 0 or reached <= threshold.score:
            names += [n for n in members if n not in names]
    return names


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
