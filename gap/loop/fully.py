"""The self-check by whole diagnoses: effects at their just-visible size, in simulated sessions like the one at hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from gap.design import simulated as own
from gap.design.bench import Bench, leg_of
from gap.design.selfcheck import Checked
from gap.diagnosis import diagnose
from sim_devices.chain import Effect
from sim_devices.stages.tissues import SheetTissue


@dataclass(frozen=True)
class Tried:
    """A whole diagnosis of a simulated session: its effect, and the answer."""

    effect: str
    verdict: str
    named: tuple[str, ...]

    @property
    def right(self) -> bool:
        return self.effect in self.named

    def as_dict(self) -> dict[str, Any]:
        return {"effect": self.effect, "verdict": self.verdict, "class": list(self.named), "right": self.right}


def tried(
    recordings: Sequence[Recording],
    checked: Sequence[Checked],
    effects: Mapping[str, Effect],
    n: int,
    seed: int = 1,
    jobs: int = 1,
    tell: Callable[[str], None] = lambda text: None,
) -> list[Tried]:
    """Diagnoses of ``n`` sessions like ``recordings``, each with one of the effects that such a session should show."""
    rng = np.random.default_rng(seed)
    visible = [c for c in checked if c.strength is not None and c.parameter]
    bench = Bench(recordings)
    legs = [leg_of(r) for r in recordings]
    out = []
    for k in rng.permutation(len(visible))[:n]:
        c = visible[int(k)]
        effect = next(e for e in effects.values() if e.name == c.effect)
        values = {p.name: p.default for p in effect.parameters} | {c.parameter: c.strength or 0.0}
        acting, one = [(effect, values)], np.random.default_rng([seed, int(k)])
        if isinstance(bench.skin, SheetTissue):
            session = own.robot_session(one, acting, bench.skin, legs)
        else:
            session = own.suction_session(bench.instrument, one, acting, bench.skin, legs)
        d = diagnose(session, jobs=jobs)
        first = d.verdict.causes[0].names if d.verdict.claims else ()
        out.append(Tried(c.effect, d.verdict.verdict, tuple(first)))
        tell(f"{len(out)}/{min(n, len(visible))} {c.effect}: {d.verdict.verdict} {', '.join(first)}")
    return out
