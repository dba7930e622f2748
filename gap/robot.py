"""The micro-robot as four blocks: set-point -> axes; axes -> probe and transducers -> force (both recomputed, no
freedom); axes -> transducers.

The axes are fed the load that the recorded forces put on them, the tissue the recorded axis positions; so a gap of
the control loop, of the arithmetic and of everything beyond the tip show in different blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from acquire.recording.model import Recording
from gap.blocks import Block, GroupedSession, candidates_for
from gap.hypothesis import Candidate, Problem
from gap.robot_axes import AXES, QUANTITIES, ArithmeticBlock, AxesBlock
from gap.robot_force import ForceBlock
from sim_devices.chain import Effect
from sim_devices.stages.robot import TRANSDUCERS, xyz


def robot_problems(
    recordings: Sequence[Recording],
    effects: Mapping[str, Effect],
    force: Callable[[GroupedSession, Mapping[str, Effect], AxesBlock], ForceBlock] = ForceBlock,
) -> tuple[Sequence[Problem], tuple[Candidate, ...]]:
    """The blocks that a session's channels allow, and the effects that show in them.

    ``force`` makes the block of the transducers: with the reduced tissue, or another one.

    Raises ValueError when what was commanded, or what was measured, is missing.
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
        blocks.append(axes)
    if has(*AXES, *xyz("probe")):
        blocks.append(ArithmeticBlock(session, effects, "kinematics", AXES, xyz("probe"), 2e-6))
    if has(*TRANSDUCERS, *xyz("force")):
        blocks.append(ArithmeticBlock(session, effects, "matrix", TRANSDUCERS, xyz("force"), 2e-3))
    if has(*AXES, *TRANSDUCERS):
        blocks.append(force(session, effects, axes))
    if not blocks:
        raise ValueError(f"recording {recordings[0].info.id} has neither axis positions nor transducer forces")
    return blocks, candidates_for(effects, blocks)
