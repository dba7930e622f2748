"""The numbers that settle a verdict, read from ``thresholds.yaml``, where each has a unit, a meaning and a source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from importlib.resources import files
from typing import Any

import yaml

from gap.inference.hypothesis import Candidate

LIKE_SKIN = ("support_slip", "strain_stiffening", "missing_deep_layer", "prestress_anisotropy", "sensor_low_pass")
"""Effects that skin of another law imitates: what yields in its plane slips, any sheet has an elastic curve, and one of
its own kind another in each direction; one that answers later than the law's quickest part lags as a sensor does."""


@dataclass(frozen=True)
class Thresholds:
    """One value for each entry of ``thresholds.yaml``, in its unit; what it means is told there."""

    prior_effect: float
    prior_pair: float
    prior_outside: float
    mark: float
    mark_share: float
    detect: float
    seen: float
    seen_strained: float
    seen_event: float
    seen_like_skin: float
    seen_faint: float
    faint: float
    seen_marked: float
    quiet_gap: float
    unusual_gap: float
    unexplained_gap: float
    sure_none: float
    separable: float
    blunt: float
    evidence_tie: float
    skin_tie: float
    odds: float
    edges_share: float
    lead: float
    transfer_lead: float
    second_share: float
    second_excess: float
    second_above: float
    second_least: float
    at_once: float
    same_edges: float
    skin_before: float
    chance: float
    chance_memory: float
    chance_walk: float
    unearned: float
    unknown: float
    sure: float
    patched: float
    event_leaves: float
    unfinished_pair: float
    unnamed: float
    unseen: float
    tolerances: float
    least_fall: float
    small_fall: float
    least_share: float
    least_of_all: float
    weakest: float
    at_bound: float
    helps: float
    helps_squares: float
    worse_repeat: float
    worse_elsewhere: float
    worse_share: float
    worse_block: float
    carries_over: float
    amid_skin: float
    amid_share: float
    amid_sure: float
    left_elsewhere: float
    input_gap: float
    carried_share: float
    untested_gap: float
    rival_lead: float
    without_skin: float
    overwhelming: float
    like_skin: float
    surrogate: float
    coverage: float

    def seen_of(self, effects: Sequence[Candidate]) -> float:
        """Detectability that ``effects`` need to be named."""
        like_skin = self.seen_like_skin if any(e.name in LIKE_SKIN for e in effects) else 0.0
        return max(self.seen_event if any(e.event for e in effects) else self.seen, like_skin)


@cache
def provenance() -> dict[str, dict[str, Any]]:
    """The entries of ``thresholds.yaml``: value, unit, meaning, source, and the value for rigs where it differs."""
    text = files("gap.decision").joinpath("thresholds.yaml").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text))


def thresholds(kind: str = "value") -> Thresholds:
    """The thresholds of our instruments (``value``) or of a user's model (``rig``)."""
    table = provenance()
    return Thresholds(**{f.name: float(table[f.name].get(kind, table[f.name]["value"])) for f in fields(Thresholds)})


INSTRUMENT, RIG = thresholds(), thresholds("rig")
