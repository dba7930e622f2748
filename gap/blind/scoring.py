"""Scoring diagnoses of blind cases against the sealed key: every figure of the blind check, beside its target."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .answers import Case, load

BINS = ((0.5, 3.0), (3.0, 5.0), (5.0, 10.0), (10.0, 30.0), (30.0, 100.0), (100.0, np.inf))
_RESAMPLES = 400


@dataclass(frozen=True)
class Figure:
    """One figure with its 95 % bootstrap interval over ``n`` cases; ``target`` like ``>= 0.95``, or empty."""

    name: str
    value: float
    low: float
    high: float
    n: int
    target: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the value meets the target; None without target or cases."""
        if not self.target or not self.n:
            return None
        relation, bound = self.target.split()
        return self.value >= float(bound) if relation == ">=" else self.value <= float(bound)


@dataclass(frozen=True)
class Scorecard:
    """All figures of a blind check, and the commonest mistakes ``(truth, answer, times)``."""

    figures: tuple[Figure, ...]
    mistakes: tuple[tuple[str, str, int], ...] = ()
    cases: int = 0
    missing: int = 0
    per_case: tuple[dict[str, Any], ...] = field(default=(), repr=False)

    def __getitem__(self, name: str) -> Figure:
        """Figure by name. Raises KeyError."""
        for f in self.figures:
            if f.name == name:
                return f
        raise KeyError(name)

    def as_json(self) -> dict[str, Any]:
        """Plain data for ``json.dump``; figures without cases have null values."""
        figures = [{k: _plain(v) for k, v in asdict(f).items()} | {"met": f.met} for f in self.figures]
        return {
            "schema": "blind-score/1",
            "cases": self.cases,
            "missing_reports": self.missing,
            "figures": figures,
            "mistakes": [list(m) for m in self.mistakes],
            "per_case": list(self.per_case),
        }

    def as_text(self) -> str:
        """The figures as plain text, beside their targets."""
        head = f"{'figure':46s} {'value':>7s}  {'95 % interval':>15s} {'n':>5s}  target"
        lines = [f"{self.cases} cases, {self.missing} without a report", head, "-" * len(head)]
        for f in self.figures:
            if not f.n:
                lines.append(f"{f.name:46s} {'-':>7s}  {'':15s} {0:5d}  {f.target}")
                continue
            sign = {True: "met", False: "MISSED", None: ""}[f.met]
            interval = f"{f.low:.3f} - {f.high:.3f}"
            lines.append(f"{f.name:46s} {f.value:7.3f}  {interval:>15s} {f.n:5d}  {f.target:8s} {sign}".rstrip())
        if self.mistakes:
            lines += ["", "commonest mistakes (truth -> first answer):"]
            lines += [f"  {n:3d} x {truth} -> {answer}" for truth, answer, n in self.mistakes]
        return "\n".join(lines)


def _plain(value: object) -> object:
    return None if isinstance(value, float) and not np.isfinite(value) else value


Statistic = Callable[[Sequence[Case]], float]


def _figure(name: str, cases: Sequence[Case], statistic: Statistic, target: str = "") -> Figure:
    if not cases:
        return Figure(name, float("nan"), float("nan"), float("nan"), 0, target)
    rng = np.random.default_rng(0)
    draws = [statistic([cases[i] for i in rng.integers(len(cases), size=len(cases))]) for _ in range(_RESAMPLES)]
    finite = [d for d in draws if np.isfinite(d)] or [float("nan")]
    low, high = np.quantile(finite, [0.025, 0.975])
    return Figure(name, statistic(cases), float(low), float(high), len(cases), target)


def _share(test: Callable[[Case], bool]) -> Statistic:
    return lambda cases: float(np.mean([test(c) for c in cases]))


def _stage_right(c: Case) -> bool:
    if c.report is None or not c.report.where:
        return False
    return max(c.report.where, key=lambda p: p.probability).stage in c.stages


def calibration_error(cases: Sequence[Case]) -> float:
    """Expected calibration error of the first cause's probability, ten equal bins (Guo et al. 2017)."""
    rated = [c for c in cases if c.report and c.report.causes]
    if not rated:
        return float("nan")
    p = np.array([c.report.ranked[0].probability for c in rated if c.report])
    right = np.array([c.hit(1) for c in rated], float)
    cell = np.minimum((p * 10).astype(int), 9)
    return float(sum(abs(np.sum(right[cell == k] - p[cell == k])) for k in range(10)) / len(rated))


def unknown_recall(cases: Sequence[Case]) -> float:
    """Share of unknown effects found by the threshold on their score that flags at most 5 % of the known ones."""
    known = np.array([c.unknown_score for c in cases if c.tier != "T5"])
    hidden = np.array([c.unknown_score for c in cases if c.tier == "T5"])
    if not hidden.size:
        return float("nan")
    if not known.size:
        return float(np.mean(hidden > 0.5))
    # The smallest threshold that at most 5 % of the known exceed.
    threshold = np.sort(known)[::-1][int(0.05 * known.size)]
    return float(np.mean(hidden > threshold))


def _median(value: Callable[[Case], float | None]) -> Statistic:
    def statistic(cases: Sequence[Case]) -> float:
        found = [v for c in cases if (v := value(c)) is not None]
        return float(np.median(found)) if found else float("nan")

    return statistic


def _waveform_shrink(c: Case) -> float | None:
    return c.report.ranked[0].shrink.get("waveform") if c.report and c.report.causes else None


def _seconds(c: Case) -> float | None:
    seconds = c.report.cost.get("seconds") if c.report else None
    return None if seconds is None else float(seconds)


def evaluate(cases: Sequence[Case]) -> Scorecard:
    """Compute every figure; cases of several tiers may be mixed, each figure takes those it is about."""
    single = [c for c in cases if len(c.effects) == 1 and c.tier in ("T0", "T1", "T2", "T3")]
    asked = [c for c in single if c.tier in ("T2", "T3")]
    seen = [c for c in asked if c.delta >= 5]
    nothing = [c for c in cases if not c.effects]
    pairs = [c for c in cases if len(c.effects) == 2 and min(c.deltas) >= 5]
    unknown = [c for c in cases if c.delta >= 10 and (c.tier == "T5" or (c.effects and c.tier in ("T1", "T2", "T3")))]
    found = [c for c in seen if c.hit(1) and _waveform_shrink(c) is not None]
    faint = [c for c in asked if c.delta < 3]
    first, third = _share(lambda c: c.hit(1)), _share(lambda c: c.hit(3))
    effect = _share(lambda c: c.verdict in ("effect", "several"))
    alarm = _share(lambda c: c.false_alarm)
    free = [c for c in asked if (c.delta if c.delta_free is None else c.delta_free) >= 5]
    claims = [c for c in cases if c.claims and c.tier in ("T2", "T3")]
    sets = [c for c in seen if c.covered is not None]
    figures = [
        _figure("top-1, skin alone, delta_free >= 5", [c for c in free if not c.reference], first, ">= 0.80"),
        _figure("top-1, with references, delta_free >= 5", [c for c in free if c.reference], first, ">= 0.90"),
        _figure("right among claims", claims, _share(lambda c: bool(c.effects) and c.hit(1)), ">= 0.95"),
        _figure("coverage of the 90 % set", sets, _share(lambda c: bool(c.covered)), ">= 0.88"),
        _figure("size of the 90 % set (mean)", sets, lambda cs: float(np.mean([_size(c) for c in cs])), "<= 2"),
        _figure("top-1", seen, first, ">= 0.95"),
        _figure("top-3", seen, third, ">= 0.99"),
        _figure("stage", seen, _share(_stage_right), ">= 0.93"),
        _figure("top-1, delta > 30", [c for c in asked if c.delta > 30], first, ">= 0.90"),
        _figure("false alarms T0", [c for c in nothing if c.tier == "T0"], alarm, "<= 0.02"),
        _figure("false alarms T6", [c for c in nothing if c.tier == "T6"], alarm, "<= 0.05"),
        _figure("false alarms T1-T3 without effect", [c for c in nothing if c.tier in ("T1", "T2", "T3")], alarm),
        _figure("calibration error", seen, calibration_error, "<= 0.05"),
        _figure(
            "unknown found at 5 % false, delta >= 10",
            unknown if any(c.tier == "T5" for c in unknown) else [],
            unknown_recall,
            ">= 0.85",
        ),
        _figure("both of a pair in the top three", pairs, third, ">= 0.80"),
        _figure("coin tosses between equivalent effects", seen, _share(lambda c: c.coin_toss), "<= 0"),
        _figure("power at delta = 6", [c for c in asked if 4.5 < c.delta < 8], effect, ">= 0.80"),
        _figure("delta < 3 called undetectable", faint, _share(lambda c: c.verdict == "undetectable")),
        _figure(
            "delta < 3 called undetectable or none", faint, _share(lambda c: c.verdict in ("undetectable", "none"))
        ),
        _figure("shrink on another waveform (median; truth: 1)", found, _median(_waveform_shrink), ">= 0.95"),
        _figure("seconds a case (median)", [c for c in cases if _seconds(c) is not None], _median(_seconds), "<= 5"),
    ]
    for low, high in BINS:
        name = f"top-1, delta {low:g} - {high:g}" if np.isfinite(high) else f"top-1, delta >= {low:g}"
        figures.append(_figure(name, [c for c in asked if low <= c.delta < high], first))
    for tier in ("T1", "T2", "T3"):
        figures.append(_figure(f"top-1, {tier}", [c for c in single if c.tier == tier and c.delta >= 5], first))
    for instrument in sorted({c.instrument for c in cases}):
        quiet = [c for c in nothing if c.instrument == instrument and c.tier == "T6"]
        figures.append(_figure(f"false alarms T6, {instrument}", quiet, alarm, "<= 0.05"))
        figures.append(_figure(f"top-1, {instrument}", [c for c in seen if c.instrument == instrument], first))
    wrong = Counter((f"{c.instrument}: {c.effects[0]}", _answer(c)) for c in seen if not c.hit(1))
    mistakes = tuple((truth, answer, n) for (truth, answer), n in wrong.most_common(15))
    missing = sum(c.report is None for c in cases)
    return Scorecard(tuple(figures), mistakes, len(cases), missing, tuple(_row(c) for c in cases))


def _size(c: Case) -> int:
    return len(c.report.chosen or ()) if c.report else 0


def _answer(c: Case) -> str:
    if c.report is None or not c.report.causes or c.verdict not in ("effect", "several"):
        return c.verdict
    return "+".join(c.report.ranked[0].effects)


def _row(c: Case) -> dict[str, Any]:
    return {
        "case": c.name,
        "tier": c.tier,
        "instrument": c.instrument,
        "truth": list(c.effects),
        "delta": round(c.delta, 3),
        "delta_free": None if c.delta_free is None else round(c.delta_free, 3),
        "verdict": c.verdict,
        "answer": _answer(c),
        "hit": c.hit(1) if c.effects else None,
        "false_alarm": c.false_alarm if not c.effects else None,
    }


def score(
    reports: Path | str, key: Path | str | Sequence[Path | str], passphrase: str = "", least: float = 0.0
) -> Scorecard:
    """Score the folder ``reports`` (``<case>.json``, schema ``gap-report/1``) against one or several sealed keys.

    Cases whose effects have a δ_free below ``least`` are left out.

    Raises FileNotFoundError for a missing folder or key and ValueError for a wrong passphrase or malformed report.
    """
    folder = Path(reports)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder of reports")
    keys = [Path(key)] if isinstance(key, (str, Path)) else [Path(k) for k in key]
    return evaluate(load(folder, keys, passphrase, least))
