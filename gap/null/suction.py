"""The suction instruments as two blocks of data: command -> recorded pressure, and recorded pressure -> apex height."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from acquire.recording.model import Recording
from gap.inference.hypothesis import Candidate
from gap.inference.least_squares import fit
from gap.inference.problem import Problem
from gap.null.blocks import Block, GroupedSession
from gap.null.candidates import candidates_for
from gap.null.suction_height import HeightBlock
from gap.null.suction_pressure import SAMPLED, SLOW, PressureBlock
from gap.null.suction_reference import ManometerBlock, ReferenceBlock
from sim_devices.chain import Effect


def suction_problems(
    recordings: Sequence[Recording],
    effects: Mapping[str, Effect],
    height: Callable[[GroupedSession, Mapping[str, Effect], PressureBlock | None], HeightBlock] = HeightBlock,
    jobs: int = 1,
    unknown_regulator: bool = False,
) -> tuple[Sequence[Problem], tuple[Candidate, ...]]:
    """The blocks that a session's channels allow, and the effects that show in them.

    ``height`` makes the block of the apex height: with the reduced tissue, or another one. Its first fits are shared by
    ``jobs`` processes. With an ``unknown_regulator`` it may be of a structure that nobody knows.

    Raises ValueError when set-points or a measured channel are missing.
    """
    missing = [r.info.id for r in recordings if "pressure" not in r.setpoints]
    if missing:
        raise ValueError(f"recording {missing[0]} has no set-points of pressure: its command is not known")
    session = GroupedSession(recordings, ("pressure",))
    blocks: list[Block] = []
    gauges = [c for c in ("pressure", "pressure_reference") if any(c in r.streams for r in recordings)]
    pressure = PressureBlock(session, effects, unknown_regulator, gauges[0]) if gauges else None
    if pressure is not None:
        session.held, session.averaged = pressure.held, pressure.averaged
        if len(gauges) > 1:
            pressure, manometer = _two_gauges(session, effects, pressure)
            blocks += [pressure, manometer]
        else:
            blocks.append(pressure)
    shown = {g.reference for g in session.groups for k in g.members if "apex_height" in recordings[k].streams}
    if True in shown:  # ahead of the skin: the fit of an effect on a reference goes on to it
        blocks.append(reference := ReferenceBlock(session, effects, pressure))
        session.of_height = reference.row_noise
    if False in shown:
        skin = height(session, effects, pressure)
        skin.jobs = jobs
        blocks.append(skin)
    if not blocks:
        raise ValueError(f"recording {recordings[0].info.id} has neither channel pressure nor apex_height")
    return blocks, candidates_for(effects, blocks)


def _two_gauges(
    session: GroupedSession, effects: Mapping[str, Effect], pressure: PressureBlock
) -> tuple[PressureBlock, ManometerBlock]:
    """The blocks of both gauges, with samples of the first that are means over a period or none, as both together say:
    alone the first one hardly tells a mean from a slower regulator."""

    def both(first: PressureBlock) -> tuple[PressureBlock, ManometerBlock]:
        session.averaged = first.averaged
        return first, ManometerBlock(session, effects, first)

    own = both(pressure)
    if pressure.dt < SLOW:
        return own
    other = both(pressure.sampled_otherwise())
    costs = [sum(fit(block).objective for block in pair) for pair in (own, other)]
    best = other if costs[1] < costs[0] - SAMPLED else own
    session.averaged = best[0].averaged
    return best
