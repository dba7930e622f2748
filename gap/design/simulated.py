"""Sessions from the project's own simulator: tier T0 of the blind check, and the material for calibration and planning.

A session is as a lab would measure it: a few levels (or directions), a second waveform, repeats, maybe a reference
specimen. Rests between recordings are simulated too, so that slow effects see the session's clock.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from acquire.recording.model import Recording, RunInfo, Series
from protocols.specimens import MANOMETER, SKIN, SPECIMENS, Stated
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages import RATES, noisy, nominal
from sim_devices.stages.robot import TRANSDUCERS, closed_loop, numbered, xyz
from sim_devices.stages.sampling import simulate
from sim_devices.stages.specimens import meets, mounted
from sim_devices.stages.suction import OPENING, with_tissue
from sim_devices.stages.tissues import SheetTissue, SuctionTissue, for_opening, sheet_tissue, suction_tissue

ROBOT_RATE = 100.0
"""Samples per second that robot sessions keep: the motion is slow, the files stay small."""
SETTLING = 100
"""Samples for which a robot has settled under a weight before a recording begins."""
MANOMETER_NOISE = 30.0
"""Pa: standard deviation of a second gauge's sample (assumed)."""
ROBOT_SUBSTEPS = 5
"""Simulated steps for each sample kept: a loop that is solved on its samples alone is late by part of one."""


@dataclass(frozen=True)
class Leg:
    """One recording of a session: its command as corners (s from its start, SI), duration, specimen and repeat."""

    quantity_tables: Mapping[str, tuple[FloatArray, FloatArray]]
    duration: float
    specimen: str = SKIN
    repeat: int = 1
    known: Mapping[str, Stated] = field(default_factory=dict)  # of a reference specimen

    @property
    def label(self) -> str:
        """The specimen and its stated numbers: such recordings are simulated together."""
        return f"{self.specimen} {sorted((key, str(stated)) for key, stated in self.known.items())}"


@dataclass(frozen=True)
class Schedule:
    """Legs on a session's clock: when each starts (s), and the instants at which it is sampled (s)."""

    legs: Sequence[Leg]
    starts: FloatArray
    stamps: Sequence[FloatArray]

    @classmethod
    def of(cls, legs: Sequence[Leg], rate: float, pause: float) -> Schedule:
        """Legs one after the other, ``pause`` s apart, sampled at ``rate`` Hz."""
        starts = np.cumsum([0.0, *[leg.duration + pause for leg in legs]])[:-1]
        stamps = [s + np.arange(0.0, leg.duration, 1 / rate) for s, leg in zip(starts, legs, strict=True)]
        return cls(legs, starts, stamps)

    def together(self) -> list[list[int]]:
        """Numbers of the legs that are simulated together: on one specimen, as one series."""
        labels = dict.fromkeys(leg.label for leg in self.legs)
        return [[k for k, leg in enumerate(self.legs) if leg.label == label] for label in labels]

    def command(self, quantity: str, members: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Corners (s, SI) of a quantity's command in the legs ``members``."""
        time = np.concatenate([self.starts[k] + self.legs[k].quantity_tables[quantity][0] for k in members])
        return time, np.concatenate([self.legs[k].quantity_tables[quantity][1] for k in members])

    def instants(self, members: Sequence[int]) -> FloatArray:
        """Sampling instants (n,) s of the legs ``members``."""
        return np.concatenate([self.stamps[k] for k in members])

    def parts(self, members: Sequence[int]) -> Iterator[tuple[int, slice]]:
        """Each of the legs ``members`` and its part of their common series."""
        end = 0
        for k in members:
            begin, end = end, end + len(self.stamps[k])
            yield k, slice(begin, end)

    def recordings(self, instrument: str, channels: Mapping[int, Mapping[str, FloatArray]]) -> list[Recording]:
        """A recording of each leg, with its ``channels``."""
        begin = datetime(2026, 1, 1, tzinfo=UTC)
        return [
            _recording(instrument, leg, channels[k], stamps, float(start), begin + timedelta(seconds=float(start)))
            for k, (leg, start, stamps) in enumerate(zip(self.legs, self.starts, self.stamps, strict=True))
        ]


def step_hold(level: float, hold: float, rest: float, lead: float = 1.0) -> Leg:
    """Suction ``level`` Pa for ``hold`` s, then ``rest`` s vented."""
    time = np.array([0.0, lead, lead, lead + hold, lead + hold, lead + hold + rest])
    value = np.array([0.0, 0.0, level, level, 0.0, 0.0])
    return Leg({"pressure": (time, value)}, float(time[-1]))


def triangle(level: float, leg: float, cycles: int, rest: float, lead: float = 1.0) -> Leg:
    """``cycles`` linear loadings to ``level`` Pa and back, ``leg`` s each way, then ``rest`` s vented."""
    time = [0.0, *(lead + leg * np.arange(2 * cycles + 1)), lead + 2 * leg * cycles + rest]
    value = [0.0, *([0.0, level] * cycles), 0.0, 0.0]
    return Leg({"pressure": (np.asarray(time), np.asarray(value))}, float(time[-1]))


def suction_legs(instrument: str, rng: np.random.Generator) -> list[Leg]:
    """A session's recordings: two or three levels held, one triangle, one of them repeated."""
    top = float(rng.uniform(300, 450) if instrument == "cutometer" else rng.uniform(150, 220)) * -100.0
    hold, rest = float(rng.choice([10.0, 20.0, 31.0])), float(rng.choice([5.0, 10.0]))
    shares = (1.0, 0.5) if rng.random() < 0.5 else (1.0, 0.66, 0.33)
    levels = [100.0 * round(top * share / 100.0) for share in shares]
    top = levels[0]
    legs = [step_hold(level, hold, rest) for level in levels]
    legs.append(replace(step_hold(top, hold, rest), repeat=2))
    legs.append(triangle(top, float(rng.choice([6.0, 10.0, 17.5])), int(rng.choice([1, 3])), rest))
    if rng.random() < 0.3:
        legs.append(replace(step_hold(top, 5.0, 3.0), specimen="rigid block"))
    return legs


def suction_session(
    instrument: str,
    rng: np.random.Generator,
    effects: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    tissue: SuctionTissue | None = None,
    legs: Sequence[Leg] | None = None,
    scatter: float = 0.03,
    pause: float = 20.0,
) -> list[Recording]:
    """Recordings of a simulated session; ``scatter`` is the relative run-to-run scatter of the skin's height."""
    plan = Schedule.of(legs if legs is not None else suction_legs(instrument, rng), RATES[instrument], pause)
    tissue = tissue or suction_tissue("forearm")
    made: dict[int, dict[str, FloatArray]] = {}
    for members in plan.together():
        leg = plan.legs[members[0]]
        chain = nominal(instrument, marks=tuple(float(plan.starts[k]) for k in members))
        law = tissue if leg.specimen in (SKIN, *SPECIMENS) else suction_tissue(leg.specimen)
        chain = with_tissue(chain, for_opening(law, OPENING[instrument]))
        chain = noisy(_mounted(chain, leg, effects), int(rng.integers(1 << 30)), scatter=0.0)
        wanted = ("pressure", "apex_height", *(["pressure_reference"] if leg.specimen == MANOMETER else []))
        at = plan.instants(members)
        signals = simulate(chain, {"pressure": plan.command("pressure", members)}, dict.fromkeys(wanted, at))
        for k, part in plan.parts(members):
            made[k] = _repeated(signals, part, ("apex_height",), _gain(leg, scatter, rng))
            if "pressure_reference" in made[k]:
                made[k]["pressure_reference"] += MANOMETER_NOISE * rng.standard_normal(part.stop - part.start)
    return plan.recordings(instrument, made)


def _gain(leg: Leg, scatter: float, rng: np.random.Generator) -> float:
    """The run-to-run gain of a specimen's answer: only skin scatters."""
    return 1 + scatter * rng.standard_normal() if leg.specimen == SKIN else 1.0


def _repeated(
    signals: Mapping[str, FloatArray], part: slice, answers: Sequence[str], gain: float
) -> dict[str, FloatArray]:
    """A part of simulated signals, the specimen's answers (by the beginnings of their names) times ``gain``."""
    return {name: values[part] * (gain if name.startswith(tuple(answers)) else 1.0) for name, values in signals.items()}


def _mounted(chain: Chain, leg: Leg, effects: Sequence[tuple[Effect, Mapping[str, float]]]) -> Chain:
    """The chain on a leg's specimen, with the effects that show on it."""
    if leg.specimen in SPECIMENS:
        chain = mounted(chain, leg.specimen, leg.known)
    for effect, values in effects:
        if meets(effect, leg.specimen):
            chain = effect.apply(chain, values)
    return chain


def direction_cycles(azimuth: float, elevation: float, size: float, period: float, cycles: int) -> Leg:
    """``cycles`` triangles of ``size`` m along a direction (rad), ``period`` s each, back to the centre."""
    along = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    time = [0.0, *(0.5 + 0.5 * period * np.arange(2 * cycles + 1)), 1.0 + period * cycles]
    path = np.array([0.0, *([0.0, size] * cycles), 0.0, 0.0])
    tables = {f"probe_{a}": (np.asarray(time), path * along[k]) for k, a in enumerate("xyz")}
    return Leg(tables, float(time[-1]))


def robot_legs(rng: np.random.Generator) -> list[Leg]:
    """A session's recordings: in-plane directions, the normal, one repeated, one faster."""
    size = float(rng.uniform(1.0, 1.4)) * 1e-3
    azimuths = np.radians(np.arange(0.0, 360.0, float(rng.choice([45.0, 60.0]))))
    legs = [direction_cycles(a, 0.0, size, 10.0, 3) for a in azimuths]
    legs.append(direction_cycles(0.0, np.pi / 2, 0.8 * size, 10.0, 3))
    legs.append(replace(direction_cycles(azimuths[0], 0.0, size, 10.0, 3), repeat=2))
    legs.append(direction_cycles(azimuths[1], 0.0, size, 4.0, 3))
    if rng.random() < 0.3:
        legs.append(replace(direction_cycles(0.0, 0.0, size, 10.0, 1), specimen="open air"))
    return legs


def robot_session(
    rng: np.random.Generator,
    effects: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    tissue: SheetTissue | None = None,
    legs: Sequence[Leg] | None = None,
    scatter: float = 0.03,
    pause: float = 1.0,
) -> list[Recording]:
    """Recordings of a simulated robot session; ``scatter`` as for suction."""
    plan = Schedule.of(legs if legs is not None else robot_legs(rng), ROBOT_RATE, pause)
    names = (*numbered("axis_position"), *TRANSDUCERS, *xyz("probe"), *xyz("force"))
    tissue = tissue or sheet_tissue("forearm")
    made: dict[int, dict[str, FloatArray]] = {}
    for members in plan.together():
        leg = plan.legs[members[0]]
        law = tissue if leg.specimen in (SKIN, *SPECIMENS) else sheet_tissue(leg.specimen)
        chain = nominal("microrobot", tissue=law)
        chain = noisy(_mounted(chain, leg, effects), int(rng.integers(1 << 30)), scatter=0.0)
        # A weight hangs there before it is recorded: the axes have settled under it.
        lead = SETTLING if leg.specimen == "dead weight" else 0
        before = plan.stamps[members[0]][0] - np.arange(lead, 0, -1) / ROBOT_RATE
        fine = np.concatenate([_fine(before), *(_fine(plan.stamps[k]) for k in members)])
        inputs = {f"command_{a}": np.interp(fine, *plan.command(f"probe_{a}", members)) for a in "xyz"}
        found = closed_loop(chain, fine, inputs)
        signals = {name: found[name][::ROBOT_SUBSTEPS][lead:] for name in names}
        for k, part in plan.parts(members):
            made[k] = _repeated(signals, part, ("transducer", "force"), _gain(leg, scatter, rng))
    return plan.recordings("microrobot", made)


def _fine(stamps: FloatArray) -> FloatArray:
    """`ROBOT_SUBSTEPS` instants for each of ``stamps`` (n,), itself the first of them."""
    return (stamps[:, None] + np.arange(ROBOT_SUBSTEPS) / (ROBOT_SUBSTEPS * ROBOT_RATE)).ravel()


def _recording(
    instrument: str, leg: Leg, channels: Mapping[str, FloatArray], time: FloatArray, start: float, begin: datetime
) -> Recording:
    streams = {
        name: Series(
            value,
            time,
            _unit(name),
            seq=np.arange(len(time)),
        )
        for name, value in channels.items()
    }
    unit = "Pa" if instrument != "microrobot" else "m"
    setpoints = {q: Series(v, t + start, unit) for q, (t, v) in leg.quantity_tables.items()}
    info = RunInfo(
        id=f"simulated-{start:.0f}", instrument=instrument, start_time=begin.isoformat(), subject="P00", site="forearm",
        specimen=leg.specimen, specimen_properties=leg.known, repeat=leg.repeat,
    )  # fmt: skip
    return Recording(info, streams, setpoints)


def _unit(channel: str) -> str:
    return "N" if "force" in channel else "Pa" if channel.startswith("pressure") else "m"


def session(
    instrument: str, rng: np.random.Generator, effects: Sequence[tuple[Effect, Mapping[str, float]]] = ()
) -> list[Recording]:
    """Recordings of a simulated session of any of our instruments."""
    if instrument == "microrobot":
        return robot_session(rng, effects)
    return suction_session(instrument, rng, effects)
