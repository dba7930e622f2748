"""Effects of software: the right samples, wrongly turned into numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_devices.chain import Chain, FloatArray, Parameter, Signals
from sim_devices.effects.build import (
    ROBOT,
    SUCTION,
    Values,
    choice,
    chosen,
    effect,
    map_after,
    on_recorded,
    shape,
    signed,
    strength,
)
from sim_devices.stages import laws
from sim_devices.stages.operators import Map, Wired, after, before
from sim_devices.stages.robot import TRANSDUCERS, numbered, xyz
from sim_devices.stages.suction import ZERO_STATE, zeroed


@dataclass(frozen=True)
class Retare(Wired):
    """Each channel less ``share`` of its own reading ``delay`` s after every one of ``marks`` (s)."""

    share: float
    delay: float
    marks: tuple[float, ...]

    def fresh(self) -> Any:
        return np.zeros((len(self.source), ZERO_STATE)), np.array([*sorted(self.marks), np.inf])

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        started = np.full(len(time), -2.0)  # always "sucking": the zero is due at once, then late by the delay
        for row, source, target in zip(state[0], self.source, self.target, strict=True):
            u, out = np.ascontiguousarray(signals[source]), np.empty(len(time))
            zeroed(row, time, u, started, state[1], self.delay, 0.0, False, False, out)
            signals[target] = u + self.share * (out - u)


def _zeroing(chain: Chain, v: Values) -> Chain:
    form = chosen(v, "form")
    if form == 1:
        return chain.tuned("zeroing", anew=v["rest"])
    return chain.tuned("zeroing", delay=v["delay"], averaged=form == 2)


TAKEN = (0, 1, 2)
"""Forms of a wrong zero of force that is read within the session."""


def _tare(chain: Chain, v: Values) -> Chain:
    op: Any = chain["latency"]
    form = chosen(v, "form")
    marks = op.marks if form == 1 else ()
    anchor, names = "transducers", TRANSDUCERS
    if form >= 2:
        k = chosen(v, "computed")
        anchor, names = "force_matrix", xyz("force")[k : k + 1]
    if form == 3:
        return map_after(chain, anchor, "wrong_zeroing", "processing", laws.offset, (v["zero"],), *names)
    return after(
        chain,
        anchor,
        lambda s, t: Retare("wrong_zeroing", "processing", s, t, v["share"], v["delay"], marks),
        *names,
    )


def _sign(chain: Chain, v: Values) -> Chain:
    op: Any = chain["force_matrix"]
    matrix = np.array(op.matrix).reshape(3, 3)
    which = chosen(v, "element")
    wrong = np.unravel_index(which, (3, 3)) if which < 9 else (which - 9,) if which < 12 else (slice(None), which - 12)
    matrix[wrong] *= 1.0 - 2.0 * v["share"]
    return chain.tuned("force_matrix", matrix=tuple(matrix.ravel().tolist()))


_PAIRS = ((0, 1), (1, 2), (0, 2))
_SWAPPED = (
    ("transducers", TRANSDUCERS),
    ("position_sensors", numbered("axis_position")),
    ("force_matrix", xyz("force")),
    ("probe_position", xyz("probe")),
)
"""Behind which operator channels may be exchanged,"""
_MIXED_UP = (("force_matrix", TRANSDUCERS), ("probe_position", numbered("axis_position")))
"""and ahead of which: recorded rightly, and mixed up where others are computed from them."""


def exchanged(time: FloatArray, a: FloatArray, b: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
    """Two channels of which ``share`` goes to the other."""
    return (1.0 - share) * a + share * b, (1.0 - share) * b + share * a


def _swap(chain: Chain, v: Values) -> Chain:
    which, number = divmod(chosen(v, "pair"), len(_PAIRS))
    anchor, names = (*_SWAPPED, *_MIXED_UP)[which]
    i, j = _PAIRS[number]

    def make(source: tuple[str, ...], target: tuple[str, ...]) -> Wired:
        return Map("axis_swap", "processing", source, target, exchanged, (v["share"],))

    return (after if which < len(_SWAPPED) else before)(chain, anchor, make, names[i], names[j])


def one_gain(time: FloatArray, u: FloatArray, error: float, within: float, *marks: float) -> FloatArray:
    """u (1 + error) in the recording that runs at ``within`` s, from one of ``marks`` to the next."""
    edges = np.array([-np.inf, *sorted(marks), np.inf])
    k = min(int(np.searchsorted(edges, within, side="right")), len(edges) - 1)
    return np.where((time >= edges[k - 1]) & (time < edges[k]), u * (1.0 + error), u)


_COMPUTED: Mapping[str, tuple[str, tuple[str, ...]]] = {
    **{n.replace("_", " "): ("force_matrix", (n,)) for n in xyz("force")},
    **{n.replace("_", " "): ("probe_position", (n,)) for n in xyz("probe")},
    "force, all three": ("force_matrix", xyz("force")),
    "probe, all three": ("probe_position", xyz("probe")),
}
"""Channels that are computed from others, and the operator that does."""


def _unit(chain: Chain, v: Values) -> Chain:
    first = chosen(v, "channel") == 0
    op: Any = chain["latency"]
    error = v["factor"] - 1.0
    law: tuple[Any, tuple[float, ...]] = (laws.gain, (error,))
    if chosen(v, "form") == 1:
        law = (one_gain, (error, v["within"], *op.marks))
    if chain.instrument == "microrobot":
        if chosen(v, "form") == 2:
            anchor, names = tuple(_COMPUTED.values())[chosen(v, "computed")]
            return map_after(chain, anchor, "wrong_unit", "processing", *law, *names)
        anchor = "transducers" if first else "position_sensors"
        return map_after(chain, anchor, "wrong_unit", "processing", *law)
    signal = "pressure" if first else "apex_height"
    return on_recorded(chain, signal, lambda s, t: Map("wrong_unit", "processing", s, t, *law))


def _wrong_unit(instruments: tuple[str, ...], further: tuple[str, ...] = (), *parameters: Parameter) -> Any:
    return effect(
        "wrong_unit", "processing", instruments,
        "A channel is converted with the wrong unit.",
        "Check one known value of each channel.",
        "mmHg for mbar 1.333, gf for cN 0.981, inch for cm 2.54",
        (
            strength("factor", "1", 0.1, 10.0, 1.333, "stored against true", null=1.0),
            choice("channel", 0, "pressure, or force", "height, or position", only=(0, 1)),
            choice("form", 0, "throughout", "in one recording", *further),
            shape("within", "s", 0.0, 5000.0, 0.0, "a moment of that recording", only=(1,)),
            *parameters,
        ),
        _unit,
    )  # fmt: skip


EFFECTS = (
    effect(
        "matrix_sign", "processing", ROBOT,
        "A sign of the force matrix is wrong.",
        "Push the probe by hand in x, y and z and look at the signs.",
        "the paper labels the forces X, Y, Z in the equation and A, B, C in the text",
        (
            strength("share", "1", 0.01, 1.0, 1.0, "1: the sign is turned"),
            choice("element", 0, "Rx of a", "Rx of b", "Rx of c", "Ry of a", "Ry of b", "Ry of c", "Rz of a", "Rz of b",
                   "Rz of c", "all of Rx", "all of Ry", "all of Rz", "all of a", "all of b", "all of c"),
        ),
        _sign,
    ),
    effect(
        "axis_swap", "processing", ROBOT,
        "Two channels are exchanged.",
        "Load one transducer, move one axis, and see which channel answers.",
        "cabling; gap.md",
        (
            strength("share", "1", 0.01, 1.0, 1.0, "1: wholly exchanged"),
            choice("pair", 0, "transducers a, b", "b, c", "a, c", "position sensors 1, 2", "2, 3", "1, 3",
                   "forces x, y", "y, z", "x, z", "tip x, y", "y, z", "x, z",
                   "transducers a, b ahead of the matrix", "b, c", "a, c",
                   "positions 1, 2 ahead of the tip", "2, 3", "1, 3"),
        ),
        _swap,
    ),
    effect(
        "wrong_zeroing", "processing", SUCTION,
        "Zero of the height taken late, or again at each suction within a recording.",
        "Keep the raw height and subtract the zero afterwards.",
        "the Cutometer resets to 0 when suction starts (paper)",
        (
            strength("delay", "s", 5e-3, 10.0, 0.3, "after the start of suction", only=(0, 2)),
            strength("rest", "s", 0.05, 30.0, 3.0, "that is needed before it", only=(1,)),
            choice("form", 0, "late", "at every suction after a rest", "a mean that takes so long"),
        ),
        _zeroing,
    ),
    effect(
        "wrong_zeroing", "processing", ROBOT,
        "Force zeroed while the skin is loaded, or on another day.",
        "Tare in free air, before contact.",
        "gap.md",
        (
            strength("share", "1", 0.01, 1.0, 1.0, "of the force at that moment that is taken for zero", only=TAKEN),
            shape("delay", "s", 0.01, 60.0, 2.0, "after the start", log=True, only=TAKEN),
            choice("form", 0, "once in the session", "at each recording anew", "once, of one computed force",
                   "before the session, of one computed force"),
            choice("computed", 0, "force x", "force y", "force z", only=(2, 3)),
            signed("zero", "N", 0.25, 0.01, "that one force has in all recordings", only=(3,)),
        ),
        _tare,
    ),
    _wrong_unit(SUCTION),
    _wrong_unit(
        ROBOT, ("computed channels",), choice("computed", 0, *_COMPUTED, only=(2,)),
    ),
)  # fmt: skip
