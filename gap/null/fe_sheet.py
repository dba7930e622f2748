"""Skin under the micro-robot's probe by finite elements, as a tissue of the diagnosis.

The elastic force on the probe depends on its position alone, and the sheet's laws mirror in x, y and z: a potential in
the even powers of the displacement, fitted to solves along rays that cover what the session reached, holds it. The
exact sensitivities of these solves give the potential's slopes by the parameters. Relaxation follows as the model's
own convolution. Softening by the first loading, which no quasi-linear law has, stays that of the reduced sheet.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from gap.inference.evidence import Fit
from gap.null.chains import needed, run
from gap.null.fe_law import relaxing_shares
from gap.null.fe_solver import Experiment, FeModel, fe_model
from gap.null.fe_tissue import Anchored
from gap.null.groups import Group, GroupedSession
from gap.null.robot_axes import AxesBlock
from gap.null.robot_force import ForceBlock
from gap.null.robot_specimens import specimen_chain
from gap.null.sheet_law import Law
from sim_devices.chain import Chain, Effect, FloatArray, Signals
from sim_devices.effects.tissue import Softening
from sim_devices.stages.kernels import evaluate, exposure_gain, prony
from sim_devices.stages.operators import Wired, after
from sim_devices.stages.robot import xyz
from sim_devices.stages.sheet import NO_GLUE, Glue

DEGREE = 4
"""Of the potential, in the squares of the displacement."""
POWERS = np.array(
    [
        (i, j, k)
        for i in range(DEGREE + 1)
        for j in range(DEGREE + 1)
        for k in range(DEGREE + 1)
        if 0 < i + j + k <= DEGREE
    ]
)
RAYS = [(a, 0.0) for a in (0.0, 22.5, 45.0, 67.5, 90.0)] + [(a, 45.0) for a in (0.0, 45.0, 90.0)] + [(0.0, 90.0)]
"""Azimuth and elevation of the rays, degrees."""
RAY_POINTS = 9
BEYOND = 1.1
"""How far the rays go, over the greatest displacement."""
FREE = ("mu1", "mu2", "alpha2", "sx", "sy", "bulk")
"""Parameters of the model that `sheet_law` sets from the elastic part of a nuisance vector."""
MODE = "initial"
"""How the pre-stress acts: as on an arm (paper M)."""
SHARES, TIMES = (0.3, 0.3), (0.4, 6.0)
"""Relaxing moduli over the one that stays, and their times (s), to begin from (assumed)."""
ELASTIC = 5
"""How many nuisance parameters `sheet_law` takes."""
FARTHEST = 1.5
"""How far the logs of the sheet's shape may leave their start: beyond it another law is wanted, not other numbers."""


def sheet_law(x: FloatArray, start: Mapping[str, float]) -> dict[str, float]:
    """Elastic parameters of Ogden's sheet at ``x`` (5,): logs of scale, mu2/mu1, alpha2, sx/mu1 and sy/mu1 over
    ``start``.

    Every stress is in proportion to the scale.
    """
    scale, mu2, alpha2, sx, sy = np.exp(_within(x))
    out = {s: start[s] * scale for s in ("mu1", "mu2", "bulk", "sx", "sy")}
    out["mu2"] *= mu2
    out["sx"] *= sx
    out["sy"] *= sy
    return {k: float(v) for k, v in out.items()} | {"alpha2": float(np.clip(start["alpha2"] * alpha2, 5.0, 100.0))}


def _within(x: FloatArray) -> FloatArray:
    """The elastic point ``x`` (5,) where the model is trusted: the scale freely, the shape about its start."""
    far = np.array([3.0, *[FARTHEST] * (ELASTIC - 1)])
    return np.clip(x[:ELASTIC], -far, far)


def gradients(displacement: FloatArray) -> FloatArray:
    """Minus the gradient of every monomial of the potential at ``displacement`` (3, n), (3, n, m)."""
    squares = [np.stack([c ** (2 * p) for p in range(DEGREE + 1)]) for c in displacement]
    out = np.empty((3, displacement.shape[1], len(POWERS)))
    for axis in range(3):
        own = POWERS[:, axis]
        part = 2.0 * own[:, None] * displacement[axis] ** np.maximum(2 * own[:, None] - 1, 0)
        for other in {0, 1, 2} - {axis}:
            part = part * squares[other][POWERS[:, other]]
        out[axis] = -part.T
    return out


@dataclass(frozen=True)
class PotentialSheet(Wired):
    """Displacement x, y, z (m) -> force on the probe (N): potential of ``coefficients`` (m,) in displacements over
    ``reach`` m, its axes turned by ``angle`` about z, then ``memory`` as of ``kernels.prony``, through ``glue``.
    """

    coefficients: FloatArray
    reach: float
    angle: float
    memory: tuple[float, ...]
    glue: Glue = NO_GLUE

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        probe = np.stack([signals[s] for s in self.source])
        force, stiffness = self._force(time, probe)
        if any(self.glue[:2]):
            yields = np.array([self.glue.plane, self.glue.plane, self.glue.normal])[:, None]
            skin = probe
            for _ in range(30):
                rest = probe + self.glue.gives(time, force) - skin
                if float(np.max(np.abs(rest), initial=0.0)) < 1e-9:
                    break
                skin = skin + rest / (1.0 + yields * stiffness)
                force, stiffness = self._force(time, skin)
        signals.update(zip(self.target, force, strict=True))

    def _force(self, time: FloatArray, skin: FloatArray) -> tuple[FloatArray, float]:
        """Force (3, n) and a stiffness, N/m, that is at least the sheet's in any direction at any time."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        elastic = gradients(turn @ skin / self.reach) @ self.coefficients
        size = np.linalg.norm(skin, axis=0)
        far = size > 0.2 * float(size.max(initial=0.0))
        secant = np.linalg.norm(elastic[:, far], axis=0) / np.maximum(size[far], 1e-9)
        force = np.stack([evaluate(prony, time, f, *self.memory) for f in turn.T @ elastic])
        return force, 3.0 * float(secant.max(initial=0.0))


@dataclass(frozen=True)
class SheetAnchor:
    """Coefficients (m,) of the potential at the elastic point ``x`` (5,), and their slopes (m, 5)."""

    x: FloatArray
    coefficients: FloatArray
    slopes: FloatArray


class FeForceBlock(Anchored, ForceBlock):
    """Recorded axis positions -> transducer forces with a finite-element sheet.

    Nuisance: the parameters of `sheet_law`, an angle and two relaxations in place of the reduced ones; all else as in
    `ForceBlock`.
    """

    TISSUE: tuple[str, ...] = ("scale", "fibre", "locking", "stress_x", "stress_y", "angle",
              "relax1", "relax2", "time1", "time2", "softening")  # fmt: skip
    LAWS = (Law((1.0, 1.0, 0.2, 0.5, 0.5, 1.5, 0.7, 0.7, 0.7, 0.7, 0.04), ((0.0,) * 11,)),)
    anchored_by = ELASTIC

    def __init__(self, session: GroupedSession, library: Mapping[str, Effect], axes: AxesBlock, model: FeModel) -> None:
        missing = [s for s in (*FREE, "gbar", "gbar2") if s not in model.symbols]
        if model.problem != "sheet" or missing:
            raise ValueError(
                f"finite-element model {model.name!r} cannot stand for skin under the robot here: the diagnosis takes "
                "sheets of Ogden's law (sheet_ogden)"
            )
        self.model = model
        self._start_law = {s: model.defaults[s] for s in FREE}
        super().__init__(session, library, axes)
        self._reach = BEYOND * self._farthest()
        self._anchor = self._anchored(np.zeros(ELASTIC))
        self._settle()

    def _trusted(self, x: FloatArray) -> FloatArray:
        return _within(x)

    def _farthest(self) -> float:
        """The greatest displacement of the skin in the session, m."""
        far = 0.0
        for (g, _), (grid, axes) in zip(self.groups, self._grids_of, strict=True):
            made = run(needed(specimen_chain(g, self._tissue), xyz("skin"), axes), grid, axes)
            far = max(far, float(np.max(np.linalg.norm([made[s] for s in xyz("skin")], axis=0))))
        return far

    def _anchored(self, x: FloatArray) -> SheetAnchor:
        """The potential by one solve along all rays. Raises ValueError where the model cannot be solved."""
        angles = np.radians(RAYS)
        ways = np.stack(
            [
                np.cos(angles[:, 1]) * np.cos(angles[:, 0]),
                np.cos(angles[:, 1]) * np.sin(angles[:, 0]),
                np.sin(angles[:, 1]),
            ]
        )
        steps = self._reach * np.arange(1, RAY_POINTS + 1) / RAY_POINTS
        path = (ways[:, :, None] * steps).reshape(3, -1)
        path = np.where(np.abs(path) < 1e-12, 0.0, path)
        time = np.arange(path.shape[1], dtype=float)
        drive = dict(zip(xyz("probe"), path, strict=True))
        law = sheet_law(x, self._start_law)
        at_once = {"gbar": 0.0, "gbar2": 0.0}
        geometry = {"prestress_mode": MODE}
        force, by_law = self.model.simulate(Experiment("microrobot", time, drive, geometry), law | at_once, FREE)
        basis = gradients(path / self._reach)
        weight = 1.0 / np.tile(steps / self._reach, len(RAYS))
        solved = np.linalg.pinv((basis * weight[:, None]).reshape(-1, len(POWERS)), rcond=1e-10)
        by_x = np.empty((len(FREE), ELASTIC))
        for k in range(ELASTIC):
            up, down = x.copy(), x.copy()
            up[k] += 1e-6
            down[k] -= 1e-6
            high, low = sheet_law(up, self._start_law), sheet_law(down, self._start_law)
            by_x[:, k] = [(high[s] - low[s]) / 2e-6 for s in FREE]
        slopes = (by_law @ by_x * weight[:, None]).reshape(-1, ELASTIC)
        return SheetAnchor(x.copy(), solved @ (force * weight).ravel(), solved @ slopes)

    def _law_chain(self, group: Group, nuisance: FloatArray) -> Chain:
        chain = specimen_chain(group, self._tissue)
        if not group.skin or self._anchor is None:
            return chain
        c = dict(zip(self.TISSUE, nuisance, strict=False))
        change = _within(nuisance) - self._anchor.x
        # In proportion to the scale exactly; to first order in the rest.
        shape = self._anchor.coefficients + self._anchor.slopes[:, 1:] @ change[1:]
        shares = relaxing_shares(np.array(SHARES), nuisance[6:8])
        times = np.array(TIMES) * np.exp(np.clip(nuisance[8:10], -4.0, 4.0))
        memory = (1.0, *(float(v) for pair in zip(-shares, times, strict=True) for v in pair))
        base = self._tissue
        sheet = PotentialSheet(
            "tissue", "tissue", xyz("skin"), xyz("reaction"),
            shape * float(np.exp(change[0])), self._reach, c["angle"], memory,
        )  # fmt: skip
        chain = replace(chain, operators=tuple(sheet if o.name == "tissue" else o for o in chain.operators))
        soft = (-(base.softening + c["softening"]), base.softening_force, *base.softening_law)
        return after(chain, "tissue", lambda s, t: Softening("softening", "tissue", s, t, exposure_gain, soft))

    def surrogate_error(self, fitted: Fit) -> float:
        """rms of surrogate less a full solve in units of the noise, at a fit's parameters and under its effects.

        Along the rays, where the skin is in the session: forces of the potential against solved ones.
        """
        x = _within(fitted.nuisance)
        solved = self._anchored(x)
        change = x - self._anchor.x
        shape = self._anchor.coefficients + self._anchor.slopes[:, 1:] @ change[1:]
        differing = shape * float(np.exp(change[0])) - solved.coefficients
        errors = []
        for (g, _), (grid, axes) in zip(self.groups, self._grids_of, strict=True):
            if not g.skin:
                continue
            chain = self.with_effects(self._law_chain(g, fitted.nuisance), fitted.active, g)
            made = run(needed(chain, xyz("skin"), axes), grid, axes)
            skin = np.stack([made[s] for s in xyz("skin")])
            errors.append(gradients(skin / self._reach) @ differing)
        return float(np.sqrt(np.mean(np.square(np.concatenate(errors, axis=1))) / np.mean(np.square(self.sigma))))


def fe_force(name: str) -> Callable[[GroupedSession, Mapping[str, Effect], AxesBlock], FeForceBlock]:
    """Makes the block with the sheet of the named model. Raises ValueError where there is none such."""
    return partial(FeForceBlock, model=fe_model(name))
