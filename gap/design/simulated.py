"""Sessions from the project's own simulator: tier T0 of the blind check, and the material for calibration and planning.

A session is as a lab would measure it: a few levels (or directions), a second waveform, repeats, maybe a reference
specimen. Rests between recordings are simulated too, so that slow effects see the session's clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    legs = list(legs) if legs is not None else suction_legs(instrument, rng)
    tissue = tissue or suction_tissue("forearm")
    starts = np.cumsum([0.0, *[leg.duration + pause for leg in legs]])[:-1]
    rate = RATES[instrument]
    stamps = [s + np.arange(0.0, leg.duration, 1 / rate) for s, leg in zip(starts, legs, strict=True)]
    made: list[dict[str, FloatArray]] = [{} for _ in legs]
    for label in dict.fromkeys(leg.label for leg in legs):
        members = [k for k, leg in enumerate(legs) if leg.label == label]
        leg = legs[members[0]]
        chain = nominal(instrument, marks=tuple(float(starts[k]) for k in members))
        law = tissue if leg.specimen in (SKIN, *SPECIMENS) else suction_tissue(leg.specimen)
        chain = with_tissue(chain, for_opening(law, OPENING[instrument]))
        chain = noisy(_mounted(chain, leg, effects), int(rng.integers(1 << 30)), scatter=0.0)
        wanted = ("pressure", "apex_height", *(["pressure_reference"] if leg.specimen == MANOMETER else []))
        time = np.concatenate([starts[k] + legs[k].quantity_tables["pressure"][0] for k in members])
        value = np.concatenate([legs[k].quantity_tables["pressure"][1] for k in members])
        at = np.concatenate([stamps[k] for k in members])
        signals = simulate(chain, {"pressure": (time, value)}, dict.fromkeys(wanted, at))
        ends = np.cumsum([len(stamps[k]) for k in members])
        for k, end in zip(members, ends, strict=True):
            part = slice(end - len(stamps[k]), end)
            gain = 1 + scatter * rng.standard_normal() if leg.specimen == SKIN else 1.0
            made[k] = {name: signals[name][part] * (gain if name == "apex_height" else 1.0) for name in wanted}
            if "pressure_reference" in made[k]:
                made[k]["pressure_reference"] += MANOMETER_NOISE * rng.standard_normal(end - part.start)
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    return [
        _recording(instrument, leg, made[k], stamps[k], float(starts[k]), begin + timedelta(seconds=float(starts[k])))
        for k, leg in enumerate(legs)
    ]


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
    legs = list(legs) if legs is not None else robot_legs(rng)
    starts = np.cumsum([0.0, *[leg.duration + pause for leg in legs]])[:-1]
    stamps = [s + np.arange(0.0, leg.duration, 1 / ROBOT_RATE) for s, leg in zip(starts, legs, strict=True)]
    names = (*numbered("axis_position"), *TRANSDUCERS, *xyz("probe"), *xyz("force"))
    made: list[dict[str, FloatArray]] = [{} for _ in legs]
    for label in dict.fromkeys(leg.label for leg in legs):
        members = [k for k, leg in enumerate(legs) if leg.label == label]
        leg = legs[members[0]]
        skin = tissue or sheet_tissue("forearm")
        law = skin if leg.specimen in (SKIN, *SPECIMENS) else sheet_tissue(leg.specimen)
        chain = nominal("microrobot", tissue=law)
        chain = noisy(_mounted(chain, leg, effects), int(rng.integers(1 << 30)), scatter=0.0)
        # A weight hangs there before it is recorded: the axes have settled under it.
        lead = SETTLING if leg.specimen == "dead weight" else 0
        before = stamps[members[0]][0] - np.arange(lead, 0, -1) / ROBOT_RATE
        fine = np.concatenate([_fine(before), *(_fine(stamps[k]) for k in members)])
        inputs = {}
        for quantity, signal in (("probe_x", "command_x"), ("probe_y", "command_y"), ("probe_z", "command_z")):
            time = np.concatenate([starts[k] + legs[k].quantity_tables[quantity][0] for k in members])
            inputs[signal] = np.interp(
                fine, time, np.concatenate([legs[k].quantity_tables[quantity][1] for k in members])
            )
        signals = {name: values[::ROBOT_SUBSTEPS][lead:] for name, values in closed_loop(chain, fine, inputs).items()}
        ends = np.cumsum([len(stamps[k]) for k in members])
        for k, end in zip(members, ends, strict=True):
            gain = 1 + scatter * rng.standard_normal() if leg.specimen == SKIN else 1.0
            made[k] = {
                n: signals[n][end - len(stamps[k]) : end] * (gain if n.startswith(("transducer", "force")) else 1.0)
                for n in names
            }
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    return [
        _recording("microrobot", leg, made[k], stamps[k], float(starts[k]), begin + timedelta(seconds=float(starts[k])))
        for k, leg in enumerate(legs)
    ]


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
