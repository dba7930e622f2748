"""The nominal chain of the micro-robot, from tip set-point to probe position and force.

command -> due -> target_1..3 -> axis_1..3 (true) -> tip -> skin -> reaction; axis_load_1..3 is the tissue force on the
axes; it comes back as ``load_1..3``: from the chunk before in a running instrument (``LoopRunner``), by
iteration over the whole session offline (``closed_loop``). Measured: axis_position_1..3, transducer_force_a..c;
processed: probe_x|y|z, force_x|y|z.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from drivers.microrobot import forces
from drivers.microrobot.kinematics import GEOMETRY, Geometry, _derivatives, forward_into, inverse_into
from sim_devices.chain import Chain, FloatArray, Runner, Signals
from sim_devices.stages.axes import LOOP_RATE, AxisLoop
from sim_devices.stages.operators import Delay, Names, Noise, Pass, Wired, analog
from sim_devices.stages.sheet import Sheet
from sim_devices.stages.tissues import SheetTissue, sheet_tissue

PIECE = 2e-3
"""How long the tissue's load on the axes is held in a running instrument, s."""


def xyz(name: str) -> Names:
    """``name_x``, ``name_y``, ``name_z``."""
    return tuple(f"{name}_{k}" for k in "xyz")


def numbered(name: str) -> Names:
    """``name_1``, ``name_2``, ``name_3``."""
    return tuple(f"{name}_{k}" for k in "123")


AXES, LOAD, AXIS_LOAD = numbered("axis"), numbered("load"), numbered("axis_load")
TRANSDUCERS = tuple(f"transducer_force_{k}" for k in "abc")


@dataclass(frozen=True)
class Platform(Wired):
    """Forward kinematics of three signals into three, or inverse ones."""

    inverse: bool = False
    geometry: Geometry = GEOMETRY

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        a, b, c = (np.ascontiguousarray(signals[s]) for s in self.source)
        out = np.empty((3, len(time)))
        function = inverse_into if self.inverse else forward_into
        function(a, b, c, self.geometry.axis_radius, self.geometry.tip_height, out[0], out[1], out[2])
        signals.update(zip(self.target, out, strict=True))


@dataclass(frozen=True)
class AxisLoad(Wired):
    """The load by a force on the tip (first three sources) on the axes at their positions (last three): Jᵀ R."""

    geometry: Geometry = GEOMETRY

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        fx, fy, fz, a, b, c = (np.ascontiguousarray(signals[s]) for s in self.source)
        out = np.empty((3, len(time)))
        _axis_load(fx, fy, fz, a, b, c, self.geometry.axis_radius, self.geometry.tip_height, out)
        signals.update(zip(self.target, out, strict=True))


@njit(cache=True, error_model="numpy")
def _axis_load(
    fx: FloatArray,
    fy: FloatArray,
    fz: FloatArray,
    z1: FloatArray,
    z2: FloatArray,
    z3: FloatArray,
    rho: float,
    height: float,
    out: FloatArray,
) -> None:
    jac = np.empty((3, 3))
    for i in range(fx.size):
        _derivatives(z1[i], z2[i], z3[i], rho, height, jac)
        for k in range(3):
            out[k, i] = jac[0, k] * fx[i] + jac[1, k] * fy[i] + jac[2, k] * fz[i]


@dataclass(frozen=True)
class Linear(Wired):
    """Target = matrix · source, three by three; the matrix is row by row."""

    matrix: tuple[float, ...]

    def fresh(self) -> Any:
        return np.array(self.matrix).reshape(3, 3)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        values = np.stack([signals[s] for s in self.source])
        signals.update(zip(self.target, np.ascontiguousarray(state @ values), strict=True))


def nominal_robot(
    *,
    tissue: str | SheetTissue = "forearm",
    latency: float = 0.0,
    rate: float = LOOP_RATE,
    marks: tuple[float, ...] = (),
    geometry: Geometry = GEOMETRY,
    w: float = forces.TRANSDUCER_RADIUS,
    h: float = forces.PROBE_HEIGHT,
) -> Chain:
    """The chain of an ideal robot.

    ``rate`` (1/s) is the axes' loop, ``marks`` (s) tell when recordings start, ``w`` and ``h`` (m) are the force
    matrix's.
    """
    skin = sheet_tissue(tissue) if isinstance(tissue, str) else tissue
    matrix = forces.matrix(w, h)
    inverse = tuple(np.linalg.inv(matrix).ravel().tolist())
    return Chain(
        "microrobot",
        (
            Delay("latency", "timing", xyz("command"), xyz("due"), delay=latency, marks=marks),
            Platform("inverse_kinematics", "command", xyz("due"), numbered("target"), inverse=True, geometry=geometry),
            AxisLoop("axes", "actuator", numbered("target") + numbered("load"), numbered("axis"), rate=rate),
            Platform("platform", "actuator", numbered("axis"), xyz("tip"), geometry=geometry),
            Pass("glue", "interface", xyz("tip"), xyz("skin")),
            Sheet("tissue", "tissue", xyz("skin"), xyz("reaction"), skin),
            AxisLoad("load", "interface", xyz("reaction") + numbered("axis"), numbered("axis_load"), geometry=geometry),
            Pass("position_sensors", "sensor", numbered("axis"), analog(*numbered("axis_position"))),
            Noise("position_noise", "sensor", analog(*numbered("axis_position")), numbered("axis_position")),
            Linear("transducers", "sensor", xyz("reaction"), analog(*TRANSDUCERS), inverse),
            Noise("transducer_noise", "sensor", analog(*TRANSDUCERS), TRANSDUCERS),
            Platform("probe_position", "processing", numbered("axis_position"), xyz("probe"), geometry=geometry),
            Linear("force_matrix", "processing", TRANSDUCERS, xyz("force"), tuple(matrix.ravel())),
        ),
    )


class LoopRunner:
    """The robot's chain advanced as a running instrument: the tissue's load reaches the axes one ``PIECE`` later.

    The part ahead of the axes and behind the load runs once a chunk; only the loop itself goes piece by piece.
    """

    def __init__(self, chain: Chain) -> None:
        parts, self._spring = _around_the_loop(chain)
        self.chain = chain
        self._parts = [Runner(part) for part in parts]
        self._inner = {s for op in parts[1].operators for s in op.reads}
        self._load = np.zeros(3)

    def advance(self, time: FloatArray, signals: Mapping[str, FloatArray]) -> Signals:
        """Signals on the next chunk ``time`` (n,) s."""
        out = self._parts[0].advance(time, signals)
        inputs = {name: out[name] for name in self._inner if name in out}
        cuts = np.searchsorted(time, np.arange(time[0] + PIECE, time[-1] + PIECE / 2, PIECE) - 1e-9)
        start = 0
        for end in [*(c for c in np.unique(cuts) if 0 < c < len(time)), len(time)]:
            piece = {name: values[start:end] for name, values in inputs.items()}
            piece.update(zip(LOAD, np.repeat(self._load[:, None], end - start, axis=1), strict=True))
            done = self._parts[1].advance(time[start:end], piece)
            for name, values in done.items():
                if name not in inputs:
                    if start == 0:
                        out[name] = np.empty(len(time))
                    out[name][start:end] = values
            self._load = np.array(
                [done[f][-1] + self._spring * done[x][-1] for f, x in zip(AXIS_LOAD, AXES, strict=True)]
            )
            start = end
        return self._parts[2].advance(time, out)


def _around_the_loop(chain: Chain) -> tuple[tuple[Chain, Chain, Chain], float]:
    """The chain ahead of the axes, from there to the load, and behind it, and the spring that the axes were given.

    Effects sit next to their anchors. The spring (N/m) is about the tissue's greatest stiffness as an axis meets it (a
    third of that at the tip, and stiffening): the axes feel it at once, so that only the rest of the load is late or
    iterated, and the loop is stable also where the axes themselves yield. Too much of it costs passes, too little
    stability.
    """
    tissue = chain["tissue"]
    spring = 0.5 * max(tissue.tissue.stiffness) if isinstance(tissue, Sheet) else 0.0
    operators = chain.tuned("axes", spring=spring).operators
    names = [op.name for op in operators]
    first, last = names.index("axes"), names.index("load") + 1
    ahead, loop, behind = operators[:first], operators[first:last], operators[last:]
    parts = Chain(chain.instrument, ahead), Chain(chain.instrument, loop), Chain(chain.instrument, behind)
    return parts, spring


def closed_loop(
    chain: Chain, time: FloatArray, signals: Mapping[str, FloatArray], *, tolerance: float = 1e-4, iterations: int = 20
) -> Signals:
    """A whole session with the tissue's load on the axes found by iteration, to ``tolerance`` N.

    The loop is stiff against the tissue, so that a few passes do; where it is not (coils at their limit), the session
    runs piece by piece instead, which takes longer. Where the axes or their load are given, one pass does.
    """
    if signals.keys() & {*LOAD, *AXES}:
        return chain.run(time, signals)
    (ahead, loop, behind), spring = _around_the_loop(chain)
    inputs = ahead.run(time, signals)
    load, push = np.zeros((3, len(time))), np.zeros((3, len(time)))
    change = np.inf
    for _ in range(iterations):
        out = loop.run(time, {**inputs, **dict(zip(LOAD, push, strict=True))})
        new = np.stack([out[name] for name in AXIS_LOAD])
        before, change = change, float(np.abs(new - load).max(initial=0.0))
        if change <= tolerance:
            return behind.run(time, out)
        if not change < before:
            break
        load, push = new, new + spring * np.stack([out[name] for name in AXES])
    return LoopRunner(chain).advance(time, signals)
