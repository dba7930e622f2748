"""The micro-robot as four blocks: set-point -> axes; axes -> probe and transducers -> force (both recomputed, no
freedom); axes -> transducers.

The axes are fed the load that the recorded forces put on them, the tissue the recorded axis positions; so a gap of
the control loop, of the arithmetic and of everything beyond the tip show in different blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from acquire.recording.model import Recording
from gap.data.command import BRIEF
from gap.inference.hypothesis import Candidate
from gap.inference.problem import Problem
from gap.null.blocks import Block
from gap.null.candidates import candidates_for
from gap.null.groups import GroupedSession
from gap.null.robot_arithmetic import ArithmeticBlock
from gap.null.robot_axes import AXES, QUANTITIES, AxesBlock
from gap.null.robot_force import ForceBlock
from gap.null.robot_reference import ReferenceForceBlock
from gap.null.sheet_law import LAWS
from sim_devices.chain import Effect
from sim_devices.stages.robot import TRANSDUCERS, xyz

POST = "rigid post"
"""The specimen of which a law of forces would tell nothing: it gives way by less than the axes' noise."""
LIMITED = {"force_saturation": "axes", "integral_windup": "axes", "sensor_saturation": "force"}
"""Effects of a limit, and the block that knows how far the session goes."""
ABRUPT, GRADUAL, ONE_WAY = (0.4, 1.3), (0.8, 4.0), (0.15, 4.0)
"""Where a limit counts, from so much of the session's greatest load, below which an axis falls, up to so much of the
greatest force, above which nothing happens; one that acts one way may meet what is small that way."""
REACH = {
    ("force_saturation", 1): GRADUAL,
    ("integral_windup", 2): GRADUAL,
    ("sensor_saturation", 1): GRADUAL,
    ("sensor_saturation", 2): ONE_WAY,
    ("sensor_saturation", 3): ONE_WAY,
}
"""By name and form, of those that are not abrupt."""
PROBE_FLOOR, FORCE_FLOOR = 2e-6, 1e-4
"""m and N by which computed channels may differ from what they are computed of. Sound ones of two generators differ
by up to 2 µm, as the kinematics are linear or not, and by 20 nN, as numbers are rounded; a matrix leaves no more."""


class RoughForceBlock(ForceBlock):
    """The same with few other sheets, and on all specimens: good enough to take the noise out of the forces that load
    the axes."""

    LAWS = LAWS[-1:]
    DISCREPANCY_SIZE = 60

    def left_out(self, session: GroupedSession) -> tuple[str, ...]:
        return (POST,)


def robot_problems(
    recordings: Sequence[Recording],
    effects: Mapping[str, Effect],
    force: Callable[[GroupedSession, Mapping[str, Effect], AxesBlock], ForceBlock] = ForceBlock,
) -> tuple[Sequence[Problem], tuple[Candidate, ...]]:
    """The blocks that a session's channels allow, and the effects that show in them.

    ``force`` makes the block of the transducers: with the reduced tissue, or another one.

    Raises ValueError when set-points or a measured channel are missing.
    """
    missing = [r.info.id for r in recordings if not all(q in r.setpoints for q in QUANTITIES)]
    if missing:
        raise ValueError(f"recording {missing[0]} has no set-points of probe_x, probe_y and probe_z")
    session = GroupedSession(recordings, QUANTITIES)

    def has(*names: str) -> bool:
        return any(all(n in r.streams for n in names) for r in recordings)

    blocks: list[Block] = []
    if has(*AXES):
        axes = AxesBlock(session, effects)
        session.held = axes.held
        blocks.append(axes)
    if has(*AXES, *xyz("probe")):
        blocks.append(ArithmeticBlock(session, effects, "kinematics", AXES, xyz("probe"), PROBE_FLOOR))
    if has(*TRANSDUCERS, *xyz("force")):
        blocks.append(ArithmeticBlock(session, effects, "matrix", TRANSDUCERS, xyz("force"), FORCE_FLOOR))
    if has(*AXES, *TRANSDUCERS):
        blocks += _force_blocks(session, effects, axes, force)
    if not blocks:
        raise ValueError(f"recording {recordings[0].info.id} has neither axis positions nor transducer forces")
    return blocks, tuple(_within_reach(c, blocks) for c in candidates_for(effects, blocks))


def _force_blocks(
    session: GroupedSession,
    effects: Mapping[str, Effect],
    axes: AxesBlock,
    force: Callable[[GroupedSession, Mapping[str, Effect], AxesBlock], ForceBlock],
) -> list[Block]:
    """The blocks of the transducers on references and on skin; the forces that load the ``axes`` are taken from a rough
    fit of them."""
    shown = {g.reference for g in session.groups if g.name != POST}
    blocks: list[Block] = []
    if shown:
        rough = RoughForceBlock(session, effects, axes)
        specimens = [g.specimen for g, _ in rough.groups]
        axes.reload(dict(zip(specimens, rough.denoised(), strict=True)))
    if True in shown:  # ahead of the skin: the fit of an effect on a reference goes on to it
        blocks.append(ReferenceForceBlock(session, effects, axes))
        session.of_force = blocks[-1].row_noise
    if False in shown:
        blocks.append(force(session, effects, axes))
    return blocks


def _within_reach(candidate: Candidate, blocks: Sequence[Block]) -> Candidate:
    """A limit counts where this session meets it: there the prior has to lie, and the few strengths of the
    screening."""
    block = next((b for b in blocks if b.name == LIMITED.get(candidate.name)), None)
    greatest = block.greatest() if isinstance(block, AxesBlock | ForceBlock) else 0.0
    first, *others = candidate.parameters
    if not greatest or first.name != "limit":
        return candidate
    low, high = REACH.get((candidate.name, candidate.form), ABRUPT)
    most = greatest + (_jolt(block) if isinstance(block, AxesBlock) else 0.0)
    return replace(candidate, parameters=(replace(first, low=low * greatest, high=high * most), *others))


def _jolt(axes: AxesBlock) -> float:
    """Force, N, that the greatest jump of a set-point asks of a coil at once, beside its load."""
    commands = [group.commands[q] for group, _ in axes.groups for q in QUANTITIES]
    jumps = [np.abs(np.diff(c.value))[np.diff(c.time) <= BRIEF] for c in commands]
    return axes.controller.proportional * float(np.max(np.concatenate(jumps), initial=0.0))
