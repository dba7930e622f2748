"""Before measuring: effects a protocol could never tell apart, and how weak an effect it would show. After: what to
measure next.

Both simulate the nominal instrument on a protocol and look at the traces that effects leave once the nuisance (tissue,
calibration) is refitted: two effects whose traces point the same way are one class, whatever the noise.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.least_squares import fit
from gap.inference.linear import Projector
from gap.inference.problem import Problem
from gap.null.robot import robot_problems
from gap.null.suction import suction_problems
from gap.search.starts import grid
from sim_devices.chain import FloatArray

STRONG = 15.0
"""δ of an effect that counts as strong: effects that cannot be told apart by three σ at this δ are one class."""
VISIBLE = 1.0
"""δ below which a trace is lost in the noise: its direction says nothing."""


@dataclass(frozen=True)
class Trace:
    """The trace of an effect: unit vectors of its whitened, projected change at several strengths and shapes, and δ at
    its default."""

    candidate: Candidate
    directions: FloatArray  # (points, rows)
    detectability: float


@dataclass(frozen=True)
class Plan:
    """``weakest`` maps an effect to the δ of its default strength; ``classes`` are groups that cannot be separated,
    ``invisible`` the effects that tissue or calibration take up whole."""

    instrument: str
    weakest: Mapping[str, float]
    classes: tuple[tuple[str, ...], ...]
    invisible: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        return {
            "schema": "gap-plan/1",
            "instrument": self.instrument,
            "detectability": {k: float(f"{v:.4g}") for k, v in self.weakest.items()},
            "indistinguishable": [list(c) for c in self.classes],
            "invisible": list(self.invisible),
        }

    def as_text(self) -> str:
        lines = ["Effects and how far they would stand out at their default strength (δ; below 3 nobody could tell):"]
        lines += [f"  {k:<36} {v:8.1f}" for k, v in sorted(self.weakest.items(), key=lambda kv: -kv[1])]
        lines.append(f"Never separable by these recordings (not even at δ = {STRONG:.0f}):")
        lines += [f"  {', '.join(c)}" for c in self.classes] or ["  none"]
        if self.invisible:
            lines.append(f"Leave no trace that tissue or calibration could not leave: {', '.join(self.invisible)}")
        return "\n".join(lines)


def build(
    recordings: Sequence[Recording], effects: Mapping[str, Any]
) -> tuple[Sequence[Problem], tuple[Candidate, ...]]:
    """Problems and candidates of one of our instruments."""
    make = robot_problems if recordings[0].info.instrument == "microrobot" else suction_problems
    return make(recordings, effects)


def traces(problems: Mapping[str, Problem], null: Hypothesis, candidates: Sequence[Candidate]) -> list[Trace]:
    """Traces of candidates about a fitted null."""
    projectors = {b: Projector(f.jacobian, f.prior_sd) for b, f in null.fits.items()}
    out = []
    for candidate in candidates:
        defaults = {p.name: p.default for p in candidate.parameters}
        points = [defaults, *(candidate.values(u) for u in grid(candidate))]
        rows, sizes = [], []
        for values in points:
            parts = []
            for b, f in null.fits.items():
                if b not in candidate.blocks:
                    parts.append(np.zeros(len(f.residual)))
                    continue
                there = problems[b].evaluate(f.nuisance, {candidate: values}, want_jacobian=False).residual
                parts.append(projectors[b].apply(f.residual - there))
            trace = np.concatenate(parts)
            sizes.append(float(np.linalg.norm(trace)))
            if sizes[-1] > VISIBLE:
                rows.append(trace / sizes[-1])
        out.append(Trace(candidate, np.asarray(rows), sizes[0]))
    return out


def likeness(a: Trace, b: Trace) -> float:
    """How well one effect can imitate the other, |cosine|: the nearest trace of the imitator, in the median over the
    strengths and shapes of the imitated."""
    if not len(a.directions) or not len(b.directions):
        return 0.0
    cosines = np.abs(a.directions @ b.directions.T)
    return float(max(np.median(cosines.max(axis=1)), np.median(cosines.max(axis=0))))


def plan(protocols: Sequence[str]) -> Plan:
    """The plan for protocols (files or library names) measured one after another in one session."""
    recordings, instrument = simulated(protocols)
    problems, candidates = build(recordings, library(instrument))
    blocks = {p.name: p for p in problems}
    null = Hypothesis((), {name: fit(p, iterations=10) for name, p in blocks.items()})
    return summarise(instrument, traces(blocks, null, candidates))


def summarise(instrument: str, found: Sequence[Trace]) -> Plan:
    """Classes by single linkage of like traces; forms of one concept count as one."""
    weakest: dict[str, float] = {}
    for t in found:
        weakest[t.candidate.name] = max(weakest.get(t.candidate.name, 0.0), t.detectability)
    groups: list[set[str]] = []
    for i, a in enumerate(found):
        for b in found[:i]:
            if a.candidate.name != b.candidate.name and STRONG**2 * (1 - likeness(a, b) ** 2) < 9.0:
                touching = [g for g in groups if a.candidate.name in g or b.candidate.name in g]
                groups = [g for g in groups if g not in touching]
                groups.append({a.candidate.name, b.candidate.name}.union(*touching))
    shown = {t.candidate.name for t in found if len(t.directions)}
    invisible = tuple(sorted({e.name for e in library(instrument).values()} - shown))
    return Plan(instrument, weakest, tuple(tuple(sorted(g)) for g in groups), invisible)


def simulated(protocols: Sequence[str]) -> tuple[list[Recording], str]:
    """Nominal recordings of protocols. Raises ValueError for protocols of several instruments."""
    from protocols import compile_protocol, find, load

    legs, instruments = [], []
    for name in protocols:
        protocol = load(find(name))
        limits = importlib.import_module(f"drivers.{protocol.instrument}").INSTRUMENT.limits
        setpoints = compile_protocol(protocol, limits)
        time, values = setpoints.table()
        legs.append(own.Leg({q: (time, v) for q, v in values.items()}, setpoints.duration))
        instruments.append(protocol.instrument)
    if len(set(instruments)) != 1:
        raise ValueError(f"protocols of several instruments ({', '.join(sorted(set(instruments)))}): plan each apart")
    rng = np.random.default_rng(1)
    if instruments[0] == "microrobot":
        return own.robot_session(rng, legs=legs, scatter=0.0), instruments[0]
    return own.suction_session(instruments[0], rng, legs=legs, scatter=0.0), instruments[0]
