"""Who chooses the next experiment: ours, chance, or a fixed order. The latter two are for comparison. All stop once a
cause is certain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from gap.data.session import SKIN
from gap.design.bench import leg_of
from gap.design.catalogue import catalogue
from gap.design.choice import Choice, certain, choose
from gap.design.experiment import Experiment
from protocols import Limits

Policy = Callable[[Mapping[str, Any], Sequence[Recording], Limits, int], Choice]
"""From a report, its recordings, limits and a number (which experiment it is, from 0) to a choice."""
SUCTION = ("rigid block", "reference membrane", "gauge step", SKIN)
ROBOT = ("open air", "reference spring", "dead weight", SKIN)
"""Specimens in the order of a laboratory that always does the same."""


def ours(seed: int, specimens: Sequence[str] = ()) -> Policy:
    """The experiment that is expected to tell most in a minute; ``specimens`` are those at hand, if not all."""
    return lambda report, recordings, limits, k: choose(report, recordings, limits, None, specimens, seed + k)


def by_chance(seed: int, specimens: Sequence[str] = ()) -> Policy:
    """Any experiment of the catalogue."""

    def policy(report: Mapping[str, Any], recordings: Sequence[Recording], limits: Limits, k: int) -> Choice:
        if (done := certain(report, recordings[0].info.instrument)) is not None:
            return done
        every = _every(recordings, limits, specimens, seed + k)
        which = np.random.default_rng([seed, k]).permutation(len(every))[:1]
        return _chosen([every[int(i)] for i in which], recordings)

    return policy


def in_order(seed: int, specimens: Sequence[str] = ()) -> Policy:
    """The first waveform on each specimen in turn."""

    def policy(report: Mapping[str, Any], recordings: Sequence[Recording], limits: Limits, k: int) -> Choice:
        if (done := certain(report, recordings[0].info.instrument)) is not None:
            return done
        order = ROBOT if recordings[0].info.instrument == "microrobot" else SUCTION
        every = _every(recordings, limits, specimens, seed + k)
        return _chosen([e for e in every if e.specimen == order[k % len(order)]], recordings)

    return policy


def first_claim(policy: Policy) -> Policy:
    """The same, but that it stops at the first claim: a cause named with more than even odds."""

    def stopping(report: Mapping[str, Any], recordings: Sequence[Recording], limits: Limits, k: int) -> Choice:
        if claims(report):
            cause = report["causes"][0]
            reason = f"{' and '.join(cause['effects'])} is claimed ({cause['probability']:.2f})"
            return Choice(recordings[0].info.instrument, None, reason, float(cause["probability"]), ())
        return policy(report, recordings, limits, k)

    return stopping


def claims(report: Mapping[str, Any]) -> bool:
    """Whether a report names a cause with more than even odds."""
    named = report["verdict"] in ("effect", "several")
    return named and any(float(c["probability"]) > 0.5 for c in report["causes"])


POLICIES: Mapping[str, Callable[[int, Sequence[str]], Policy]] = {
    "ours": ours, "random": by_chance, "fixed": in_order,
}  # fmt: skip


def policy_of(name: str) -> Callable[[int, Sequence[str]], Policy]:
    """The policy of a name. Raises ValueError that lists the policies."""
    if name not in POLICIES:
        raise ValueError(f"unknown policy {name!r}: one of {', '.join(POLICIES)}")
    return POLICIES[name]


def _every(recordings: Sequence[Recording], limits: Limits, specimens: Sequence[str], seed: int) -> list[Experiment]:
    legs = [leg_of(r) for r in recordings]
    return catalogue(recordings[0].info.instrument, legs, limits, specimens, seed)


def _chosen(some: Sequence[Experiment], recordings: Sequence[Recording]) -> Choice:
    instrument = recordings[0].info.instrument
    if not some:
        return Choice(instrument, None, "no experiment is within the limits", 0.0, ())
    return Choice(instrument, some[0], "", 0.0, ())
