"""How detectable an effect is, and the strength that makes it so detectable.

delta = |Sigma^-1/2 (recorded with the effect - recorded without)|, Sigma white with the instrument's noise. The part
that tissue parameters, the scatter of repeats and the tolerances of a sound instrument can imitate is removed by
linear least squares (finite differences at the true values).
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from . import robot, robot_kinematics, robot_tissue, suction, tissue
from .forms import Form
from .session import Session
from .signals import Array

SCATTER = {"hold": 0.02, "cycles": 0.02, "ramp": 0.04, "slow": 0.03, "quick": 0.03}
"""Relative sd of the skin's compliance between recordings, by waveform (repeats within 4-10 %, reported)."""
TOLERANCES: dict[str, dict[str, float]] = {
    "suction": {
        "latency_tolerance": 1e-3,  # s, of a command
        "height_tolerance": 1e-3,  # s, height behind pressure
        "regulator_tolerance": 0.02,  # relative, of the regulator's speed
        "damping_tolerance": 0.03,  # of its damping ratio
        "skew_tolerance": 2e-5,  # of the recording's clock
        "gain_tolerance": 1e-3,  # relative, of the gauge
        "zero_tolerance": 10.0,  # Pa, of the gauge
    },
    "microrobot": {
        "latency_tolerance": 1e-3,
        "skew_tolerance": 2e-5,
        "servo_tolerance": 0.02,  # relative, of the loops' gains
        "leg_tolerance_0": 2e-3,  # relative, of each transducer
        "leg_tolerance_1": 2e-3,
        "leg_tolerance_2": 2e-3,
    },
}
"""What a sound instrument may be off by (sd): every case draws its own, and delta allows for it."""
FAINTEST = 1e-7  # of the strongest: where the search for a strength begins
_ROBOT_STRIDE = 4  # rows of the robot's recordings that are skipped: delta grows back by the root of it


def tolerances_of(instrument: str) -> dict[str, float]:
    """Tolerances (sd) of an instrument, by knob."""
    return TOLERANCES.get(instrument, TOLERANCES["suction"])


def scatter_of(session: Session) -> Array:
    """Sd of the compliance of each recording (R,), relative."""
    return np.array([SCATTER[r.condition.split()[0]] for r in session.recordings])


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
        """Norm of what a best fit (prior included) leaves of a whitened residual r (N,); inf if r is not finite."""
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
        fx = dict(self.tolerance)
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
    def _views(self) -> tuple[dict[str, float], ...]:
        """Sets of channels with independent noise, and its sd: an effect counts by the set that shows it best."""
        if self.session.instrument != "microrobot":
            p, h = suction.PA_NOISE[self.session.instrument], suction.H_NOISE[self.session.instrument]
            step = suction.H_STEP[self.session.instrument]
            return (
                {
                    "pressure": np.hypot(p, suction.PA_STEP[self.session.instrument] / 12**0.5),
                    "apex_height": np.hypot(h, step / 12**0.5),
                },
            )
        axes, legs = dict.fromkeys(robot.AXES, robot.AXIS_NOISE), dict.fromkeys(robot.LEGS, robot.LEG_NOISE)
        force_sd = np.linalg.norm(robot_kinematics.force_matrix(), axis=1) * robot.LEG_NOISE
        probe_sd = np.linalg.norm(robot_kinematics.jacobian_at_centre(), axis=1) * robot.AXIS_NOISE
        force = dict(zip(robot.FORCE, force_sd, strict=True))
        probe = dict(zip(robot.PROBE, probe_sd, strict=True))
        return (axes | legs, axes | force, probe | legs)

    def _whitened(self, channels: suction.Channels, view: Mapping[str, float]) -> Array:
        stride = _ROBOT_STRIDE if self.session.instrument == "microrobot" else 1
        return np.concatenate([x[::stride] / sd for name, sd in view.items() for x in channels[name]]) * stride**0.5

    @cached_property
    def _nuisances(self) -> tuple[_Nuisance, ...]:
        """For each view what tissue parameters, scatter, zeros and tolerances can imitate."""
        free = (robot_tissue if self.session.instrument == "microrobot" else tissue).free_parameters(self.law)
        varied = []
        for name in free:
            step = 1e-3 * max(abs(self.tissue[name]), 0.05)
            varied.append((step, self.record({}, skin={name: self.tissue[name] + step})))
        n = len(self.session.recordings)
        off = [self.record({name: sd}) for name, sd in tolerances_of(self.session.instrument).items()]
        found = []
        for view in self._views:
            nominal = self._whitened(self._nominal, view)
            columns = [(self._whitened(v, view) - nominal) / step for step, v in varied]
            columns = [c / max(float(np.linalg.norm(c)), 1e-30) for c in columns]
            columns += [self._whitened(o, view) - nominal for o in off]
            answer = [c for c in view if c.startswith(("apex", "transducer", "force"))]
            for k in range(n):
                columns.append(
                    scatter_of(self.session)[k] * self._whitened(self._only(k, answer, view, self._nominal), view)
                )
            if "apex_height" in view:
                flat = {c: [np.ones_like(x) for x in self._nominal[c]] for c in view}
                zero_sd = view["apex_height"]
                columns += [zero_sd * self._whitened(self._only(k, answer, view, flat), view) for k in range(n)]
            held = np.arange(len(columns)) >= len(free)
            found.append(_Nuisance(np.stack(columns, axis=1), held.astype(float)))
        return tuple(found)

    @staticmethod
    def _only(k: int, answer: list[str], view: Mapping[str, float], channels: suction.Channels) -> suction.Channels:
        """Channels that are zero but for the skin's answer in recording k."""
        return {c: [x * float(i == k and c in answer) for i, x in enumerate(channels[c])] for c in view}

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

        if form.steps:
            found = [(s, delta(s)) for s in form.steps]
            return min(found, key=lambda sd: abs(np.log(max(sd[1], 1e-9) / target)))
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
            if abs(np.log(max(value, 1e-9) / target)) < abs(np.log(best[1] / target)):
                best = (float(np.exp(at)), value)
            if abs(np.log(best[1] / target)) < 0.08:
                break
            low, high = (at, high) if value < target else (low, at)
        return best
