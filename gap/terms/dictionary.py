"""Where a term may act in a case, and of which parts it may be made there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gap.inference.problem import Problem
from gap.null.blocks import Block
from gap.rig.problem import RigProblem
from gap.terms.parts import ERROR, INPUT, OWN, START, Part, Place
from sim_devices.chain import FloatArray
from sim_devices.stages.operators import analog

INSTRUMENTS = ("cutometer", "aspiration")
"""Our instruments for which terms are proposed."""
LAGS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""s: lags of parts of our own instruments' signals."""
WARMING = (10.0, 30.0, 100.0, 300.0)
"""s from the start of a session in which something may warm up or run in."""
LAGS_OF_A_RIG = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
"""The same of a rig's, in durations of its first recording."""
STEEP = 0.99
"""Quantile of a signal's rates that is the scale of them."""
UNITS = {OWN: "m", INPUT: "Pa"}
MEMORYLESS = ("x", "|x|", "x|x|", "x^2", "x^3")
OF_A_RATE = ("x", "|x|", "x|x|", "sgn x")


@dataclass(frozen=True)
class Choice:
    """A place and the parts that a term there may have."""

    place: Place
    parts: tuple[Part, ...]


def choices(problems: Mapping[str, Problem]) -> list[Choice]:
    """All places of a case where its data could show a term."""
    out = []
    for problem in problems.values():
        if isinstance(problem, RigProblem):
            out += [_at_tap(problem, tap) for tap in problem.model.stages if tap in problem.seen]
        elif isinstance(problem, Block) and problem.session.instrument in INSTRUMENTS:
            out += _in_chain(problem, problems)
    return out


def _in_chain(block: Block, problems: Mapping[str, Problem]) -> list[Choice]:
    """Places whose term shows in a block of a suction instrument. Without a reference specimen what is behind the
    skin cannot be told from the skin; a term at the optics is looked for where there is one."""
    largest = float(np.max(np.abs(block.measured)))
    if block.name == "pressure":
        names = {OWN: "pressure", INPUT: "set-point", ERROR: "(set-point − pressure)"}
        place = Place(
            "regulator", "actuator", "Pa", largest, ("line_pressure",), ("setpoint_pressure",), names,
            dict.fromkeys(names, "Pa"), (block.name,), highest=0.0,
        )  # fmt: skip
        rate = _rate(block)
        parts = _memoryless(OWN, largest) + _of_rate(OWN, rate) + _lagged(OWN, largest, LAGS)
        parts += _at_first(largest, WARMING)
        parts += [Part(ERROR, f, largest) for f in ("x", "x|x|", "sgn x")] + _lagged(ERROR, largest, LAGS[:4])
        return [Choice(place, (*parts, Part(OWN, "x", rate, rate=True, times=OWN, times_scale=largest)))]
    if block.name == "height":
        names = {OWN: "height", INPUT: "pressure"}
        place = Place("softening", "tissue", "m", largest, ("bulge",), ("skin_pressure",), names, UNITS, (block.name,))
        load = max(float(np.max(np.abs(g.commands["pressure"].value))) for g, _ in block.groups) or 1.0
        rate = _rate(block)
        parts = _memoryless(OWN, largest) + _of_rate(OWN, rate) + _lagged(OWN, largest, LAGS)
        parts += _at_first(largest, WARMING)
        parts += _memoryless(INPUT, load) + _lagged(INPUT, load, LAGS)
        return [Choice(place, (*parts, Part(OWN, "x", largest, times=INPUT, times_scale=load)))]
    if block.name == "reference":
        blocks = tuple(b for b in ("reference", "height") if b in problems)
        place = Place("optics", "sensor", "m", largest, analog("raw_height"), (), {OWN: "height"}, UNITS, blocks)
        parts = _memoryless(OWN, largest) + _of_rate(OWN, _rate(block)) + _lagged(OWN, largest, LAGS)
        return [Choice(place, tuple(parts))]
    return []


def _at_tap(rig: RigProblem, tap: str) -> Choice:
    """A tap of a rig's model, with the signals that the model gives there."""
    seen = rig.seen[tap]
    span, measured = seen.high - seen.low, float(np.ptp(rig.measured))
    size = span if span > 1e-9 * measured else measured
    unit = getattr(rig.model, "units", {}).get(tap, "")
    place = Place(
        tap, rig.model.stages[tap], unit, size, names={OWN: tap, **{r: r for r in seen.related}}, units={OWN: unit},
        blocks=(rig.name,), rig=True,
    )  # fmt: skip
    lags = [share * float(np.ptp(rig.rows.time[rig.rows.recording == 0])) for share in LAGS_OF_A_RIG]
    parts: list[Part] = []
    own = max(abs(seen.high), abs(seen.low))
    if own > 1e-9 * measured:
        parts += _memoryless(OWN, own) + _lagged(OWN, own, lags) + _at_first(own, lags)
        parts += _of_rate(OWN, seen.rate) if seen.rate else []
    for role, scale in seen.related.items():
        if scale:
            parts += [*_memoryless(role, scale), Part(role, "sgn x", scale), *_lagged(role, scale, lags)]
            parts += [Part(role, "x", scale, times=OWN, times_scale=own)] if own > 1e-9 * measured else []
    return Choice(place, tuple(parts))


def _memoryless(role: str, scale: float) -> list[Part]:
    return [Part(role, f, scale) for f in MEMORYLESS]


def _of_rate(role: str, scale: float) -> list[Part]:
    return [Part(role, f, scale, rate=True) for f in OF_A_RATE]


def _lagged(role: str, scale: float, lags: Sequence[float]) -> list[Part]:
    return [Part(role, "x", scale, tau=tau, fading=fading) for tau in lags for fading in (True, False)]


def _at_first(scale: float, times: Sequence[float]) -> list[Part]:
    """Warming up or running in."""
    return [Part(OWN, "x", scale, tau=tau, times=START) for tau in times]


def _rate(block: Block) -> float:
    """Scale of the rate of a block's channel, per s."""
    rates: list[FloatArray] = []
    for k in np.unique(block.rows.recording):
        at = block.rows.recording == k
        steps = np.diff(block.rows.time[at])
        rates.append(np.abs(np.diff(block.measured[at])[steps > 0] / steps[steps > 0]))
    return float(np.quantile(np.concatenate(rates), STEEP)) or 1.0
