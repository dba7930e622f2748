"""All that the rules of a verdict look at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gap.decision.classes import Cause
from gap.decision.gaps import Shrink, above
from gap.decision.marks import explains_marks
from gap.decision.posterior import Posterior
from gap.decision.thresholds import Thresholds
from gap.decision.tolerance import NOT_STATED, Size


@dataclass(frozen=True)
class Findings:
    """``fitted`` is the gap in the channels that the first cause changes (where it is ``judged_apart``, in those
    without skin: the rest of skin of another law is not its doing), ``each`` in every such block, ``held_out`` in them
    on recordings that its parameters were not fitted to, by split, ``rival`` that of the next cause of other
    effects, in all blocks, and ``input_gap`` that of the simulation by itself in the blocks that all of those channels
    have as input; ``without_skin``, the nats that blocks without skin give the first cause; ``size``, that of the
    smallest member of its class; ``strained``, whether without it tolerances are strained far; ``expected``, whether
    the instrument's references have shown it."""

    posterior: Posterior
    t: Thresholds
    fitted: Shrink | None = None
    each: Mapping[str, Shrink] = field(default_factory=dict)
    held_out: Mapping[str, Shrink] = field(default_factory=dict)
    rival: Mapping[str, Shrink] = field(default_factory=dict)
    input_gap: float = 0.0
    without_skin: float = np.inf
    size: Size = NOT_STATED
    strained: bool = False
    judged_apart: bool = False
    expected: bool = False

    @property
    def first(self) -> Cause:
        return self.posterior.causes[0]

    @property
    def seen(self) -> float:
        """Detectability that the first cause needs."""
        if self.first.marked or self.expected:
            return self.t.seen_marked
        return self.t.seen_strained if self.strained else self.t.seen_of(self.first.effects)

    @property
    def shows_itself(self) -> bool:
        """Whether the first cause's marks in the samples are explained by it, whatever else there is."""
        return explains_marks(self.first.at_marks, self.t)

    @property
    def withheld(self) -> Mapping[str, Shrink]:
        """Held-out gaps that judge an effect: another waveform, where there is one that shows a gap."""
        other = self.held_out.get("waveform")
        if other is None:
            return self.held_out
        shown = above(self.fitted.before, self.t.quiet_gap) if self.fitted is not None else 0.0
        others = {k: s for k, s in self.held_out.items() if k != "waveform"}
        silent = above(other.before, self.t.quiet_gap) < self.t.worse_share * shown
        return others if silent and others else {"waveform": other}
