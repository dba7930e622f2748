"""The suction instruments as two blocks of data: command -> recorded pressure, and recorded pressure -> apex height.

The first isolates the actuator: no tissue in it. The second is fed with the *smoothed* recorded pressure (raw gauge noise would
imitate friction and preload) and meets the tissue: the reduced law with its parameters free, and beside it a discrepancy that other
tissue laws could leave (`gap.tissue_null`), so that only what no tissue could do is called a device effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gap.binning import Bins
from gap.chains import pruned
from gap.hypothesis import Active, Candidate, Evaluation, FloatArray, Problem, Rows
from gap.rows import label_rows
from gap.session import SKIN, Command, Session
from gap.tissue_null import discrepancy
from sim_devices.chain import Chain, Effect
from sim_devices.stages import nominal
from sim_devices.stages.sampling import simulate
from sim_devices.stages.suction import REGULATOR_TAU, with_tissue
from sim_devices.stages.tissues import SuctionTissue, suction_tissue

HEIGHT_RESOLUTION = 10e-6
"""Nominal resolution of the apex height, m (assumed)."""


@dataclass(frozen=True)
class Group:
    """Recordings of one specimen; they share a tissue and are simulated together, rests included."""

    specimen: str
    members: tuple[int, ...]
    command: Command


class SuctionSession(Session):
    """A session of a suction instrument, grouped by specimen, with everything binned once."""

    def __init__(self, recordings: Sequence[Any]) -> None:
        super().__init__(recordings)
        self.instrument = recordings[0].info.instrument
        names = dict.fromkeys(r.info.specimen or SKIN for r in recordings)
        self.groups = [
            Group(name, members, self.command("pressure", members))
            for name in names
            for members in [tuple(k for k, r in enumerate(recordings) if (r.info.specimen or SKIN) == name)]
        ]
        self.kinks = np.unique(np.concatenate([g.command.time for g in self.groups]))
        self.marks = tuple(self.span(k)[0] for k in range(len(recordings)))

    def chain(self, group: Group, tissue: SuctionTissue, **options: Any) -> Chain:
        """The nominal chain for a group: its tissue if it is skin, else what its specimen is."""
        law = tissue if group.specimen == SKIN else _specimen(group.specimen)
        return with_tissue(nominal(self.instrument, marks=self.marks, **options), law)


def _specimen(name: str) -> SuctionTissue:
    try:
        return suction_tissue(name)
    except ValueError:
        return suction_tissue("silicone")


class _Block:
    """What both blocks share: rows in bins, whitening, effects by candidate."""

    name: str
    channel: str
    FLOOR = 0.0

    def __init__(self, session: SuctionSession, library: dict[str, Effect]) -> None:
        self.session, self.library = session, library
        self._groups = [
            (g, tuple(k for k in g.members if self.channel in session.recordings[k].streams)) for g in session.groups
        ]
        if self.name == "pressure":  # an open probe holds no pressure: its record says nothing of the regulator
            self._groups = [(g, m) for g, m in self._groups if g.specimen != "open air"]
        bins: list[tuple[int, Bins]] = [
            (k, session.binned(self.channel, k, session.kinks)) for _, members in self._groups for k in members
        ]
        members = [k for k, _ in bins]
        white, grid = session.sigma(self.channel, members)
        self.noise = white
        self.stamps = np.concatenate([b.time for _, b in bins])
        self.measured = np.concatenate([b.value for _, b in bins])
        floor = np.hypot(grid, self.FLOOR)
        self.sigma = np.sqrt(white**2 / np.concatenate([b.count for _, b in bins]) + floor**2)
        self.rows: Rows = label_rows(
            [(session.recordings[k], self.channel, b.time - session.shifts[k]) for k, b in bins]
        )
        owner = np.concatenate([np.full(len(b.time), k) for k, b in bins])
        self.rows = replace(self.rows, recording=owner.astype(np.int64), time=self.stamps)
        self.dt = float(
            np.median([np.median(np.diff(session.recordings[k].streams[self.channel].time)) for k in members])
        )

    @cached_property
    def _slices(self) -> list[slice]:
        sizes = [sum(int(np.sum(self.rows.recording == k)) for k in members) for _, members in self._groups]
        ends = np.cumsum(sizes)
        return [slice(int(e - s), int(e)) for s, e in zip(sizes, ends, strict=True)]

    def _with(self, chain: Chain, active: Active) -> Chain:
        for candidate, values in active.items():
            chain = self.library[candidate.key].apply(chain, values)
        return chain


class PressureBlock(_Block):
    """Command -> recorded pressure.

    Nuisance: the regulator's time constant and damping, the sampling convention (a shift within one sample), and three quick lags that
    other regulators than the nominal second-order one would add.
    """

    name, channel = "pressure", "pressure"
    LAGS = (0.015, 0.04, 0.1)
    FLOOR = 10.0  # Pa: a tenth of the command's resolution, below which the nominal chain is not known

    def __init__(self, session: SuctionSession, library: dict[str, Effect]) -> None:
        super().__init__(session, library)
        self.prior_sd = np.array([0.15, 0.15, 0.6 * self.dt, *[0.03] * len(self.LAGS)])
        self.prior_mean = np.zeros(len(self.prior_sd))
        self.local = np.zeros(len(self.prior_sd), bool)
        self.alternatives = (self.prior_sd,)
        self._lagged = self._lag_columns()

    def start(self) -> FloatArray:
        return self.prior_mean.copy()

    def _lag_columns(self) -> FloatArray:
        """Lagged minus direct command (n, lags), Pa."""
        out = np.zeros((len(self.stamps), len(self.LAGS)))
        for (g, _), at in zip(self._groups, self._slices, strict=True):
            fine = np.unique(
                np.concatenate([self.stamps[at], *[g.command.time + d for d in (0.0, 1e-9, 0.02, 0.05, 0.1, 0.2)]])
            )
            direct = np.interp(fine, g.command.time, g.command.value)
            for j, tau in enumerate(self.LAGS):
                out[at, j] = np.interp(self.stamps[at], fine, _lag(fine, direct, tau) - direct)
        return out

    def predict(self, nuisance: FloatArray, active: Active, stamps: FloatArray | None = None) -> FloatArray:
        """Recorded pressure (n,) Pa."""
        tau, zeta = REGULATOR_TAU * np.exp(nuisance[0]), float(np.exp(nuisance[1]))
        out = np.empty(len(self.stamps))
        for (g, _), at in zip(self._groups, self._slices, strict=True):
            # Bins average over the staircase of the command's resolution: simulate its mean.
            chain = self._with(self.session.chain(g, _NO_TISSUE, tau=tau, zeta=zeta, command_step=0.0), active)
            chain = pruned(chain, ("pressure",))
            made = simulate(
                chain, {"pressure": (g.command.time, g.command.value)}, {"pressure": self.stamps[at] + nuisance[2]}
            )
            out[at] = made["pressure"]
        return out + self._lagged @ nuisance[3:]

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        predicted = self.predict(nuisance, active)
        residual = (self.measured - predicted) / self.sigma
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        jacobian = np.empty((len(residual), len(nuisance)))
        for k, step in enumerate((1e-3, 1e-3, 0.05 * self.dt)):
            moved = nuisance.copy()
            moved[k] += step
            jacobian[:, k] = (self.predict(moved, active) - predicted) / step / self.sigma
        jacobian[:, 3:] = self._lagged / self.sigma[:, None]
        return Evaluation(residual, jacobian)


_NO_TISSUE = SuctionTissue(0.0, creep=(), times=(), residual=0.0, softening=0.0)


class HeightBlock(_Block):
    """Recorded pressure -> apex height.

    Nuisance: the reduced tissue's parameters; per recording a gain (the skin's scatter from run to run) and a zero; the sampling
    convention; the discrepancy of tissue laws.
    """

    name, channel = "height", "apex_height"
    TISSUE = ("compliance", "knee", "exponent", "creep1", "creep2", "creep3", "creep4", "residual", "softening")
    TISSUE_SD = (1.5, 1.0, 0.4, 0.15, 0.15, 0.15, 0.15, 0.1, 0.04)
    GAIN_SD = 0.05
    DISCREPANCY_SD = 0.01  # of the height, per basis function
    DISCREPANCY_SCALES = (0.1, 1.0, 5.0)

    def __init__(self, session: SuctionSession, library: dict[str, Effect], pressure: PressureBlock | None) -> None:
        super().__init__(session, library)
        self._tissue = suction_tissue("forearm")
        self._line = [self._smoothed(g, pressure) for g, _ in self._groups]
        self.size = max(float(np.ptp(self.measured)), 10 * float(np.median(self.sigma)))
        runs = sorted({int(r) for r in self.rows.recording})
        self._runs = runs
        member = np.array([[float(r == k) for k in runs] for r in self.rows.recording]).reshape(
            len(self.stamps), len(runs)
        )
        self._member = member
        skin = np.concatenate(
            [
                np.full(at.stop - at.start, g.specimen == SKIN)
                for (g, _), at in zip(self._groups, self._slices, strict=True)
            ]
        )
        columns, weights = self._discrepancy_columns()
        self._basis = columns * (self.size * skin)[:, None]
        zero = max(0.3 * self.noise, HEIGHT_RESOLUTION * 0.5)
        n, r = len(self.TISSUE), len(runs)
        self.prior_mean = np.zeros(n + 1 + 2 * r + columns.shape[1])
        self.prior_sd = np.concatenate(
            [self.TISSUE_SD, [0.6 * self.dt], np.full(r, self.GAIN_SD), np.full(r, zero), self.DISCREPANCY_SD * weights]
        )
        self.local = np.zeros(len(self.prior_sd), bool)
        self.local[n + 1 : n + 1 + 2 * r] = True
        first = n + 1 + 2 * r
        self.alternatives = tuple(
            np.concatenate([self.prior_sd[:first], self.prior_sd[first:] * s]) for s in self.DISCREPANCY_SCALES
        )

    def _smoothed(self, group: Group, pressure: PressureBlock | None) -> tuple[FloatArray, FloatArray]:
        """Recorded pressure of a group as a table: the fitted actuator's output plus the smoothed remainder."""
        times, values = [], []
        for k in group.members:
            recording = self.session.recordings[k]
            if "pressure" not in recording.streams:
                continue
            series = recording.streams["pressure"]
            time, value = self.session.time(k, series), np.asarray(series.value, dtype=float)
            good = np.isfinite(value)
            times.append(time[good])
            values.append(_denoised(value[good]))
        if not times:
            return group.command.time, group.command.value
        return np.concatenate(times), np.concatenate(values)

    def _discrepancy_columns(self) -> tuple[FloatArray, FloatArray]:
        parts, weights = [], np.zeros(0)
        for (_, _), at, (t, p) in zip(self._groups, self._slices, self._line, strict=True):
            basis, weights = discrepancy(t, p, self.stamps[at], np.asarray(self.session.marks))
            parts.append(basis)
        return np.vstack(parts), weights

    def tissue(self, nuisance: FloatArray) -> SuctionTissue:
        """The reduced tissue at a nuisance vector."""
        c = dict(zip(self.TISSUE, nuisance, strict=False))
        base = self._tissue
        creep = tuple(g + c[f"creep{i + 1}"] for i, g in enumerate(base.creep))
        return replace(
            base,
            compliance=base.compliance * float(np.exp(c["compliance"])),
            knee=base.knee * float(np.exp(c["knee"])),
            exponent=float(np.clip(base.exponent + c["exponent"], 0.02, 3.0)),
            creep=creep,
            residual=base.residual + c["residual"],
            softening=base.softening + c["softening"],
        )

    def start(self) -> FloatArray:
        c = self.prior_mean.copy()
        predicted = self._chain_height(c, {})
        top = float(np.max(np.abs(predicted)))
        if top > 0:
            c[0] = float(np.log(max(np.max(self.measured), 1e-7) / top))
        return c

    def _chain_height(self, nuisance: FloatArray, active: Active) -> FloatArray:
        """Apex height of the chain (n,) m, before run scatter and discrepancy."""
        tissue = self.tissue(nuisance)
        shift = nuisance[len(self.TISSUE)]
        out = np.empty(len(self.stamps))
        for (g, _), at, (t, p) in zip(self._groups, self._slices, self._line, strict=True):
            chain = self._with(self.session.chain(g, tissue), active)
            gain, offset = chain["gauge"].parameters  # type: ignore[attr-defined]
            chain = pruned(chain, ("apex_height",), given=("line_pressure",))
            made = simulate(
                chain,
                {"pressure": (g.command.time, g.command.value)},
                {"apex_height": self.stamps[at] + shift},
                {"line_pressure": (t, (p - offset) / (1.0 + gain))},
            )
            out[at] = made["apex_height"]
        return out

    def _split(self, nuisance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        n, r = len(self.TISSUE) + 1, len(self._runs)
        return nuisance[n : n + r], nuisance[n + r : n + 2 * r], nuisance[n + 2 * r :]

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        gains, zeros, discrepancy_c = self._split(nuisance)
        height = self._chain_height(nuisance, active)
        predicted = height * (1 + self._member @ gains) + self._member @ zeros + self._basis @ discrepancy_c
        residual = (self.measured - predicted) / self.sigma
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        n = len(self.TISSUE) + 1
        chain_part = np.empty((len(residual), n))
        for k in range(n):
            moved = nuisance.copy()
            step = 1e-3 if k < n - 1 else 0.05 * self.dt
            moved[k] += step
            chain_part[:, k] = (self._chain_height(moved, active) - height) / step
        chain_part *= (1 + self._member @ gains)[:, None]
        jacobian = np.hstack([chain_part, self._member * height[:, None], self._member, self._basis])
        return Evaluation(residual, jacobian / self.sigma[:, None])


def _lag(time: FloatArray, value: FloatArray, tau: float) -> FloatArray:
    from sim_devices.stages.kernels import evaluate, low_pass

    return evaluate(low_pass, time, value, tau)


def _denoised(value: FloatArray) -> FloatArray:
    """A pressure record without its gauge noise: narrow smoothing only where the signal itself moves quickly."""
    from gap.noise import high_band_sigma

    sigma = high_band_sigma(value)
    wide = gaussian_filter1d(value, 12.0, mode="nearest")
    narrow = gaussian_filter1d(value, 1.0, mode="nearest")
    moving = gaussian_filter1d((np.abs(narrow - wide) > 2.5 * sigma).astype(float), 3.0, mode="nearest")
    trust = np.clip(4.0 * moving, 0.0, 1.0)
    near = np.where(np.abs(value - narrow) > 6 * sigma, value, narrow)
    return trust * near + (1 - trust) * wide


def candidates_for(
    effects: dict[str, Effect], blocks: Sequence[_Block], starts: Sequence[FloatArray]
) -> tuple[Candidate, ...]:
    """One candidate per effect; which blocks it changes is found by switching it on."""
    out = []
    for key, effect in effects.items():
        touched = []
        for block, start in zip(blocks, starts, strict=True):
            trial = Candidate(
                key, effect.name, effect.stage, effect.parameters, (block.name,), effect.meaning, effect.remedy
            )
            nominal_residual = block.evaluate(start, {}, want_jacobian=False).residual  # type: ignore[attr-defined]
            values = {p.name: p.default for p in effect.parameters}
            changed = block.evaluate(start, {trial: values}, want_jacobian=False).residual  # type: ignore[attr-defined]
            if float(np.max(np.abs(changed - nominal_residual))) > 0.05:
                touched.append(block.name)
        if touched:
            out.append(
                Candidate(
                    key, effect.name, effect.stage, effect.parameters, tuple(touched), effect.meaning, effect.remedy
                )
            )
    return tuple(out)


def suction_problems(
    recordings: Sequence[Any], effects: dict[str, Effect]
) -> tuple[list[Problem], tuple[Candidate, ...]]:
    """The blocks that a session's channels allow, and the effects that show in them.

    Raises ValueError when neither pressure nor height, or no set-point, was recorded.
    """
    missing = [r.info.id for r in recordings if "pressure" not in r.setpoints]
    if missing:
        raise ValueError(f"recording {missing[0]} has no set-points of pressure: what was commanded is not known")
    session = SuctionSession(recordings)
    blocks: list[_Block] = []
    pressure = None
    if any("pressure" in r.streams for r in recordings):
        pressure = PressureBlock(session, effects)
        blocks.append(pressure)
    if any("apex_height" in r.streams for r in recordings):
        blocks.append(HeightBlock(session, effects, pressure))
    if not blocks:
        raise ValueError(f"recording {recordings[0].info.id} has neither channel pressure nor apex_height")
    starts = [b.start() for b in blocks]  # type: ignore[attr-defined]
    return blocks, candidates_for(effects, blocks, starts)  # type: ignore[return-value]
