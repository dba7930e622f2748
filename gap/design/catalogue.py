"""The experiments that can be asked for: specimens, waveforms and levels, within an instrument's limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from gap.data.session import SKIN
from gap.design.experiment import Experiment, protocol_of
from gap.design.simulated import Leg
from protocols import Limits, Protocol, ProtocolError, compile_protocol
from protocols.specimens import SPECIMENS, Stated, stated

Steps = tuple[Mapping[str, Any], ...]

HANDLING = {SKIN: 0.5, "open air": 1.0}
"""Minutes of handling before a recording on a specimen (assumed), and on any other:"""
MOUNTING = 1.5
REST = {SKIN: 60.0}
"""s that a specimen rests before: skin recovers, a reference needs but a moment."""
AT_ONCE = 5.0


def catalogue(
    instrument: str, legs: Sequence[Leg], limits: Limits, specimens: Sequence[str] = (), seed: int = 1
) -> list[Experiment]:
    """Every experiment within ``limits`` on an instrument whose session so far is ``legs``; ``specimens`` restricts it
    to those at hand. Never more suction, and never a larger excursion, than the session had on skin."""
    size = max((float(np.max(np.abs(v))) for leg in legs for _, v in leg.quantity_tables.values()), default=0.0)
    if size <= 0:
        return []
    found = []
    for specimen, waveform, steps in _robot(size) if instrument == "microrobot" else _suction(size):
        if specimens and specimen not in specimens:
            continue
        leg = _compiled(instrument, steps, specimen, limits)
        if leg is not None:
            rest = REST.get(specimen, AT_ONCE)
            minutes = HANDLING.get(specimen, MOUNTING) + (rest + leg.duration) / 60.0
            known = {key: value.plain() for key, value in leg.known.items()}
            found.append(Experiment(instrument, specimen, waveform, steps, leg, known, 1, rest, minutes, seed=seed))
    return found


def _compiled(instrument: str, steps: Steps, specimen: str, limits: Limits) -> Leg | None:
    """The set-points of some steps; None where the limits forbid them."""
    protocol = Protocol.model_validate(protocol_of(instrument, "experiment", "", steps))
    try:
        setpoints = compile_protocol(protocol, limits)
    except ProtocolError:
        return None
    time, values = setpoints.table()
    tables = {q: (time, v) for q, v in values.items()}
    return Leg(tables, setpoints.duration, specimen, known=usual(specimen, instrument))


def usual(specimen: str, instrument: str) -> Mapping[str, Stated]:
    """The usual numbers of a reference specimen; a laboratory's own may say something else."""
    numbers = {
        "gauge step": {"height": "0.300±0.002 mm" if instrument == "cutometer" else "2.000±0.002 mm"},
        "reference membrane": {"memory": "0.01"},
        "reference spring": {"k": "400±4 N/m"},
        "dead weight": {"mass": "20.00±0.02 g", "direction": "0, 0, -1 ± 0.01"},
    }
    return stated(specimen, numbers.get(specimen, {})) if specimen in SPECIMENS else {}


def _suction(top: float) -> Iterator[tuple[str, str, Steps]]:
    def mbar(share: float) -> str:
        return f"{max(round(share * top / 100.0), 1)} mbar"

    wait = {"type": "wait", "duration": "1 s"}

    def rest(seconds: int) -> dict[str, str]:
        return {"type": "wait", "duration": f"{seconds} s"}

    def step(share: float, hold: int, after: int) -> Steps:
        return (wait, {"type": "hold", "suction": mbar(share), "duration": f"{hold} s"}, rest(after))

    def triangles(share: float, leg: float, cycles: int) -> Steps:
        return (wait, {"type": "cycle", "suction": mbar(share), "t_lin": f"{leg:g} s", "cycles": cycles}, rest(5))

    stairs = (wait, *({"type": "hold", "suction": mbar(s), "duration": "4 s"} for s in (0.33, 0.66, 1.0, 0.5)), rest(5))
    waveforms = {
        "a step": step(1.0, 10, 5),
        "a step of a third": step(0.33, 10, 5),
        "a slow triangle": triangles(1.0, 20.0, 1),
        "three quick triangles": triangles(1.0, 2.0, 3),
        "a staircase": stairs,
    }
    for name, steps in waveforms.items():
        yield SKIN, name, steps
        yield "reference membrane", name, steps
    yield SKIN, "a long hold", step(1.0, 60, 30)
    for name in ("a step", "three quick triangles", "a staircase"):
        yield "rigid block", name, waveforms[name]
        yield "manometer", name, waveforms[name]
    yield "gauge step", "at rest", (rest(12),)


def _robot(size: float) -> Iterator[tuple[str, str, Steps]]:
    directions = [{"theta": f"{a} deg", "phi": "0 deg"} for a in (0, 120, 240)] + [{"theta": "0 deg", "phi": "90 deg"}]

    def cycles(share: float, hertz: float, number: int) -> Steps:
        size_of = f"{1e3 * share * size:.4g} mm"
        move = {"type": "trajectory", "directions": directions, "amplitude": size_of, "frequency": f"{hertz} Hz"}
        return ({"type": "wait", "duration": "1 s"}, move | {"cycles": number}, {"type": "wait", "duration": "2 s"})

    waveforms = {
        "slow cycles in four directions": cycles(1.0, 0.2, 1),
        "quick cycles in four directions": cycles(1.0, 0.5, 2),
        "half the amplitude": cycles(0.5, 0.25, 1),
    }
    for name, steps in waveforms.items():
        yield SKIN, name, steps
        yield "open air", name, steps
        yield "reference spring", name, steps
    yield "rigid post", "half the amplitude", cycles(0.2, 0.2, 2)
    yield "dead weight", "at rest", ({"type": "wait", "duration": "10 s"},)
