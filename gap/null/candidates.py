"""The effects that show in a session's blocks, as candidates of a search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gap.inference.hypothesis import Candidate
from gap.null.blocks import Block
from sim_devices.chain import Effect

ELSEWHERE = (0.1, 0.9)
"""Quantiles of its prior at which an effect is tried whose default does nothing."""


def _all_along(event: Candidate, blocks: Sequence[Block]) -> dict[str, float]:
    """When an event happens and for how long, if it does so from the first sample on: at another moment nothing may be
    there to be changed. Nothing of other effects."""
    found = {p.name: p for p in event.parameters if event.event}
    begin = min(float(b.stamps[0]) for b in blocks)
    at = {"moment": min(max(begin, found["moment"].low), found["moment"].high)} if "moment" in found else {}
    return at | ({"duration": found["duration"].high} if "duration" in found else {})


def candidates_for(
    effects: Mapping[str, Effect], blocks: Sequence[Block], threshold: float = 0.05
) -> tuple[Candidate, ...]:
    """One candidate per effect; which blocks it changes is found by switching it on at its default strength, or
    elsewhere in its prior where that does nothing in these recordings."""
    at_rest = {b.name: b.evaluate(b.start(), {}, want_jacobian=False).residual for b in blocks}
    out = []
    for key, effect in effects.items():
        # Which draw it was, nobody knows: only how strong.
        parameters = effect.of_chance if all(b.by_chance(key) for b in blocks) else effect.parameters
        trial = Candidate(
            key, effect.name, effect.stage, parameters, (), effect.meaning, effect.remedy, effect.form, effect.event,
            effect.sparse, effect.extends,
        )  # fmt: skip
        elsewhere = (trial.values(np.full(len(parameters), u)) for u in ELSEWHERE)
        default = {p.name: p.default for p in parameters}
        for values in (default, *elsewhere, default | _all_along(trial, blocks)):
            touched = []
            for block in blocks:
                changed = block.evaluate(block.start(), {trial: values}, want_jacobian=False).residual
                if float(np.max(np.abs(changed - at_rest[block.name]))) > threshold:
                    touched.append(block.name)
            if touched:
                out.append(replace(trial, blocks=tuple(touched)))
                break
    return tuple(out)
