"""The diagnosis as JSON (`gap-report/1`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from gap.data.session import SKIN
from gap.decision.classes import Cause
from gap.decision.conformal import COVERAGE, chosen, shares, threshold
from gap.decision.posterior import Posterior
from gap.decision.qualified import moved
from gap.diagnosis import Diagnosis
from gap.report.assumed import assumed
from gap.report.breakdown import breakdown
from gap.report.parameters import has_no_size, of_cause, of_model, rounded
from gap.report.sentences import sentences
from gap.report.terms import of_term
from gap.report.words import options, words

SCHEMA = "gap-report/1"
UNCALIBRATED = "cumulative posterior probability; not conformal, as nothing is calibrated on such a rig"
CALIBRATED = ("cutometer", "aspiration", "microrobot")
NOT_ASKED = "not looked for: ask with --advise, or with acquire gap next"


def as_json(d: Diagnosis) -> dict[str, Any]:
    """The report as plain JSON types; the contract of gap-report/1."""
    p = d.verdict.posterior
    names, basis = conformal_set(d)
    return {
        "schema": SCHEMA,
        "verdict": d.verdict.verdict,
        "rules": list(d.verdict.rules),
        "sentences": sentences(d),
        "gap": {
            "before": rounded(d.gap_before),
            "after": rounded(d.gap_after),
            "noise_floor": 1.0,
            "by": breakdown(d),
        },
        "where": [{"stage": s, "probability": rounded(share)} for s, share in p.stages.items()],
        "causes": [cause_as_json(d, c, k) for k, c in enumerate(p.causes)],
        "none_probability": rounded(p.none),
        "outside_probability": rounded(p.outside),
        "unknown_probability": rounded(unknown_probability(d.verdict.verdict, p)),
        "set": names,
        "set_basis": basis,
        "unexplained": rounded(p.unexplained),
        "model": of_model(d),
        "qualification": qualification(d),
        "earlier": earlier(d),
        "term": of_term(d),
        "indistinguishable": [list(g) for g in d.confusable],
        "undetectable_below": {k: rounded(b) for k, b in d.bounds.items() if np.isfinite(b)},
        "signatures": [{"effect": s.effect, "channel": s.channel, "text": s.text} for s in d.signatures],
        "next_experiment": {},
        "next_experiment_note": NOT_ASKED,
        "assumed": assumed(d),
        "remarks": list(d.remarks),
        "recordings": [r.info.id for r in d.recordings],
        "cost": {"seconds": rounded(d.seconds), "simulations": d.comparison.simulations, "fe_solves": d.fe_solves},
    }


def qualification(d: Diagnosis) -> dict[str, Any] | None:
    """The findings of an earlier qualification, their gain, and the changes since; None where none was given."""
    known = d.qualified
    if known is None:
        return None
    q = known.qualification
    said: dict[str, Any] = {
        "file": known.file, "instrument": q.instrument, "serial": q.serial, "date": q.date.isoformat(),
        "believed": known.believed, "reason": known.reason,
    }  # fmt: skip
    if not known.believed or d.unqualified is None:
        return said
    p, t = d.verdict.posterior, d.thresholds
    without, beside = probable_set(d.unqualified, t.coverage), probable_set(p, t.coverage)
    changed = moved(d.problems, d.comparison.null.fits, known)
    if d.verdict.claims and p.causes:
        changed += known.changes(p.causes[0].hypothesis)
    gained = [name for name in without if name not in beside]
    text = f"ruled out: {', '.join(gained)}" if gained else "the set of explanations is the same without it"
    return said | {"set_without": without, "gained": gained, "gained_text": text, "changed": changed}


def earlier(d: Diagnosis) -> dict[str, Any] | None:
    """Earlier sessions of the person, their prior and its gain; None where none was given."""
    e = d.earlier
    if e is None:
        return None
    doubted = [{"session": name, "reason": reason} for name, reason in e.doubted.items()]
    if not e.believed:
        text = "no earlier session is used: " + "; ".join(f"{name}: {reason}" for name, reason in e.doubted.items())
    elif e.gains:
        name, (was, now) = max(e.gains.items(), key=lambda g: g[1][1] / max(g[1][0], 1e-9))
        text = f"{len(e.gains)} effects show at less strength with them, {words(name)} at {100 * was / now:.0f} % of it"
    else:
        text = "no effect shows at less strength with them"
    gained = {name: {"without": rounded(was), "with": rounded(now)} for name, (was, now) in e.gains.items()}
    return {
        "believed": list(e.believed), "doubted": doubted, "parameters": list(e.told), "changed": list(e.changed),
        "detectability": gained, "text": text,
    }  # fmt: skip


def unknown_probability(verdict: str, p: Posterior) -> float:
    """How surely the gap is not one of the library's, if anything acts: above a half just where that is the verdict."""
    return 0.55 + 0.45 * p.lacking if verdict == "unknown" else min(p.lacking, 0.5)


def conformal_set(d: Diagnosis) -> tuple[list[str], str]:
    """The effects, ``none`` and ``outside`` among which the right one is in nine sessions of ten; and on what that
    rests. A rig of a user's has no calibration: there it is the most probable that have nine tenths together."""
    p, first = d.verdict.posterior, d.recordings[0].info
    entries = shares([(c.probability, c.names) for c in p.causes], p.none, p.outside)
    if first.instrument not in CALIBRATED:
        return probable_set(p, d.thresholds.coverage), UNCALIBRATED
    t = threshold(first.instrument, any(r.info.specimen != SKIN for r in d.recordings))
    basis = f"split-conformal, {100 * COVERAGE:.0f} %: {t.n} simulated sessions ({t.group}), score up to {t.score:.3f}"
    return chosen(entries, t), basis


def probable_set(p: Posterior, coverage: float) -> list[str]:
    """The smallest set of classes, ``none`` and ``outside`` whose probabilities add up to ``coverage``: the names in
    it, the most probable class first."""
    entries: list[tuple[float, tuple[str, ...]]] = [(c.probability, c.names) for c in p.causes]
    entries += [(p.none, ("none",)), (p.outside, ("outside",))]
    names: list[str] = []
    total = 0.0
    for probability, members in sorted(entries, key=lambda e: -e[0]):
        if total >= coverage:
            break
        names += [n for n in members if n not in names]
        total += probability
    return names


def cause_as_json(d: Diagnosis, cause: Cause, rank: int) -> dict[str, Any]:
    """A cause, the ``rank``-th, as an entry of ``causes``; without parameters and shrinks where its noise tells it."""
    by_noise = rank == 0 and has_no_size(d, cause)
    shrinks = d.shrinks[rank] if rank < len(d.shrinks) and not by_noise else {}  # only the first few are tried
    return {
        "effects": [e.name for e in cause.effects],
        "class": list(cause.names),
        "stages": [e.stage for e in cause.effects],
        "where": [e.key for e in cause.effects],
        "options": [options(e, d.recordings[0].info.instrument) for e in cause.effects],
        "probability": rounded(cause.probability),
        "parameters": {} if by_noise else of_cause(d, cause),
        "detectability": rounded(cause.detectability),
        "tolerated": cause.tolerated,
        "meaning": [e.meaning for e in cause.effects],
        "remedy": [e.remedy for e in cause.effects],
        "told_by_noise": by_noise,
        "shrink": {k: None if s.value is None else rounded(s.value) for k, s in shrinks.items()} or {"fitted": None},
        "gaps": {k: {"before": rounded(s.before), "after": rounded(s.after)} for k, s in shrinks.items()},
    }
