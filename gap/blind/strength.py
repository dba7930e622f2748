"""How detectable an effect is, and the strength that makes it so detectable.

delta = |Sigma^-1/2 (recorded with the effect - recorded without)|, Sigma white with the instrument's noise. The part
that tissue parameters, the scatter of repeats and the tolerances of a sound instrument can imitate is removed by
linear least squares (finite differences at the true values).
"""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg

from . import anyskin, robot, robot_kinematics, robot_tissue, suction, tissue
from .forms import Form
from .laboratory import Noise
from .session import Session
from .signals import Array

SCATTER = {"hold": 0.02, "cycles": 0.02, "ramp": 0.04, "slow": 0.03, "quick": 0.03}
"""Relative sd of the skin's compliance between recordings, by waveform (repeats within 4-10 %, reported)."""
FAINTEST = 1e-7  # of the strongest: where the search for a strength begins
_ROBOT_STRIDE = 4  # rows of the robot's recordings that are skipped: delta grows back by the root of it


def scatter_of(session: Session) -> Array:
    """Sd of the compliance of each recording (R,), relative."""
    return np.array([SCATTER[r.condition.split()[0]] for r in session.recordings])


def _answers(view: Mapping[str, Noise]) -> list[str]:
    """Channels of a set that show the skin's answer."""
    return [c for c in view if c.startswith(("apex", "transducer", "force"))]


@dataclass(frozen=True)
class _Nuisance:
    """Whitened sensitivities (N, K), each scaled to its prior sd where ``held`` (K,) is 1 and free where it is 0."""

    sensitivities: Array
    held: Array

    @cached_property
    def _gram(self) -> tuple[Array, bool]:
        j = self.sensitivities
        factor: tuple[Array, bool] = scipy.linalg.cho_factor(j.T @ j + np.diag(self.held + 1e-9))
        return factor

    def left_of(self, r: Array) -> float:
        """Norm of the rest of a best fit (prior included) to a whitened residual r (N,); inf if r is not finite."""
        if not np.all(np.isfinite(r)):
            return np.inf
        x = scipy.linalg.cho_solve(self._gram, self.sensitivities.T @ r)
        return float(np.hypot(np.linalg.norm(r - self.sensitivities @ x), np.linalg.norm(self.held * x)))


@dataclass(frozen=True)
class Subject:
    """One person under one instrument.

    The session, the skin's law and parameters, the scatter (R,) of the recordings' compliance, and where in its
    tolerances this instrument lies.
    """

    session: Session
    law: str
    tissue: Mapping[str, float]
    scatter: Array
    tolerance: Mapping[str, float]
    seed: int

    def record(
        self, knobs: Mapping[str, float], noisy: bool = False, skin: Mapping[str, float] | None = None
    ) -> suction.Channels:
        """The session's recorded channels, with effects' ``knobs`` on and parameters of the ``skin`` changed."""
        chain: types.ModuleType = robot if self.session.instrument == "microrobot" else suction
        fx = dict(self.session.lab.knobs)
        for name, value in self.tolerance.items():
            fx[name] = fx.get(name, 0.0) + value
        for name, value in knobs.items():
            fx[name] = fx.get(name, 0.0) + value
        channels: suction.Channels = chain.simulate(
            self.session, self.law, dict(self.tissue) | dict(skin or {}), fx, self.scatter, self.seed, noisy
        )
        return channels

    @cached_property
    def _nominal(self) -> suction.Channels:
        return self.record({})

    @cached_property
    def _views(self) -> tuple[dict[str, Noise], ...]:
        """Sets of channels with independent noise, and that noise: an effect counts by the set that shows it best."""
        lab = self.session.lab
        if self.session.instrument != "microrobot":
            return (dict(lab.noise),)
        axis, leg = lab.noise["axis"], lab.noise["leg"]

        def through(names: Sequence[str], matrix: Array, noise: Noise) -> dict[str, Noise]:
            """Noise of channels computed with a matrix (3, 3); the robot's resolutions hardly count."""
            return {n: replace(noise, rms=noise.rms * float(np.linalg.norm(row)), step=0.0)
                    for n, row in zip(names, matrix, strict=True)}  # fmt: skip

        axes, legs = through(robot.AXES, np.eye(3), axis), through(robot.LEGS, np.eye(3), leg)
        force = through(robot.FORCE, robot_kinematics.force_matrix(), leg)
        probe = through(robot.PROBE, robot_kinematics.jacobian_at_centre(), axis)
        return (axes | legs, axes | force, probe | legs)

    def _whitened(self, channels: suction.Channels, view: Mapping[str, Noise]) -> Array:
        stride = _ROBOT_STRIDE if self.session.instrument == "microrobot" else 1
        period = stride / self.session.rate
        parts = [n.whitened(x[::stride], period) for name, n in view.items() for x in channels[name]]
        whitened: Array = np.concatenate(parts) * stride**0.5
        return whitened

    @cached_property
    def _nuisances(self) -> tuple[_Nuisance, ...]:
        """For each view the traces that tissue parameters, scatter, zeros and tolerances can imitate."""
        free = (robot_tissue if self.session.instrument == "microrobot" else tissue).free_parameters(self.law)
        varied = []
        for name in free:
            step = 1e-3 * max(abs(self.tissue[name]), 0.05)
            varied.append((step, self.record({}, skin={name: self.tissue[name] + step})))
        n = len(self.session.recordings)
        off = [self.record({name: sd}) for name, sd in self.session.lab.tolerances.items()]
        found = []
        for view in self._views:
            nominal = self._whitened(self._nominal, view)
            columns = [(self._whitened(v, view) - nominal) / step for step, v in varied]
            columns = [c / max(float(np.linalg.norm(c)), 1e-30) for c in columns]
            columns += [self._whitened(o, view) - nominal for o in off]
            answer = _answers(view)
            for k in range(n):
                columns.append(
                    scatter_of(self.session)[k] * self._whitened(self._only(k, answer, view, self._nominal), view)
                )
            if "apex_height" in view:
                flat = {c: [np.ones_like(x) for x in self._nominal[c]] for c in view}
                zero_sd = view["apex_height"].rms
                columns += [zero_sd * self._whitened(self._only(k, answer, view, flat), view) for k in range(n)]
            held = np.arange(len(columns)) >= len(free)
            found.append(_Nuisance(np.stack(columns, axis=1), held.astype(float)))
        return tuple(found)

    @staticmethod
    def _only(k: int, answer: list[str], view: Mapping[str, Noise], channels: suction.Channels) -> suction.Channels:
        """Channels that are zero but for the skin's answer in recording k."""
        return {c: [x * float(i == k and c in answer) for i, x in enumerate(channels[c])] for c in view}

    @cached_property
    def _any_skin(self) -> tuple[_Nuisance, ...]:
        """The same for an observer who does not know the skin's law: see ``anyskin``."""
        known = self._nuisances
        found = []
        for view, n in zip(self._views, known, strict=True):
            flat = anyskin.responses(self.session, self._nominal, _answers(view))
            zeros = {c: [np.zeros_like(x) for x in xs] for c, xs in self._nominal.items()}
            columns = [self._whitened({**zeros, **extra}, view) for extra in flat]
            columns = [c / max(float(np.linalg.norm(c)), 1e-30) for c in columns]
            every = np.column_stack([n.sensitivities, *columns])
            found.append(_Nuisance(every, np.r_[n.held, np.zeros(len(columns))]))
        return tuple(found)

    def detectability_free(self, knobs: Mapping[str, float]) -> float:
        """delta_free of switching ``knobs`` on: the part that stands out though the skin's law is unknown."""
        a, b = self.record(knobs), self._nominal
        pairs = zip(self._views, self._any_skin, strict=True)
        stands_out = max(n.left_of(self._whitened(a, v) - self._whitened(b, v)) for v, n in pairs)
        return max(stands_out, self._miscomputed(a)) if self.session.instrument == "microrobot" else stands_out

    def _miscomputed(self, channels: suction.Channels) -> float:
        """Error of computed channels against the measured ones: arithmetic, known to a tenth of the noise."""
        view = {**self._views[1], **self._views[2]}
        axes, legs = (np.stack([np.concatenate(channels[n]) for n in names], axis=1)
                      for names in (robot.AXES, robot.LEGS))  # fmt: skip
        off = 0.0
        for names, right in (
            (robot.PROBE, robot_kinematics.tip(axes)),
            (robot.FORCE, legs @ robot_kinematics.force_matrix().T),
        ):
            for name, x in zip(names, right.T, strict=True):
                off += float(np.sum(np.square((np.concatenate(channels[name]) - x) / (0.1 * view[name].rms))))
        return float(np.sqrt(off))

    def _distance(self, a: suction.Channels, b: suction.Channels) -> float:
        pairs = zip(self._views, self._nuisances, strict=True)
        return max(n.left_of(self._whitened(a, v) - self._whitened(b, v)) for v, n in pairs)

    def detectability(self, knobs: Mapping[str, float], beside: Mapping[str, float] | None = None) -> float:
        """delta of switching ``knobs`` on, ``beside`` others that are on anyway."""
        others = dict(beside or {})
        base = self.record(others) if others else self._nominal
        return self._distance(self.record(others | dict(knobs)), base)

    def calibrate(self, form: Form, target: float, seed: int) -> tuple[float, float]:
        """Strength of ``form`` with delta near ``target``, and the delta it really has.

        A form that cannot reach the target returns its strongest, plausible strength. Log-log secant in a bracket.
        """
        instrument = self.session.instrument

        def delta(strength: float) -> float:
            return self.detectability(form.knobs(strength, instrument, seed))

        def off(reached: float) -> float:
            return abs(float(np.log(max(reached, 1e-9) / target)))

        if form.steps:
            found = [(s, delta(s)) for s in form.steps]
            return min(found, key=lambda sd: off(sd[1]))
        low, high = np.log(form.strong * FAINTEST), np.log(form.strong)
        best = (form.strong, delta(form.strong))
        if best[1] < target:
            return best
        at, value = high, best[1]
        for k in range(14):
            # Effects grow about in proportion to their strength; where that guess leaves the bracket, bisect it.
            guess = at + np.log(target / max(value, 1e-9))
            at = guess if low < guess < high and k < 5 else 0.5 * (low + high)
            value = delta(float(np.exp(at)))
            if off(value) < off(best[1]):
                best = (float(np.exp(at)), value)
            if off(best[1]) < 0.08:
                break
            low, high = (at, high) if value < target else (low, at)
        return best
