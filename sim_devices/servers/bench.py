"""Each simulated instrument: its dialect, its queue, its sampling, the signals of the chain it measures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import numpy as np

from drivers import aspiration, cutometer, microrobot
from drivers.aspiration.pressure import CAPACITY as PRESSURE_CAPACITY
from drivers.aspiration.pressure import PressureCodec
from drivers.cutometer.codec import CAPACITY as CUTOMETER_CAPACITY
from drivers.cutometer.codec import CutometerCodec
from drivers.device import Identity
from drivers.instrument import Instrument
from drivers.microrobot.codec import CAPACITY as ROBOT_CAPACITY
from drivers.microrobot.codec import RAW as ROBOT_RAW
from drivers.microrobot.codec import MicrorobotCodec
from drivers.microrobot.forces import Calibration, transducer_volts
from drivers.microrobot.processing import TARE_SAMPLES
from drivers.signals import REFERENCE, FloatArray
from drivers.stream import Codec
from sim_devices.chain import Signals

#: Vendor and product id of the virtual controller: from the range that pid.codes keeps for tests.
USB_ID = (0x1209, 0x0001)
#: Standard deviation of a second pressure gauge, Pa (assumed).
REFERENCE_NOISE = 30.0
#: Nominal sensitivity; the nulls are within the data sheet's 15 mV, and the magnet seat presses on each leg.
TRANSDUCERS = Calibration(null=(0.031, 0.022, 0.027))


@dataclass(frozen=True)
class Bench:
    """One kind of simulated instrument.

    ``command`` maps each quantity to the chain's input; ``measure`` takes the chain's signals (n,) to the raw channels
    (n, raw) of the wire. ``rate`` is samples per s, ``substeps`` how many steps of the chain make a sample,
    ``longest`` the most samples in a block. ``still`` says from the true signals' last values whether the patient is
    free. ``seen`` is the signal that a camera sees, at ``rate``; empty without camera. ``zeroing`` is the operator
    that begins anew when the instrument is armed. ``unload`` turns raw values (n, raw) into those before the probe
    touches the skin, as the first ``unloaded`` samples of a stream are: a session begins with taring.
    """

    instrument: Instrument
    identity: Identity
    codec: Callable[[], Codec]
    capacity: int
    raw: tuple[str, ...]
    command: Mapping[str, str]
    measure: Callable[[Signals], FloatArray]
    rate: float
    substeps: int
    longest: int
    still: Callable[[Mapping[str, float]], bool]
    seen: str = ""
    zeroing: str = ""
    unload: Callable[[FloatArray], None] | None = None
    unloaded: int = 0


def _columns(*names: str) -> Callable[[Signals], FloatArray]:
    return lambda signals: np.column_stack([signals[name] for name in names])


def _robot_raw(signals: Signals) -> FloatArray:
    forces = np.column_stack([signals[f"transducer_force_{k}"] for k in "abc"])
    positions = [signals[f"axis_position_{k}"] for k in (1, 2, 3)]
    return np.column_stack([*positions, transducer_volts(forces, TRANSDUCERS)])


def _hang_free(raw: FloatArray) -> None:
    raw[:, 3:] = transducer_volts(np.zeros(3), TRANSDUCERS)


def _vented(signals: Mapping[str, float]) -> bool:
    """Within 3 mbar of the room's pressure."""
    return abs(signals["line_pressure"]) < 300.0


def _centred(signals: Mapping[str, float]) -> bool:
    """Every axis within 0.1 mm of the centre pose."""
    return all(abs(signals[f"axis_{k}"]) < 1e-4 for k in (1, 2, 3))


def with_reference(bench: Bench, seed: int) -> Bench:
    """The bench of a suction instrument with a second gauge at the line, without the first one's effects."""
    noise, codec = np.random.default_rng([seed, 7]), cast("Callable[..., Codec]", bench.codec)

    def measure(signals: Signals) -> FloatArray:
        line = signals["pressure_reference"]
        return np.column_stack([bench.measure(signals), line + REFERENCE_NOISE * noise.standard_normal(len(line))])

    raw = (*bench.raw, f"pressure{REFERENCE}")
    return replace(bench, codec=partial(codec, reference=True), raw=raw, measure=measure)


BENCHES: dict[str, Bench] = {
    "cutometer": Bench(
        instrument=cutometer.INSTRUMENT,
        identity=Identity("simulated Cutometer MPA 580", "SIM-C1", "skinrig 1"),
        codec=CutometerCodec,
        capacity=CUTOMETER_CAPACITY,
        raw=("pressure", "apex_height"),
        command={"pressure": "command_pressure"},
        measure=_columns("pressure", "apex_height"),
        rate=100.0,
        substeps=4,
        longest=250,
        still=_vented,
        zeroing="zeroing",
    ),
    "aspiration": Bench(
        instrument=aspiration.INSTRUMENT,
        identity=Identity("simulated aspiration device", "SIM-A1", "skinrig 1"),
        codec=PressureCodec,
        capacity=PRESSURE_CAPACITY,
        raw=("pressure",),
        command={"pressure": "command_pressure"},
        measure=_columns("pressure"),
        rate=25.0,
        substeps=16,
        longest=50,
        still=_vented,
        zeroing="zeroing",
        seen="apex_height",
    ),
    "microrobot": Bench(
        instrument=microrobot.INSTRUMENT,
        identity=Identity("simulated micro-robot controller", "SIM-M1", "skinrig 1"),
        codec=MicrorobotCodec,
        capacity=ROBOT_CAPACITY,
        raw=ROBOT_RAW,
        command={q: f"command_{q[-1]}" for q in microrobot.QUANTITIES},
        measure=_robot_raw,
        rate=1000.0,
        substeps=1,
        longest=500,
        still=_centred,
        unload=_hang_free,
        unloaded=TARE_SAMPLES,
    ),
}
