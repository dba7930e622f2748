"""Unknowns of an instrument and of its specimen, as columns of a linear model.

Tolerances of the instrument, zero and gain of every recording, properties of reference specimens with some
uncertainty, and whatever skin of any law could do (`gap.design.anylaw`). Columns of one name are the same unknown in
session and experiment.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from drivers.microrobot import forces
from gap.data.session import SKIN
from gap.data.tolerances import tolerances
from gap.design.anylaw import lagged, remembered
from gap.design.bench import SECOND, Bench, Part
from protocols.specimens import MANOMETER, SPECIMENS, Stated
from sim_devices.chain import FloatArray
from sim_devices.stages.axes import LOOP_RATE
from sim_devices.stages.axes import MASS as AXIS_MASS
from sim_devices.stages.robot import TRANSDUCERS, xyz

TRANSDUCER_ZERO, MASS = 5e-3, 0.1
"""N: how far a transducer's zero is off; and how far an axis' moving mass, relative (assumed)."""
BROAD = 0.5
"""Prior of a column of any law of skin, in parts of the skin's largest answer."""
SCATTER, ZERO = 0.05, 3.0
"""Run-to-run scatter of skin (relative), and of a recording's zero, in noises of one sample (assumed)."""
RATES = (0.1, 0.4, 1.6, 6.4, 25.0)
"""s: skin's answer scatters not in size alone, but also in how much of it comes late, by as much in each of these lags;
without that, one more recording on skin is taken to tell what only a specimen without a life of its own can."""
CURVED = ("reference membrane",)
"""Specimens whose elastic curve is not known, but has no memory."""
Signals: TypeAlias = Sequence[Mapping[str, FloatArray]]
Changes: TypeAlias = list[dict[str, FloatArray]]
"""Changes of the channels of every recording."""
Column: TypeAlias = tuple[str, ...]
"""The name of an unknown."""


class Unknowns:
    """The unknowns of sessions on a bench."""

    def __init__(self, bench: Bench) -> None:
        self.bench, self.tolerances = bench, tolerances(bench.instrument)

    def of(self, part: Part) -> dict[Column, FloatArray]:
        """Whitened columns (n,) by which each unknown, one width of its prior off, changes the rows of a part."""
        sound = self.bench.simulate(part)
        columns = self._tolerances(part, sound) | self._of_recordings(part, sound) | self._of_specimens(part, sound)
        columns |= self._of_references(part, sound)
        return {name: self.bench.rows(part, made) for name, made in columns.items()}

    def _tolerances(self, part: Part, sound: Signals) -> dict[Column, Changes]:
        """Tolerances of a fault-free instrument (`gap.data.tolerances`), each by its stated value."""

        def late(seconds: Callable[[FloatArray], Any], only: Sequence[str] = ()) -> Changes:
            return [
                {c: -seconds(at) * np.gradient(v, at) for c, v in s.items() if not only or c in only}
                for s, at in zip(sound, part.stamps, strict=True)
            ]

        def scaled(channel: str, share: float) -> Changes:
            return [{channel: share * s[channel]} for s in sound]

        def off(channel: str, amount: float) -> Changes:
            return [{channel: np.full(len(at), amount)} for at in part.stamps]

        known = {group: {name: t.value for name, t in stated.items()} for group, stated in self.tolerances.items()}
        out: dict[Column, Changes] = {
            ("latency",): late(lambda at: known["latency"]["delay"]),
            ("skew",): late(lambda at: known["clock_skew"]["rate"] * (at - part.starts[0])),
        }
        if self.bench.robot:
            for c in TRANSDUCERS:
                out[("gain", c)] = _with_forces(scaled(c, known["sensor_gain"]["error"]))
                out[("offset", c)] = _with_forces(off(c, TRANSDUCER_ZERO))
            rate, mass = 1 + known["loop"]["proportional"], 1 + MASS
            tuned = {"loop": ("axes", "rate", LOOP_RATE * rate), "mass": ("axes", "mass", AXIS_MASS * mass),
                     "drag": ("axes", "drag", known["viscous_drag"]["drag"])}  # fmt: skip
        else:
            out[("height late",)] = late(lambda at: known["desynchronisation"]["shift"], ("apex_height",))
            out[("gauge gain",)] = scaled("pressure", known["gauge_gain"]["error"])
            out[("gauge zero",)] = off("pressure", known["gauge_offset"]["offset"])
            stated = self.tolerances["quantities"]
            tuned = {
                name: ("regulator", operator, stated[quantity].nominal + stated[quantity].value)
                for name, operator, quantity in (
                    ("regulator", "tau", "regulator_time"), ("damping", "zeta", "regulator_damping")
                )
            }  # fmt: skip
        for name, (operator, parameter, value) in tuned.items():
            moved = self.bench.simulate(part, tuned={operator: {parameter: value}})
            out[(name,)] = [{c: m[c] - s[c] for c in s} for m, s in zip(moved, sound, strict=True)]
        return out

    def _of_recordings(self, part: Part, sound: Sequence[Mapping[str, FloatArray]]) -> dict[Column, Changes]:
        """Zero of every recording and, of skin, its gain, at once and late."""
        answers = TRANSDUCERS if self.bench.robot else ("apex_height",)
        out: dict[Column, Changes] = {}
        for k, (leg, signals, at) in enumerate(zip(part.legs, sound, part.stamps, strict=True)):

            def only(made: dict[str, FloatArray], k: int = k) -> Changes:
                return [made if i == k else {} for i in range(len(part.legs))]

            if not self.bench.robot:
                out[(part.name, "zero", str(k))] = only(
                    {c: np.full(len(at), ZERO * self.bench.noise[c][0]) for c in answers}
                )
            if leg.specimen == SKIN:
                scattered = (*answers, *(xyz("force") if self.bench.robot else ()))
                out[(part.name, "gain", str(k))] = only({c: SCATTER * signals[c] for c in scattered})
                for tau in RATES:
                    late = {c: lagged([at], [signals[c]], tau)[0] for c in scattered}
                    out[(part.name, f"gain after {tau} s", str(k))] = only({c: SCATTER * v for c, v in late.items()})
        return out

    def _of_specimens(self, part: Part, sound: Sequence[Mapping[str, FloatArray]]) -> dict[Column, Changes]:
        """Responses of skin of any law, or of a membrane of any curve."""
        out: dict[Column, Changes] = {}
        for specimen in (SKIN, *CURVED):
            members = [k for k, leg in enumerate(part.legs) if leg.specimen == specimen]
            if members:
                out |= self._of_any_law(part, sound, members, specimen)
        return out

    def _of_any_law(self, part: Part, sound: Signals, members: Sequence[int], specimen: str) -> dict[Column, Changes]:
        """Responses of one specimen of any law in the recordings ``members``."""
        causes, answers = (xyz("probe"), xyz("force")) if self.bench.robot else (("pressure",), ("apex_height",))
        times = [part.stamps[k] for k in members]
        given = [np.stack([sound[k][c] / self._sizes[c] for c in causes]) for k in members]
        out: dict[Column, Changes] = {}
        for axis, answer in enumerate(answers):
            size = self._sizes[answer]
            own = [sound[k][answer] / size for k in members]
            for number, feature in enumerate(remembered(times, given, own, memory=specimen == SKIN)):
                made: Changes = [{} for _ in part.legs]
                for k, values in zip(members, feature, strict=True):
                    made[k] = {answer: BROAD * size * values}
                out[(specimen, str(axis), str(number))] = _with_transducers(made) if self.bench.robot else made
        return out

    def _of_references(self, part: Part, sound: Signals) -> dict[Column, Changes]:
        """Uncertainties of reference specimens: their stated uncertainties, a second gauge's tolerance."""
        answers = (*TRANSDUCERS, *xyz("force")) if self.bench.robot else ("apex_height",)
        out: dict[Column, Changes] = {}
        for label in dict.fromkeys(leg.label for leg in part.legs if leg.specimen in SPECIMENS):
            on = [leg.label == label for leg in part.legs]
            leg = part.legs[on.index(True)]
            for key, stated in leg.known.items():
                share = stated.se / max(float(np.linalg.norm(stated.value)), 1e-12)
                out[(label, key)] = _where(on, [{c: share * s[c] for c in answers} for s in sound])
            if leg.specimen in CURVED:
                out[(label, "loss")] = _where(on, _lost(leg.known, part.stamps, sound))
            if leg.specimen == MANOMETER:
                out[(label, "gain")] = [
                    {SECOND: 1e-3 * s[SECOND]} if here else {} for here, s in zip(on, sound, strict=True)
                ]
        return out

    @cached_property
    def _sizes(self) -> Mapping[str, float]:
        """The largest value of each channel on this session's skin, for columns of equal meaning in every part."""
        every = zip(self.bench.simulate(self.bench.session), self.bench.session.legs, strict=True)
        skin = [s for s, leg in every if leg.specimen == SKIN]
        largest = {
            c: max((float(np.max(np.abs(s[c]))) for s in skin if c in s), default=0.0) or 1.0
            for c in self.bench.channels
        }
        for names in (xyz("probe"), xyz("force")) if self.bench.robot else ():
            largest |= dict.fromkeys(names, max(largest[n] for n in names))
        return largest


def _where(on: Sequence[bool], made: Changes) -> Changes:
    """Changes in the recordings that are ``on`` a specimen, none in the others."""
    return [m if here else {} for here, m in zip(on, made, strict=True)]


def _lost(known: Mapping[str, Stated], stamps: Sequence[FloatArray], sound: Signals) -> Changes:
    """The little memory of a membrane, which is known as a bound."""
    memory = known["memory"].scalar if "memory" in known else 0.01
    heights = [s["apex_height"] for s in sound]
    return [{"apex_height": memory * (h - lagged([at], [h], 0.3)[0])} for h, at in zip(heights, stamps, strict=True)]


def _with_forces(made: Changes) -> Changes:
    """Changes of the forces, which are computed from the transducers."""
    matrix = _force_matrix()
    for signals in made:
        zero = np.zeros(len(next(iter(signals.values()))))
        legs = np.stack([signals.get(c, zero) for c in TRANSDUCERS])
        signals.update(zip(xyz("force"), matrix @ legs, strict=True))
    return made


def _with_transducers(made: Changes) -> Changes:
    """Changes of the transducers where the forces do."""
    inverse = np.linalg.inv(_force_matrix())
    for signals in made:
        if signals:
            zero = np.zeros(len(next(iter(signals.values()))))
            forces = np.stack([signals.get(c, zero) for c in xyz("force")])
            signals.update(zip(TRANSDUCERS, inverse @ forces, strict=True))
    return made


def _force_matrix() -> FloatArray:
    return np.asarray(forces.matrix(forces.TRANSDUCER_RADIUS, forces.PROBE_HEIGHT))
