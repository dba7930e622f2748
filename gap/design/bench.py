"""A session and an experiment as rows: simulated channels and their noise.

The instrument is the simulator's, the skin the forearm's scaled to the recorded heights or forces.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from acquire.recording.model import Recording
from gap.data.binning import bin_edges, bin_means
from gap.data.labels import direction, level
from gap.data.session import SKIN, Session
from gap.data.waveform import waveform
from gap.design.simulated import MANOMETER_NOISE, Leg
from protocols.specimens import MANOMETER, SPECIMENS
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages import nominal
from sim_devices.stages.robot import TRANSDUCERS, closed_loop, numbered, xyz
from sim_devices.stages.sampling import simulate
from sim_devices.stages.specimens import meets, mounted
from sim_devices.stages.suction import OPENING, with_tissue
from sim_devices.stages.tissues import SheetTissue, SuctionTissue, for_opening, sheet_tissue, suction_tissue

SECOND, STEP, POST = "pressure_reference", "gauge step", "rigid post"
NOTHING = 1e-12
"""Samples that a row counts for which says nothing."""
SLID = 6.0
"""s after the beginning by which a gauge step lies under the probe (assumed)."""
SUCTION_CHANNELS = ("pressure", "apex_height", SECOND)
ROBOT_CHANNELS = (*numbered("axis_position"), *TRANSDUCERS, *xyz("probe"), *xyz("force"))
COMPUTED = 2.0**0.5
"""Noise of a computed channel counts so many times: it is that of the measured ones once more."""
RATE = {"cutometer": 50.0, "aspiration": 25.0, "microrobot": 40.0}
"""Simulated samples a second, before they are averaged in bins."""
SUBSTEPS = 2
"""Steps of the robot's closed loop for each of its samples."""
MOST = 4
"""Recordings of a robot's session on skin that are simulated."""

Acting: TypeAlias = Sequence[tuple[Effect, Mapping[str, float]]]


@dataclass(frozen=True)
class Part:
    """Recordings of one simulation: ``legs`` beginning at ``starts`` (s on the session's clock), sampled at ``stamps``,
    averaged in bins; ``sigma`` (n,) is the noise of the rows, channel by channel, recording by recording."""

    name: str
    legs: tuple[Leg, ...]
    starts: tuple[float, ...]
    stamps: tuple[FloatArray, ...] = field(repr=False)
    edges: tuple[FloatArray, ...] = field(repr=False)
    sigma: FloatArray = field(repr=False)

    @property
    def skin(self) -> FloatArray:
        """Which recordings are of skin, 1 or 0 each."""
        return np.array([float(leg.specimen == SKIN) for leg in self.legs])


class Bench:
    """An instrument, its noise and this session's skin, on which sessions are simulated without noise."""

    def __init__(self, recordings: Sequence[Recording]) -> None:
        """Raises ValueError for an instrument that is not ours, or a recording without set-points."""
        self.instrument = recordings[0].info.instrument
        if self.instrument not in RATE:
            raise ValueError(
                f"{self.instrument!r} is none of our instruments, which can be simulated: {', '.join(RATE)}"
            )
        if missing := [r.info.id for r in recordings if not any(len(s.time) for s in r.setpoints.values())]:
            raise ValueError(f"recording {missing[0]} has no set-points: its command is not known")
        self.robot = self.instrument == "microrobot"
        self.channels = ROBOT_CHANNELS if self.robot else SUCTION_CHANNELS
        session = Session(recordings)
        self.noise = {c: _noise(session, c) for c in self.channels}
        self.end = max(session.span(k)[1] for k in range(len(recordings)))
        kept = telling(recordings)
        legs = [leg_of(recordings[k]) for k in kept]
        self.skin = scaled(self.instrument, [recordings[k] for k in kept], legs)
        self.session = self.part("session", legs, [session.span(k)[0] for k in kept], list(kept.values()))

    def part(self, name: str, legs: Sequence[Leg], starts: Sequence[float], times: Sequence[int] = ()) -> Part:
        """The rows of some recordings, each of which counts ``times`` (default: once)."""
        rate = RATE[self.instrument]
        stamps = [s + np.arange(0.0, leg.duration, 1 / rate) for s, leg in zip(starts, legs, strict=True)]
        edges, counts = [], []
        for leg, start, at, often in zip(legs, starts, stamps, times or [1] * len(legs), strict=True):
            kinks = start + np.unique(np.concatenate([t for t, _ in leg.quantity_tables.values()]))
            edges.append(bin_edges(at[0], at[-1], kinks[:200], 1 / rate))
            bins = bin_means(at, np.zeros_like(at), edges[-1])
            # Nobody knows the very moment at which a step is slid in: until then its rows say nothing.
            unclear = (leg.specimen == STEP) & (bins.time < start + SLID)
            counts.append((leg, np.where(unclear, NOTHING, bins.count), often))
        sigma = [
            np.sqrt((white**2 / (NOTHING if unused(leg, c) else n) + floor**2) / often) * np.ones(len(n))
            for c, (white, floor) in self.noise.items()
            for leg, n, often in counts
        ]
        return Part(name, tuple(legs), tuple(starts), tuple(stamps), tuple(edges), np.concatenate(sigma))

    def rows(self, part: Part, signals: Sequence[Mapping[str, FloatArray]]) -> FloatArray:
        """Signals of every recording as whitened rows (n,); a channel that is missing is nought."""
        rows = [
            bin_means(at, signal[c] if c in signal else np.zeros_like(at), edges).value
            for c in self.channels
            for signal, at, edges in zip(signals, part.stamps, part.edges, strict=True)
        ]
        return np.asarray(np.concatenate(rows) / part.sigma)

    def simulate(
        self, part: Part, acting: Acting = (), tuned: Mapping[str, Mapping[str, float]] = {}
    ) -> list[dict[str, FloatArray]]:
        """Channels of every recording, without noise; ``tuned`` are other parameters of the chain's operators."""
        made: list[dict[str, FloatArray]] = [{} for _ in part.legs]
        for label in dict.fromkeys(leg.label for leg in part.legs):
            members = [k for k, leg in enumerate(part.legs) if leg.label == label]
            leg = part.legs[members[0]]
            chain = self._chain(leg, tuple(part.starts[k] for k in members))
            for operator, values in tuned.items():
                chain = chain.tuned(operator, **values)
            for effect, values in acting:
                if meets(effect, leg.specimen):
                    chain = effect.apply(chain, values)
            for k, signals in zip(members, self._run(chain, part, members), strict=True):
                made[k] = signals
        return made

    def changed(self, part: Part, acting: Acting, sound: FloatArray) -> FloatArray:
        """The change by effects of the rows (n,) of a part, whose rows without them are ``sound``."""
        rows = self.rows(part, self.simulate(part, acting)) - sound
        return np.nan_to_num(rows, nan=0.0, posinf=1e6, neginf=-1e6)

    def _chain(self, leg: Leg, marks: tuple[float, ...]) -> Chain:
        """The instrument without an effect, on the specimen of a leg."""
        reference = leg.specimen in SPECIMENS
        if isinstance(self.skin, SheetTissue):
            own = reference or leg.specimen == SKIN
            chain = nominal("microrobot", tissue=self.skin if own else sheet_tissue(leg.specimen), marks=marks)
        else:
            tissue = self.skin if reference or leg.specimen == SKIN else suction_tissue(leg.specimen)
            chain = nominal(self.instrument, marks=marks)
            chain = with_tissue(chain, for_opening(tissue, OPENING[self.instrument]))
        return mounted(chain, leg.specimen, leg.known) if reference else chain

    def _run(self, chain: Chain, part: Part, members: Sequence[int]) -> list[dict[str, FloatArray]]:
        legs = [(part.starts[k], part.legs[k].quantity_tables) for k in members]
        tables = {
            q: (np.concatenate([start + t[q][0] for start, t in legs]), np.concatenate([t[q][1] for _, t in legs]))
            for q in legs[0][1]
        }
        at = np.concatenate([part.stamps[k] for k in members])
        if self.robot:
            step = 1 / (SUBSTEPS * RATE["microrobot"])
            fine = (at[:, None] + step * np.arange(SUBSTEPS)).ravel()
            inputs = {f"command_{q[-1]}": np.interp(fine, t, v) for q, (t, v) in tables.items()}
            run = closed_loop(chain, fine, inputs)
            signals = {c: run[c][::SUBSTEPS] for c in self.channels}
        else:
            second = part.legs[members[0]].specimen == MANOMETER
            wanted = [c for c in self.channels if c != SECOND or second]
            signals = dict(simulate(chain, tables, dict.fromkeys(wanted, at)))
        ends = np.cumsum([len(part.stamps[k]) for k in members])
        return [
            {c: v[end - len(part.stamps[k]) : end] for c, v in signals.items()}
            for k, end in zip(members, ends, strict=True)
        ]


def unused(leg: Leg, channel: str) -> bool:
    """Whether a recording's channel tells nothing: forces on a post are as large as it is stiff, and who measures with
    a manometer may leave out the height, which its adapter closes off."""
    if leg.specimen == MANOMETER:
        return channel == "apex_height"
    return leg.specimen == POST and channel in (*TRANSDUCERS, *xyz("force"))


def leg_of(recording: Recording) -> Leg:
    """A recording's command as a leg of a simulated session."""
    times = [s.time for s in recording.streams.values() if len(s.time)]
    begin, end = min(float(t[0]) for t in times), max(float(t[-1]) for t in times)
    tables = {
        q: (np.asarray(s.time, float) - begin, np.asarray(s.value, float)) for q, s in recording.setpoints.items()
    }
    info = recording.info
    return Leg(tables, end - begin, info.specimen or SKIN, info.repeat, info.specimen_properties)


def telling(recordings: Sequence[Recording]) -> dict[int, int]:
    """Numbers of the recordings whose command and specimen none before them had (`MOST` of a robot's on skin at most),
    and how many there are of each: a repeat would take as long to simulate, and tells the same again."""
    first: dict[tuple[str, ...], int] = {}
    often: Counter[tuple[str, ...]] = Counter()
    for k, r in enumerate(recordings):
        kind = (r.info.specimen, direction(r), level(r), waveform(r))
        slow = r.info.instrument == "microrobot" and r.info.specimen == SKIN
        if kind not in first and not (slow and sum(f[0] == SKIN for f in first) >= MOST):
            first[kind] = k
        often[kind] += 1
    return {k: often[kind] for kind, k in first.items()}


def _noise(session: Session, channel: str) -> tuple[float, float]:
    """Noise of one sample of a channel and the part that averaging does not lower, by the recordings, SI."""
    members = [k for k, r in enumerate(session.recordings) if channel in r.streams]
    if not members:  # not measured: its rows say nothing, but for a second gauge's, which an experiment may add
        return (MANOMETER_NOISE, 0.0) if channel == SECOND else (np.inf, 0.0)
    noise = session.sigma(channel, members, np.zeros(0))
    times = COMPUTED if channel in (*xyz("probe"), *xyz("force")) else 1.0
    return max(noise.white, 1e-12) * times, noise.kept * times


def scaled(instrument: str, recordings: Sequence[Recording], legs: Sequence[Leg]) -> SuctionTissue | SheetTissue:
    """The forearm's skin made as compliant as the recorded one."""
    skin = [k for k, leg in enumerate(legs) if leg.specimen == SKIN]
    if instrument == "microrobot":
        sheet = sheet_tissue("forearm")
        ratios = []
        for k in skin:
            path = np.sqrt(sum(np.square(recordings[k].streams[c].value) for c in xyz("probe")))
            force = np.sqrt(sum(np.square(recordings[k].streams[c].value) for c in xyz("force")))
            ratios.append(float(np.nanmax(force) / max(np.nanmax(path), 1e-9)))
        factor = float(np.clip(np.median(ratios) / np.mean(sheet.stiffness), 0.1, 10.0)) if ratios else 1.0
        return replace(sheet, stiffness=tuple(k * factor for k in sheet.stiffness))  # type: ignore[arg-type]
    tissue = suction_tissue("forearm")
    ratios = []
    for k in skin:
        if "apex_height" in recordings[k].streams:
            deepest = float(np.max(np.abs(legs[k].quantity_tables["pressure"][1])))
            height = float(np.nanmax(recordings[k].streams["apex_height"].value))
            there = for_opening(tissue, OPENING[instrument])
            q = deepest / there.knee
            elastic = there.compliance * there.knee * ((1 + q) ** there.exponent - 1) / there.exponent
            ratios.append(height / max(1.4 * elastic, 1e-12))
    factor = float(np.clip(np.median(ratios), 0.1, 10.0)) if ratios else 1.0
    return replace(tissue, compliance=tissue.compliance * factor)
