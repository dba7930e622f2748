"""The suction instruments as two blocks of data: command -> recorded pressure, and recorded pressure -> apex height."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from acquire.recording.model import Recording
from gap.inference.hypothesis import Candidate
from gap.inference.least_squares import fit
from gap.inference.problem import Problem
from gap.null.blocks import Block
from gap.null.candidates import candidates_for
from gap.null.groups import GroupedSession
from gap.null.suction_feed import FedBlock
from gap.null.suction_height import HeightBlock
from gap.null.suction_pressure import SAMPLED, SLOW, PressureBlock
from gap.null.suction_reference import ManometerBlock, ReferenceBlock
from sim_devices.chain import Effect

_Fed = Callable[[GroupedSession, Mapping[str, Effect], PressureBlock], FedBlock]


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
    shown = {g.reference for g in session.groups for k in g.members if "apex_height" in recordings[k].streams}
    # References ahead of the skin: the fit of an effect on one goes on to it.
    pressure, blocks = _without_skin(session, effects, True in shown, unknown_regulator)
    if False in shown:
        skin = height(session, effects, pressure)
        skin.jobs = jobs
        blocks.append(skin)
    if not blocks:
        raise ValueError(f"recording {recordings[0].info.id} has neither channel pressure nor apex_height")
    return blocks, candidates_for(effects, blocks)


def _without_skin(
    session: GroupedSession, effects: Mapping[str, Effect], reference: bool, unknown_regulator: bool
) -> tuple[PressureBlock | None, list[Block]]:
    """The block of the recorded pressure, if there is one, and all blocks in which skin plays no part; whether there is
    a height on a ``reference``."""
    gauges = [c for c in ("pressure", "pressure_reference") if any(c in r.streams for r in session.recordings)]
    fed: list[_Fed] = [ManometerBlock] if len(gauges) > 1 else []
    fed += [ReferenceBlock] if reference else []
    if not gauges:
        blocks: list[Block] = [ReferenceBlock(session, effects)] if reference else []
        pressure = None
    else:
        pressure = PressureBlock(session, effects, unknown_regulator, gauges[0])
        session.held = pressure.held
        pressure, others = _as_sampled(session, effects, pressure, fed)
        blocks = [pressure, *others]
    for block in blocks:
        if isinstance(block, ReferenceBlock):
            session.of_height = block.row_noise
    return pressure, blocks


def _as_sampled(
    session: GroupedSession, effects: Mapping[str, Effect], pressure: PressureBlock, fed: Sequence[_Fed]
) -> tuple[PressureBlock, list[FedBlock]]:
    """The recorded pressure and the blocks that it is ``fed`` to, with samples that are means over a period or none, as
    all of them together say: alone the pressure hardly tells a mean from a slower regulator. The skin is not asked."""

    def made(first: PressureBlock) -> tuple[PressureBlock, list[FedBlock]]:
        session.averaged = first.averaged
        return first, [block(session, effects, first) for block in fed]

    own = made(pressure)
    if not fed or pressure.dt < SLOW:
        return own
    other = made(pressure.sampled_otherwise())
    pairs = zip((own[0], *own[1]), (other[0], *other[1]), strict=True)
    best = other if sum(_dearer(*pair) for pair in pairs) > SAMPLED else own
    session.averaged = best[0].averaged
    return best


def _dearer(block: Block, other: Block) -> float:
    """By how much the objective of a block is above an ``other``'s of the same rows, in units of a misfit that is not
    the noise's where both have one."""
    fits = fit(block), fit(other)
    misfit = min(f.chi2 for f in fits) / max(len(fits[0].residual), 1)
    return (fits[0].objective - fits[1].objective) / max(misfit, 1.0)
