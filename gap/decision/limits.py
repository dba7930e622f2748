"""Limits of the data: groups of effects that no fit can split, and effects too weak to show."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from gap.decision.thresholds import Thresholds
from gap.decision.tolerance import Stated
from gap.decision.verdict import Verdict
from gap.inference.evidence import Hypothesis
from gap.search.compare import Comparison


def bounds(
    comparison: Comparison, tempers: Mapping[str, float], t: Thresholds, stated: Stated | None = None
) -> dict[str, float]:
    """For each effect, the strength from which on it would have been named, as far as straight lines tell; inf where
    none in the prior would. It stands out by as many σ as a claim needs, each block as far as it is trusted, and
    exceeds any ``stated`` tolerance as often as a finding must."""
    trust = comparison.weighed(tempers)[id(comparison.null)].trust
    out: dict[str, float] = {}
    for s in comparison.screened:
        strengths = [k for k, p in enumerate(s.candidate.parameters) if p.null is not None]
        if not strengths or not s.detectability:
            continue
        p = s.candidate.parameters[strengths[0]]
        believed = min(trust[b] / tempers[b] for b in s.candidate.blocks)
        sizes = ((abs(s.candidate.values(u)[p.name] - (p.null or 0.0)), d) for u, d in s.detectability)
        asked = t.seen_of([s.candidate]) / np.sqrt(believed)
        # Of several strengths others may act at a point, and this one not.
        per_strength = [asked * size / d for size, d in sizes if d > 0 and size > 0]
        bound = float(np.median(per_strength)) if per_strength else float("inf")
        if stated and not s.candidate.event and (known := stated.get(s.candidate.name, {}).get(p.name)) is not None:
            bound = max(bound, t.tolerances * known.value)
        out[s.candidate.key] = min(bound, out.get(s.candidate.key, float("inf")))
    return out


def beyond_the_fitted(found: Mapping[str, float], verdict: Verdict) -> dict[str, float]:
    """Bounds that do not contradict a verdict: of an effect that came first and was not claimed they are no less than
    the strength that fits best, and of one that was claimed no more."""
    out = dict(found)
    if not verdict.causes or len(verdict.causes[0].effects) > 1:
        return out
    nearer = min if verdict.claims else max
    for h in verdict.causes[0].members or (verdict.causes[0].hypothesis,):
        e = h.effects[0]
        strength = next((p for p in e.parameters if p.null is not None), None)
        if e.key in out and strength is not None:
            fitted = h.values(e)[strength.name]
            out[e.key] = nearer(out[e.key], abs(fitted - (strength.null or 0.0)))
    return out


def confusable(
    comparison: Comparison, temper: Mapping[str, float], like: float = 0.985, apart: float = 3.0
) -> tuple[tuple[str, ...], ...]:
    """Groups of effects that no fit of these data can split, in the forms that fit them best.

    Their traces, after the nuisance refit, are the same direction and end less than ``apart`` σ from each other. (Of a
    large effect, poor copies too have nearly its direction, but what they leave gives them away.)
    """
    best: dict[str, Hypothesis] = {}
    for h in sorted(comparison.hypotheses, key=lambda h: h.deviance):
        if len(h.effects) == 1:
            best.setdefault(h.effects[0].name, h)
    null, traces = comparison.null, {}
    for name, h in best.items():
        parts = [(null.fits[b].residual - h.fits[b].residual) / np.sqrt(temper[b]) for b in comparison.problems]
        if np.any(change := np.concatenate(parts)):
            traces[name] = change
    groups: list[set[str]] = []
    for one, other in combinations(traces, 2):
        a, b = traces[one], traces[other]
        alike = abs(float(a @ b)) > like * np.linalg.norm(a) * np.linalg.norm(b)
        if alike and np.linalg.norm(a - b) < apart:
            touching = [g for g in groups if one in g or other in g]
            groups = [g for g in groups if g not in touching] + [{one, other}.union(*touching)]
    return tuple(tuple(sorted(g)) for g in groups)
