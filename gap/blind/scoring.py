"""Scoring diagnoses of blind cases against the sealed key: every figure of the blind check, beside its target."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .answers import Case, load
from .figures import Figure, definitions, seen


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


def evaluate(cases: Sequence[Case]) -> Scorecard:
    """Compute every figure; cases of several tiers may be mixed, each figure takes those it is about."""
    return Scorecard(
        figures=tuple(definition.figure(cases) for definition in definitions(cases)),
        mistakes=_mistakes(cases),
        cases=len(cases),
        missing=sum(c.report is None for c in cases),
        per_case=tuple(_row(c) for c in cases),
    )


def _mistakes(cases: Sequence[Case]) -> tuple[tuple[str, str, int], ...]:
    """The commonest wrong answers to effects that were strong enough: (truth, answer, times)."""
    wrong = Counter((f"{c.instrument}: {c.effects[0]}", _answer(c)) for c in cases if seen(c) and not c.hit(1))
    return tuple((truth, answer, n) for (truth, answer), n in wrong.most_common(15))


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
