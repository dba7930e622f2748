"""The next experiment: of those that can be done, the one that is expected to tell most of the cause in a minute."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from gap.data.session import SKIN
from gap.decision.thresholds import INSTRUMENT
from gap.design.beliefs import Beliefs, Draw
from gap.design.bench import Bench, Part
from gap.design.catalogue import catalogue
from gap.design.experiment import Asked, Experiment, fault, stopped
from gap.design.information import Known, Worth, worth
from gap.design.unknowns import Unknowns
from gap.effects.load import library
from protocols import Limits
from sim_devices.chain import Effect

CERTAIN = 0.95
"""Share of all that the library could name from which one cause is certain, and nothing more is asked for."""
LEAST_BITS, LEAST_GAIN = 0.05, 0.01
"""Information (bits) and gain in the probability of a right answer that an experiment must promise, either."""
POSSIBLE = 0.98
"""Share of the probability that the draws hold which are simulated; the least probable ones are left out."""
FORM_ERROR = 2.0
"""Divides χ²: effects do not have quite the form in which they are simulated."""


@dataclass(frozen=True)
class Choice:
    """The chosen experiment, or the reason why there is none: one of ``experiment`` and ``reason`` is empty.
    ``considered`` is every experiment with its worth, the best first."""

    instrument: str
    experiment: Experiment | None
    reason: str
    probability: float
    considered: tuple[tuple[Experiment, Worth], ...]

    @property
    def text(self) -> str:
        """The choice in a sentence."""
        e = self.experiment
        if e is None:
            return f"Stop: {self.reason}."
        if not self.considered:
            return f"Measure {e.waveform} on {e.specimen} ({e.minutes:.1f} min)."
        split = f" It separates {_listed(e.separates)}." if e.separates else ""
        return (
            f"Measure {e.waveform} on {e.specimen} ({e.minutes:.1f} min): the right cause then has a probability of "
            f"{e.right_after:.2f}, and {e.right_before:.2f} without it.{split}"
        )

    def as_dict(self) -> dict[str, Any]:
        """The contents of ``experiment.yaml``."""
        if self.experiment is None:
            return stopped(self.instrument, self.reason, self.probability)
        table = [
            {"specimen": e.specimen, "waveform": e.waveform, "minutes": round(e.minutes, 2),
             "information": round(w.information, 3), "probability_right": round(w.after, 3)}
            for e, w in self.considered
        ]  # fmt: skip
        return {**self.experiment.as_dict(), "considered": table}


def choose(
    report: Mapping[str, Any],
    recordings: Sequence[Recording],
    limits: Limits,
    effects: Mapping[str, Effect] | None = None,
    specimens: Sequence[str] = (),
    seed: int = 1,
) -> Choice:
    """The next experiment after a ``gap-report/1`` on ``recordings`` of one session.

    ``specimens`` are those at hand (default: all that are known). Information about the cause is integrated over what
    the report leaves possible (`gap.design.beliefs`), over the instrument's tolerances and over skin of any law. Equal
    arguments give an equal choice.
    """
    instrument = recordings[0].info.instrument
    if (done := certain(report, instrument)) is not None:
        return done
    top = _leading(report)[0]
    bench = Bench(recordings)
    every = catalogue(instrument, bench.session.legs, limits, specimens, seed)
    # A measurement that was made already would go wrong in the simulation's form in the same way once more: no noise
    # which a second answer averages out.
    asked = [e for e in every if not answered(e, recordings)]
    if not asked:
        reason = "everything within the limits has been measured" if every else "no experiment is within the limits"
        return Choice(instrument, None, reason, top, ())
    known = library(instrument) if effects is None else effects
    valued = _valued(report, bench, asked, known, seed)
    if not valued:
        return Choice(instrument, None, "the report leaves nothing possible that could be simulated", top, ())
    best, value = valued[0]
    if value.information < LEAST_BITS and value.after - value.before < LEAST_GAIN:
        reason = f"nothing considered would tell more: at most {value.information:.2f} bits of the cause"
        return Choice(instrument, None, reason, value.before, valued)
    return Choice(instrument, best, "", value.after, valued)


def answered(experiment: Experiment, recordings: Sequence[Recording]) -> bool:
    """Whether one of the recordings carries an experiment out."""
    asked = Asked("", experiment.instrument, experiment.specimen, experiment.leg.quantity_tables, "")
    return any(not fault(r, asked) for r in recordings)


def certain(report: Mapping[str, Any], instrument: str) -> Choice | None:
    """The choice of no further experiment, where one cause is certain and alone in its class; else None."""
    top, cause = _leading(report)
    # However good the data, the library may lack the cause: no probability can be higher than the rest.
    if not cause or top < CERTAIN * (1.0 - INSTRUMENT.prior_outside):
        return None
    return Choice(instrument, None, f"{cause} is certain ({top:.2f})", top, ())


def _leading(report: Mapping[str, Any]) -> tuple[float, str]:
    """The greatest probability of a cause; and that cause in words, where it is alone in its class."""
    found = [c for c in report.get("causes", []) if not c.get("tolerated")]
    causes = [(float(c.get("probability", 0.0)), c) for c in found]
    top = max((probability for probability, _ in causes), default=0.0)
    alone = [c for probability, c in causes if probability == top and len(c.get("class", [])) < 2]
    return top, " and ".join(alone[0]["effects"]) if alone else ""


def _valued(
    report: Mapping[str, Any], bench: Bench, asked: Sequence[Experiment], effects: Mapping[str, Effect], seed: int
) -> tuple[tuple[Experiment, Worth], ...]:
    """Experiments with the information expected of each, the most a minute first; none where nothing is possible."""
    sound = bench.rows(bench.session, bench.simulate(bench.session))
    parts = [bench.part(f"experiment {k}", [e.leg], [bench.end + e.rest_before]) for k, e in enumerate(asked)]
    unknown = Unknowns(bench)
    there = [unknown.of(part) for part in parts]
    gap = float((report.get("gap") or {}).get("after") or 1.0)
    known = Known(unknown.of(bench.session), [name for u in there for name in u], FORM_ERROR * max(gap, 1.0) ** 2)
    draws = _probable(Beliefs(report, bench, known, sound, effects, np.random.default_rng(seed)).draws)
    if not draws:
        return ()
    weights, labels = np.array([d.weight for d in draws]), [d.label for d in draws]
    in_session = np.stack([d.change for d in draws], axis=1)
    # Where the simulation would have told apart what the report leaves open, it is off by more than its noise.
    known = known.tempered(in_session, weights)
    valued = []
    for experiment, part, unknowns in zip(asked, parts, there, strict=True):
        base = bench.rows(part, bench.simulate(part))
        changes = [_change(bench, part, d, base) for d in draws]
        points = known.seen(unknowns, in_session, np.stack(changes, axis=1))
        value = worth(points, weights, labels, np.random.default_rng(seed))
        split = _separated(points, draws)
        valued.append((experiment.valued(value.information, value.before, value.after, split), value))
    return tuple(sorted(valued, key=lambda pair: -pair[1].information / pair[0].minutes))


def _change(bench: Bench, part: Part, draw: Draw, base: np.ndarray) -> np.ndarray:
    """The change by a draw of the rows (n,) of an experiment."""
    specimen = part.legs[0].specimen
    share = draw.on_skin if specimen == SKIN else draw.on_references
    if specimen != SKIN and specimen in {leg.specimen for leg in bench.session.legs}:
        share = 1.0  # it does there as the leader does: the session has shown that
    return share * bench.changed(part, draw.acting, base) if draw.acting and share else np.zeros_like(base)


def _probable(drawn: Sequence[Draw]) -> list[Draw]:
    """The fewest draws that hold `POSSIBLE` of the probability."""
    ranked = sorted((d for d in drawn if d.weight > 0.0), key=lambda d: -d.weight)
    before = np.cumsum([0.0, *(d.weight for d in ranked)])
    return [d for d, held in zip(ranked, before, strict=False) if held < POSSIBLE * before[-1]]


def _listed(names: Sequence[str]) -> str:
    first, *others = (n.replace("_", " ") for n in names)
    return f"{first} from {', '.join(others)}"


def _separated(points: np.ndarray, draws: Sequence[Draw], apart: float = 3.0, most: int = 8) -> tuple[str, ...]:
    """The most probable explanations (and none) that the experiment shows three σ from the most probable one."""
    share: dict[str, float] = {}
    for d in draws:
        share[d.label] = share.get(d.label, 0.0) + d.weight
    ranked = sorted(share, key=lambda name: -share[name])
    middle = {
        n: np.mean([p for p, d in zip(points, draws, strict=True) if d.label == n], axis=0) for n in ranked[:most]
    }
    first = ranked[0]
    others = [n for n in ranked[1:most] if float(np.linalg.norm(middle[n] - middle[first])) > apart]
    return (first, *others) if others else ()
