"""A fit while the measurement goes on: an emulator trained on the set-points beforehand, refined where the data lead.

The measured drive is not known beforehand, so the emulator is of the commanded one: samples at which the instrument
had not followed it are left out. A run that is over is fitted with its measured drive (`fit`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ..api import Array, Experiment, Instrument, Model
from ..emulator import Emulator, Region, Solve, train
from ..registry import models
from . import units
from .cases import DRIVES, INSTRUMENTS, MEASURED_AS, Case, given_by
from .features import relaxes_wholly, series
from .ranges import as_curve, box, region_of
from .spec import Spec, read_spec
from .stated import setup
from .statistics import AT_BOUND, POORLY, samples_as_one
from .target import full_solve

STEP, SAMPLES = 0.1, 600  # s between the times compared, or as many times as that
TRAINING = 56  # full solves beforehand
MOST = 160  # of them in all
WIDER = 8  # of them where the range is widened
UNIT = 0.01  # of a channel's largest value: the emulator's unit
FOLLOWED = 0.05  # of the largest drive, by which a measured one may differ from the commanded
RIGHT = 0.003  # of a channel's largest value: an emulator that is closer than that is not refined
COARSER: Mapping[str, Mapping[str, float]] = {"suction": {"mesh": 0.7}, "sheet": {"radial": 4, "around": 12}}
COMPARED = 2.0  # standard errors that the estimate may have gone since the emulator was compared with the model
LEAST = 20  # samples before anything is fitted
AGAIN = 3  # times that the noise is taken anew from the residuals
STEPS = 30  # of Levenberg and Marquardt's method, at most
LIVE: Mapping[str, tuple[str, ...]] = {
    # Weights at time constants a decade apart, which are held: a hold that has only begun tells no time constant.
    "suction_yeoh_qlv": ("G", "c20", "g1", "g2", "g3"),
}


@dataclass(frozen=True)
class Estimate:
    """What the data so far say, SI. ``values``, ``errors`` (m,); a parameter is ``known`` to better than half of its
    size. ``curves`` (n,) go to the end of the protocol over ``time`` (n,) s, ``data`` (n,) hold nan where nothing is
    compared. ``off`` is the emulator's error at the
    last full solve near the estimate, of each curve's largest value (nan: none yet); ``explained`` the share of the
    data's sum of squares (paper M); ``edge`` the parameters at the end of the range that is trained."""

    symbols: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]
    errors: tuple[float, ...]
    known: tuple[bool, ...]
    edge: tuple[str, ...]
    time: Array
    curves: Mapping[str, Array]
    data: Mapping[str, Array]
    samples: int
    explained: float
    off: float
    solves: int

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Each parameter's symbol, value and standard error with their unit, and a remark."""
        found = []
        for symbol, unit, value, error, known in zip(
            self.symbols, self.units, self.values, self.errors, self.known, strict=True
        ):
            remark = "at the range's end" if symbol in self.edge else "" if known else "not known yet"
            found.append((symbol, units.show(value, unit, 3), units.show(error, unit, 2), remark))
        return found


class LiveFit:
    """`train` it, then `take` data as they come and look at `update`; `refine` in between, about a third of a second.

    ``setpoints`` maps drives to commanded values over ``time`` (k,) s from the protocol's beginning, break points of
    straight pieces; ``protocol`` is its text, which tells the opening. Raises SpecError, ValueError.
    """

    def __init__(
        self,
        model: str | Model,
        instrument: Instrument,
        time: Array,
        setpoints: Mapping[str, Array],
        protocol: str = "",
        spec: Spec | Mapping[str, Any] | None = None,
    ) -> None:
        self.model = models()[model] if isinstance(model, str) else model
        info = self.model.info
        if instrument not in INSTRUMENTS[info.problem]:
            raise ValueError(f"model {info.name} is not one of a {instrument}")
        if not isinstance(spec, Spec):
            free = {"parameters": dict.fromkeys(LIVE[info.name], "free")} if info.name in LIVE else {}
            spec = read_spec({"model": info.name, **free, **(spec or {})}, info)
        self.variables = spec.variables(info)
        end = float(time[-1])
        self.time = np.linspace(0.0, end, min(SAMPLES, max(LEAST, round(end / STEP) + 1)))
        time, setpoints = as_curve(np.asarray(time, dtype=np.float64), setpoints)
        every = np.union1d(self.time, time)  # a rise that is faster than the times compared stays one
        self._shown = np.searchsorted(every, self.time)
        drive = {name: np.interp(every, time, setpoints[name]) for name in DRIVES[info.problem]}
        known = setup(SimpleNamespace(instrument=instrument, protocol=protocol), info, given_by(spec, info))
        geometry = {**COARSER.get(info.problem, {}), **known.geometry}
        experiment = Experiment(instrument, every, drive, geometry, "live")
        channels = info.channels
        each, weight = dict.fromkeys(channels, 0.0 * every), dict.fromkeys(channels, 0.0 * every + 1.0)
        self.case = Case("live", experiment, each, dict.fromkeys(channels, 1.0), weight, setup=known)
        self._sums = {name: np.zeros((2, self.time.size)) for name in (*map(measured, channels), *drive)}
        self._scale = np.ones(len(channels) * self.time.size)
        self._solves: list[Solve] = []
        self._emulator: Emulator | None = None
        self._region = region_of(self.variables)
        self._series = series(self.variables)
        self._waiting: list[Array] = []
        self._random = np.random.default_rng(spec.seed)
        self._z = self.variables.start
        self._covariance = np.diag(self._region.shape.diagonal() ** 2)
        self._off, self._compared = np.nan, self._z
        self._turn = 0

    @property
    def streams(self) -> tuple[str, ...]:
        """Names of the channels that it takes."""
        return tuple(self._sums)

    def train(self, told: Callable[[int, int], bool] | None = None, count: int = TRAINING) -> None:
        """Run the full model over the range of the parameters; ``told(done, of)`` may return False to give up.

        Raises ValueError where too few of the runs succeed.
        """
        points = self._scattered(self._region, count)
        raw = []
        for number, z in enumerate(points, start=1):
            raw.append((z, self._full(z)))
            if told is not None and not told(number, len(points)):
                return
        good = [(z, *found) for z, found in raw if found is not None]
        if len(good) < 2 * len(self._z):
            raise ValueError(f"the model could be run at {len(good)} of {len(points)} points only")
        largest = np.median(np.abs([curve for _, curve, _ in good]).reshape(len(good), -1, self.time.size), axis=0)
        self._scale = np.repeat(UNIT * largest.max(axis=1).clip(UNIT * largest.max()), self.time.size)
        self._solves = [self._solve(*one) for one in good]
        self._learn()

    def begin(self) -> None:
        """Forget the data: another run of the protocol begins."""
        for sums in self._sums.values():
            sums[:] = 0.0
        self._z, self._off, self._turn = self.variables.start, np.nan, 0

    def take(self, streams: Mapping[str, tuple[Array, Array]]) -> None:
        """Samples of channels and drives: time [s] from the protocol's beginning and value in SI, in any order."""
        step = float(self.time[1])
        for name, (time, value) in streams.items():
            if name in self._sums:
                at = np.rint(np.asarray(time) / step)
                good = np.isfinite(value) & (at >= 0) & (at < self.time.size)
                place = at[good].astype(int)
                np.add.at(self._sums[name][0], place, np.asarray(value)[good])
                np.add.at(self._sums[name][1], place, 1.0)

    def update(self) -> Estimate | None:
        """The fit to everything taken so far; None before there is enough."""
        if self._emulator is None:
            raise ValueError("a live fit is trained before it is asked")
        data, used = self._data()
        if used.sum() < LEAST:
            return None
        for _ in range(AGAIN):  # the noise is that of the residuals: of a poor start it is too large
            self._z, self._covariance = self._fitted(self._emulator, data, used)
        return self._estimate(self._emulator, data, used)

    def refine(self) -> bool:
        """One full solve where the data lead, and the emulator trained anew; False where nothing is left to refine."""
        if self._emulator is None or len(self._solves) >= MOST:
            return False
        data, used = self._data()
        if not self._waiting:
            if used.sum() < LEAST or self._settled():
                return False
            self._widen()
        self._turn += 1
        here = self._turn % 2 == 1 and used.sum() >= LEAST
        z = self._z if here else self._waiting.pop() if self._waiting else self._draw()
        found = self._full(z)
        if found is not None:
            new = self._solve(z, *found)
            if here:
                self._off, self._compared = self._error(new), z
            self._solves.append(new)
            self._learn(data, used)
        return found is not None or bool(self._waiting)

    # ------------------------------------------------------------------------------------------------------------------

    def _full(self, z: Array) -> tuple[Array, Array] | None:
        """Curves (channels * n,) at the times compared, and derivatives; None where the model could not be run."""
        found = full_solve(self.model, [self.case], self.variables, z)
        if found is None:
            return None
        every = self.case.experiment.time.size
        rows = np.concatenate([k * every + self._shown for k in range(len(self.case.data))])
        return found[0][rows], found[1][rows]

    def _solve(self, z: Array, curve: Array, slopes: Array) -> Solve:
        return Solve(z, curve / self._scale, slopes / self._scale[:, None])

    def _scattered(self, region: Region, count: int) -> list[Array]:
        """Points over a region's box, no Prony terms that take the whole stress among them."""
        sequence = stats.qmc.Sobol(region.centre.size, seed=int(self._random.integers(1 << 30)))
        points = region.lower + (region.upper - region.lower) * sequence.random(1 << (2 * count - 1).bit_length())
        return list(points[~relaxes_wholly(self._series, points)][:count])

    def _learn(self, data: Array | None = None, used: NDArray[np.bool_] | None = None) -> None:
        """Train on all full solves; those whose curves are far from the data count less."""
        weigh: Callable[[Array], Array] | None = None
        if data is not None and used is not None:
            power = used / _noise(data - self._current(), used) ** 2

            def weigh(curves: Array) -> Array:
                chi = (curves - data) ** 2 @ power
                return np.asarray(1.0 / np.sqrt(1.0 + (chi - chi.min()) / (2.0 * self._z.size)))

        self._emulator = train(self._solves, self._region, weigh)

    def _current(self) -> Array:
        assert self._emulator is not None
        return np.asarray(self._emulator.curves(self._z[None])[0])

    def _error(self, new: Solve) -> float:
        """Largest difference of the emulator from a full solve, of each channel's largest value."""
        assert self._emulator is not None
        guess = self._emulator.curves(new.z[None])[0].reshape(-1, self.time.size)
        right = new.curve.reshape(guess.shape)
        return float((np.abs(guess - right).max(axis=1) / np.abs(right).max(axis=1)).max())

    def _data(self) -> tuple[Array, NDArray[np.bool_]]:
        """Means about each time in the emulator's unit, and which of them count: (channels * n,)."""
        followed = np.ones(self.time.size, dtype=bool)
        for name, commanded in self.case.experiment.drive.items():
            total, count = self._sums[name]
            commanded = commanded[self._shown]
            off = np.abs(np.divide(total, count, out=commanded.copy(), where=count > 0.0) - commanded)
            followed &= off <= FOLLOWED * max(float(np.abs(commanded).max()), 1e-300)
        data, used = [], []
        for channel in self.case.data:
            total, count = self._sums[measured(channel)]
            data.append(np.divide(total, count, out=np.zeros(self.time.size), where=count > 0.0))
            used.append((count > 0.0) & followed)
        return np.concatenate(data) / self._scale, np.concatenate(used)

    def _fitted(self, emulator: Emulator, data: Array, used: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Levenberg and Marquardt's method on the emulator within its range: coordinates (m,), covariance (m, m).

        The range counts as a flat prior would, so that a parameter without effect yet stays in its
        middle. Noise is that of the residuals; a sample counts as one over the samples that count as one.
        """
        region = self._region
        modes, flat = emulator.modes[used], np.diag(12.0 / (region.upper - region.lower) ** 2)
        rest = (emulator.mean - data)[used]
        sd, z, damping = _noise(data - self._current(), used)[used], self._z, 1e-3

        def residual(z: Array) -> Array:
            return np.asarray((rest + modes @ emulator.coefficients(z[None])[0]) / sd)

        def objective(r: Array, z: Array) -> float:
            away = z - region.centre
            return float(r @ r + away @ flat @ away)

        r = residual(z)
        for _ in range(STEPS):
            jacobian = (modes @ emulator.slopes(z)) / sd[:, None]
            normal = jacobian.T @ jacobian + flat
            slope = jacobian.T @ r + flat @ (z - region.centre)
            blocked = ((z <= region.lower) & (slope > 0.0)) | ((z >= region.upper) & (slope < 0.0))
            free = np.flatnonzero(~blocked)
            step = np.zeros(z.size)
            own = normal[np.ix_(free, free)]
            step[free] = -np.linalg.solve(own + damping * np.diag(np.diag(own)), slope[free])
            there = np.clip(z + step, region.lower, region.upper)
            new = residual(there)
            if objective(new, there) < objective(r, z):
                z, r, damping = there, new, max(0.3 * damping, 1e-9)
                if abs(float(step @ slope)) < 1e-3:
                    break
            else:
                damping *= 10.0
                if damping > 1e8:
                    break
        jacobian = (modes @ emulator.slopes(z)) / sd[:, None]
        left = r * sd
        alike = samples_as_one(left)
        scale = float(r @ r) / max(r.size - z.size, 1) * alike
        return z, np.asarray(np.linalg.inv(jacobian.T @ jacobian / max(scale, 1e-12) + flat))

    def _estimate(self, emulator: Emulator, data: Array, used: NDArray[np.bool_]) -> Estimate:
        variables, region = self.variables, self._region
        values = variables.values(self._z)
        found = np.array([values[s] for s in variables.symbols])
        slope = np.array([f.slope(values[f.symbol]) for f in variables.free])
        deviation = np.sqrt(np.diag(self._covariance))
        errors = deviation * slope
        curve = emulator.curves(self._z[None])[0]
        left = (curve - data)[used]
        size = float(data[used] @ data[used])
        margin = AT_BOUND * (region.upper - region.lower)
        edge = (self._z <= region.lower + margin) | (self._z >= region.upper - margin)
        return Estimate(
            variables.symbols,
            tuple(variables.info[s].unit for s in variables.symbols),
            tuple(map(float, found)),
            tuple(map(float, errors)),
            tuple(bool(e <= POORLY * max(abs(v), 1e-300)) for e, v in zip(errors, found, strict=True)),
            tuple(s for s, at in zip(variables.symbols, edge, strict=True) if at),
            self.time,
            self._by_channel(curve),
            self._by_channel(np.where(used, data, np.nan)),
            int(used.sum()),
            1.0 - float(left @ left) / size if size > 0.0 else float("nan"),
            self._off if self._away(self._compared[None])[0] < COMPARED**2 else float("nan"),
            len(self._solves),
        )

    def _by_channel(self, values: Array) -> dict[str, Array]:
        return dict(zip(self.case.data, (values * self._scale).reshape(-1, self.time.size), strict=True))

    def _settled(self) -> bool:
        """Whether the emulator is right here, and a full solve as near as the estimate is uncertain."""
        return bool(self._off <= RIGHT and self._away(np.array([s.z for s in self._solves])).min() < 0.1)

    def _away(self, z: Array) -> Array:
        """Squared distances (b,) of points (b, m) from the estimate in its standard errors."""
        off = z - self._z
        return np.asarray(np.einsum("bi,ij,bj->b", off, np.linalg.inv(self._covariance), off))

    def _draw(self) -> Array:
        factor = np.linalg.cholesky(self._covariance)
        z = self._z + factor @ self._random.standard_normal(self._z.size)
        return np.clip(z, self._region.lower, self._region.upper)

    def _widen(self) -> None:
        """Widen the range by half where the estimate is at its end and the model allows more."""
        region = self._region
        lower, upper = region.lower.copy(), region.upper.copy()
        width, least, most = upper - lower, *self.variables.bounds
        low, high = self._z <= lower + AT_BOUND * width, self._z >= upper - AT_BOUND * width
        lower[low] = np.maximum(least, lower - 0.5 * width)[low]
        upper[high] = np.minimum(most, upper + 0.5 * width)[high]
        if np.any(lower < region.lower) or np.any(upper > region.upper):
            self._region = box(lower, upper)
            beyond = np.where(low, lower, np.where(high, region.upper, region.lower))
            until = np.where(low, region.lower, np.where(high, upper, region.upper))
            self._waiting = self._scattered(box(np.minimum(beyond, until - 1e-9), until), WIDER)


def measured(channel: str) -> str:
    """The name under which a model's channel is recorded."""
    return MEASURED_AS.get(channel, channel)


def _noise(left: Array, used: NDArray[np.bool_]) -> Array:
    """Deviation of the residuals (n,), the same for all samples; never below a thousandth of the emulator's unit."""
    own = left[used]
    return np.full(left.size, max(float(np.sqrt(np.mean(own**2))), 1e-3))
