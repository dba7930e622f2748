"""The answers of a diagnosis about blind cases, beside their hidden effects."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .lock import unseal
from .tolerated import within_tolerance
from .vocabulary import CONCEPTS

NEGLIGIBLE = 0.005
"""Probability of a cause below which ``outside`` in a report's set stands for it, too (docs/gap.md)."""
TOSS = 0.2
"""Probability from which a second cause counts as named."""


class Cause(BaseModel):
    """An entry of ``causes`` in a ``gap-report/1``; fields the scorer does not need are ignored."""

    model_config = ConfigDict(extra="ignore", populate_by_name=True)
    effects: list[str]
    members: list[str] = Field(default_factory=list, alias="class")
    probability: float = Field(ge=0.0, le=1.0)
    shrink: dict[str, float | None] = Field(default_factory=dict)

    @property
    def names(self) -> set[str]:
        """Every effect that this cause stands for."""
        return set(self.effects) | set(self.members)


class Place(BaseModel):
    """An entry of ``where``."""

    model_config = ConfigDict(extra="ignore")
    stage: str
    probability: float = 0.0


class Report(BaseModel):
    """The parts of a ``gap-report/1`` that are scored."""

    model_config = ConfigDict(extra="ignore", populate_by_name=True)
    verdict: str
    where: list[Place] = Field(default_factory=list)
    causes: list[Cause] = Field(default_factory=list)
    unknown_probability: float | None = None
    indistinguishable: list[list[str]] = Field(default_factory=list)
    cost: dict[str, Any] = Field(default_factory=dict)
    chosen: list[str] | None = Field(default=None, alias="set")

    @property
    def ranked(self) -> list[Cause]:
        """Causes, the most probable first."""
        return sorted(self.causes, key=lambda c: -c.probability)


@dataclass(frozen=True)
class Case:
    """Truth and answer of one case. ``report`` is None where the diagnosis delivered none (counted as wrong);
    ``tolerated``, whether all that is hidden lies within twice a stated tolerance."""

    name: str
    tier: str
    instrument: str
    effects: tuple[str, ...]
    stages: tuple[str, ...]
    deltas: tuple[float, ...]
    delta: float
    report: Report | None
    delta_free: float | None = None
    reference: bool = False
    tolerated: bool = False

    @property
    def claims(self) -> bool:
        """Whether a cause is claimed: named with more than even odds."""
        named = self.verdict in ("effect", "several")
        return named and self.report is not None and any(c.probability > 0.5 for c in self.report.causes)

    @property
    def covered(self) -> bool | None:
        """Whether the report's set holds what is hidden; None without a set. ``outside`` in it stands for what none of
        the report's classes names, but for negligible ones."""
        if self.report is None or self.report.chosen is None:
            return None
        chosen = {part for name in self.report.chosen for part in name.split(" + ")}
        weighty = [c for k, c in enumerate(self.report.ranked) if k == 0 or c.probability >= NEGLIGIBLE]
        nowhere = not any(set(self.effects) <= cause.names for cause in weighty)
        return set(self.effects) <= chosen or (nowhere and "outside" in chosen)

    def hit(self, top: int) -> bool:
        """Whether the hidden effects are all among the ``top`` causes, or in their classes."""
        if self.report is None:
            return False
        named = set[str]().union(*(c.names for c in self.report.ranked[:top]))
        return set(self.effects) <= named

    @property
    def verdict(self) -> str:
        return self.report.verdict if self.report else "missing"

    @property
    def false_alarm(self) -> bool:
        """A device effect that leads a class of more than even odds; a missing report counts as one. That the class may
        hold an effect of the tissue, too, does not help who reads the first name."""
        if self.report is None:
            return True
        if self.verdict in ("none", "unknown", "undetectable"):
            return False
        return any(c.probability > 0.5 and _device(c) for c in self.report.causes)

    @property
    def coin_toss(self) -> bool:
        """Whether two causes that the report itself calls indistinguishable stand apart in it, each with a probability
        worth naming."""
        if self.report is None:
            return False
        named = [c for c in self.report.ranked if c.probability > TOSS]
        pairs = [(a, b) for k, a in enumerate(named) for b in named[:k]]
        groups = [set(g) for g in self.report.indistinguishable]
        return any(a.names & g and b.names & g and not a.names & b.names for a, b in pairs for g in groups)

    @property
    def unknown_score(self) -> float:
        """How sure the diagnosis is that the cause is outside its library."""
        if self.report is None:
            return 0.0
        given = self.report.unknown_probability
        return float(self.verdict == "unknown") if given is None else given


def _device(cause: Cause) -> bool:
    stages = [CONCEPTS[n].stage if n in CONCEPTS else "unlisted" for n in cause.effects]
    return bool(stages) and "tissue" not in stages


def _load_report(path: Path) -> Report | None:
    if not path.exists():
        return None
    try:
        return Report.model_validate_json(path.read_bytes())
    except ValidationError as e:
        first = e.errors()[0]
        raise ValueError(f"{path.name}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None


def _tolerated(hidden: dict[str, Any], instrument: str) -> bool:
    return within_tolerance(hidden.get("knobs", {}), instrument == "microrobot")


def visible(key: Path, least: float, passphrase: str = "", nothing: bool = True) -> list[str]:
    """Names of a sealed key's cases that hide effects of a δ_free of ``least`` at the least or, if ``nothing``, none.

    Raises ValueError for a wrong passphrase.
    """
    cases = json.loads(unseal(key.read_bytes(), passphrase))["cases"]
    return sorted(c["case"] for c in cases if (c["delta_free"] >= least if c["effects"] else nothing))


def load(reports: Path, keys: Sequence[Path], passphrase: str = "", least: float = 0.0) -> list[Case]:
    """Truths of the sealed ``keys`` joined with the reports ``<case>.json``, of cases `visible` by ``least``.

    Raises ValueError for a wrong passphrase or a malformed report, naming it.
    """
    cases = []
    for key in keys:
        try:
            plain = json.loads(unseal(key.read_bytes(), passphrase))
        except ValueError as e:
            raise ValueError(f"{key}: {e}") from None
        for t in plain["cases"]:
            hidden = t["effects"]
            if hidden and least and t["delta_free"] < least:
                continue
            cases.append(
                Case(
                    t["case"],
                    t["tier"],
                    t["instrument"],
                    tuple(h["concept"] for h in hidden),
                    tuple(h["stage"] for h in hidden),
                    tuple(h["delta"] for h in hidden),
                    t["delta"],
                    _load_report(reports / f"{t['case']}.json"),
                    t.get("delta_free"),
                    bool(t.get("reference", False)),
                    bool(hidden) and all(_tolerated(h, t["instrument"]) for h in hidden),
                )
            )
    return cases
