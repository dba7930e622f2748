"""Sampled commands that a controller holds at each row until the next: sound, and late by half an interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.decision.structure import conventions
from gap.design import simulated as own
from gap.design.simulated import Leg
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.robot_axes import QUANTITIES, AxesBlock
from gap.null.suction import suction_problems
from gap.null.suction_pressure import PressureBlock

EVERY = 0.02
"""s from row to row of the sampled tables."""


def sampled(leg: Leg) -> Leg:
    """A leg whose tables are rows of every `EVERY` s; a step lies at a row."""
    rows = np.arange(0.0, leg.duration + 0.5 * EVERY, EVERY)
    return replace(leg, quantity_tables={q: (rows, np.interp(rows, *t)) for q, t in leg.quantity_tables.items()})


def held(leg: Leg) -> Leg:
    """What a controller makes of a sampled leg that holds each row: a step at each."""

    def stairs(time: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.repeat(time, 2)[1:], np.repeat(value, 2)[:-1]

    return replace(leg, quantity_tables={q: stairs(*t) for q, t in leg.quantity_tables.items()})


def as_written(recordings: Sequence[Recording], legs: Sequence[Leg]) -> list[Recording]:
    """Recordings with the set-points of ``legs``, whatever was commanded to make them."""
    out = []
    for r, leg in zip(recordings, legs, strict=True):
        begin = min(float(s.time[0]) for s in r.setpoints.values())
        rows = {q: replace(s, time=begin + leg.quantity_tables[q][0], value=leg.quantity_tables[q][1])
                for q, s in r.setpoints.items()}  # fmt: skip
        out.append(replace(r, setpoints=rows))
    return out


def suction(followed_held: bool) -> list[Recording]:
    """A step written as two rows, and a sampled triangle."""
    legs = [own.step_hold(-20e3, 6.0, 4.0), sampled(own.triangle(-20e3, 3.0, 2, 4.0))]
    made = [legs[0], held(legs[1])] if followed_held else legs
    return as_written(own.suction_session("aspiration", np.random.default_rng(5), legs=made), legs)


def robot(followed_held: bool) -> list[Recording]:
    """A triangle of few rows, and a sampled one."""
    legs = [own.direction_cycles(0.0, 0.1, 1.2e-3, 4.0, 1), sampled(own.direction_cycles(1.2, 0.1, 1.2e-3, 4.0, 1))]
    made = [legs[0], held(legs[1])] if followed_held else legs
    return as_written(own.robot_session(np.random.default_rng(3), legs=made), legs)


@pytest.mark.parametrize("followed_held", [False, True])
def test_a_regulator_that_holds_sampled_rows_is_sound(followed_held: bool) -> None:
    problems, _ = suction_problems(suction(followed_held), library("aspiration"))
    block = problems[0]
    null = fit(block)
    assert isinstance(block, PressureBlock)
    assert block.held is block.session.held is followed_held
    assert bool(conventions(problems)) is followed_held
    assert null.chi2 / len(null.residual) < 1.15
    assert null.penalty < 15.0


@pytest.mark.parametrize("followed_held", [False, True])
def test_a_loop_that_holds_sampled_rows_is_sound(followed_held: bool) -> None:
    """A sound robot of another author was told the gain of its transducers (gap 1.3 in the axes)."""
    axes = AxesBlock(GroupedSession(robot(followed_held), QUANTITIES), {})
    null = fit(axes)
    assert axes.held is followed_held
    assert null.chi2 / len(null.residual) < 1.15
    assert null.penalty < 15.0
