"""A user's forward model on recordings of any channels, as a problem of the diagnosis."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from acquire.recording.model import Recording, Series
from gap.data.labels import label_rows
from gap.data.signatures import Signature
from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Candidate, Evaluation, Start, from_unit, to_unit
from gap.inference.least_squares import fit, predicted
from gap.inference.problem import Problem
from gap.rig.generic import INITIAL, GenericEffect
from gap.rig.library import Rig, widest_range
from gap.rig.model import ForwardModel, ModelError, check_model
from gap.rig.noise import ChannelNoise, moves
from gap.rig.taps import Acting, Drag, Seen, Survey
from sim_devices.chain import FloatArray, Parameter

MAX_ROWS = 40_000
"""Rows of one problem above which samples are thinned (after simulation) to keep a diagnosis within seconds."""
FEWEST = 20
"""Samples of a recording below which neither noise nor effect can be told from it."""
DIVERGED = 1e6
"""σ beyond which a residual says no more than that the model diverged; squares of more would overflow."""
PLACES, CLOSEST = 24, 2
"""Places in the ranges of a model's parameters that are tried, and from how many of them, besides the defaults, a fit
begins."""
SEARCHED, SEARCH_WORK = 8, 4_000
"""Places from which a fit with an effect begins at most, and what one simulation at each may cost: a call of a tap
counts 1, ten samples do."""
END = 3e-3
"""Share of a parameter's range from its ends at which it is said to be there."""
EDGE = 1e-3
"""Share of a parameter's range from its ends at which a fit of it begins at most."""
MOVING = 0.05
"""Share of a channel's range that a model which foretells no standstill there moves by, on average."""
BEYOND = 5.0
"""Standard deviations of noise by which the largest of some thousand samples may exceed the end of a sensor's range."""
PROBE = 1e-3
"""Drag, in signal over velocity, that shows the meaning of a tap's sign."""


_Array = TypeVar("_Array", bound=NDArray[Any])


class RigProblem:
    """Recordings of one rig against its forward model; nuisance = the model's own parameters.

    Nuisance coordinates are normal quantiles of the stated range (or of its logarithm): a standard normal prior is a
    uniform one in the range, and nothing leaves it. Outside, a model imitates an effect by its tolerances.
    """

    name = "rig"
    sound: FloatArray | None = None
    resets: Sequence[float] = ()
    open_law = False
    input_block = ""

    def __init__(
        self, recordings: Sequence[Recording], model: ForwardModel, further: Sequence[GenericEffect] = ()
    ) -> None:
        check_model(model, recordings)
        self.model = model
        self._runs = [_on_one_time_base(r, model) for r in recordings]
        self.prior_mean = np.zeros(len(model.parameters))
        self.prior_sd = np.ones(len(model.parameters))
        nominal, self._seen, self._work = self._survey()
        observe = getattr(model, "observe", lambda time, data: data)
        observed = [self._series("observe", time, self._asked(observe, time, data)) for time, data in self._runs]
        self._noise = ChannelNoise.of(model, recordings, [data for _, data in self._runs])
        total = sum(len(time) for time, _ in self._runs) * len(model.channels)
        self._stride = max(1, int(np.ceil(total / MAX_ROWS)))
        self._keep, self._measured = _comparable(observed, nominal, self._stride), observed
        self.measured = np.concatenate([m[keep] for m, keep in zip(_flat(observed), _flat(self._keep), strict=True)])
        if not len(self.measured):
            raise ModelError(f"model {model.name}: no sample has both a measured and a finite predicted value")
        self.sigma = self._by_row()
        self._start: FloatArray | None = None
        self.likelihood_powers = (0.6,)
        self.law_parameters = 0
        self.prior_scales: Sequence[FloatArray] = (self.prior_sd,)
        self.sd_without_discrepancy = self.prior_sd
        self.rows = label_rows(
            [(r, c, time[k]) for r, (time, _), ks in zip(recordings, self._runs, self._keep, strict=True)
             for c, k in zip(model.channels, ks, strict=True)]
        )  # fmt: skip
        library = tuple(self._rig(recordings[0].stream(model.channels[0]).unit).library(further))
        self.candidates = tuple(c for c, _ in library)
        self._by_key = {c.key: e for c, e in library}

    def _rig(self, unit: str) -> Rig:
        """The facts of the rig that the priors of its effects scale with."""
        time = self._runs[0][0]
        return Rig(
            self.model, self._seen, self._noise.counts, unit, widest_range(self._measured),
            interval=float(np.median(np.diff(time))), duration=float(time[-1] - time[0]), recordings=len(self._runs),
            ends=self._ends(),
        )  # fmt: skip

    def _ends(self) -> dict[str, tuple[float, float, float]]:
        """The lowest and highest value of each channel, and by how much noise may have moved them."""
        runs = {c: np.concatenate(ms) for c, *ms in zip(self.model.channels, *self._measured, strict=True)}
        return {c: (float(np.nanmin(m)), float(np.nanmax(m)), BEYOND * self._noise.sigma[c]) for c, m in runs.items()}

    @property
    def interval(self) -> float:
        """The coarsest recording's sampling interval, s."""
        return max(float(np.median(np.diff(time))) for time, _ in self._runs)

    @property
    def seen(self) -> Mapping[str, Seen]:
        """Statistics of each tap in a nominal run."""
        return self._seen

    def knowing(self, further: Mapping[str, GenericEffect]) -> RigProblem:
        """The same problem with further effects, by their candidates' keys."""
        out = copy.copy(self)
        out._by_key = {**self._by_key, **further}
        return out

    def _by_row(self) -> FloatArray:
        """Noise (n,) of the measured values."""
        kept = [(c, k) for ks in self._keep for c, k in zip(self.model.channels, ks, strict=True)]
        return np.concatenate([np.full(len(k), self._noise.sigma[c]) for c, k in kept])

    def _survey(self) -> tuple[list[list[FloatArray]], dict[str, Seen], int]:
        """Nominal prediction of every run at default parameters, the signals at taps, and the cost of a simulation."""
        survey, out = Survey(), []
        defaults = {p.name: p.default for p in self.model.parameters}
        for time, data in self._runs:
            survey.begin(time)
            made = self._asked(self.model.simulate, time, data, defaults, survey)
            out.append(self._series("simulate", time, made))
        undeclared = sorted(set(survey.seen) - set(self.model.stages))
        if undeclared:
            raise ModelError(f"model {self.model.name}: taps {', '.join(undeclared)} have no stage in `stages`")
        for name, seen in survey.seen.items():
            seen.opposes = "velocity" not in seen.related or self._opposed(name, seen, defaults)
        return out, survey.seen, survey.work + sum(len(time) for time, _ in self._runs) // 10

    def _asked(
        self, method: Callable[..., Any], time: FloatArray, data: Mapping[str, FloatArray], *arguments: Any
    ) -> Any:
        """The answer of a method of the model; an exception is told with the contents of ``data``."""
        try:
            with np.errstate(all="ignore"):
                return method(time, data, *arguments)
        except Exception as error:
            raise ModelError(
                f"model {self.model.name}: {method.__name__} fails: {type(error).__name__}: {error} "
                f"(data: {', '.join(data)})"
            ) from error

    def _series(self, method: str, time: FloatArray, made: Any) -> list[FloatArray]:
        """The predicted channels in a method's result, each (n,)."""
        missing = [c for c in self.model.channels if c not in made]
        if missing:
            raise ModelError(f"model {self.model.name}: {method} returned no {', '.join(missing)}")
        out = [np.asarray(made[c], dtype=float) for c in self.model.channels]
        for channel, values in zip(self.model.channels, out, strict=True):
            if values.shape != time.shape:
                raise ModelError(
                    f"model {self.model.name}: {method} returned {channel} of shape {values.shape}, not {time.shape}"
                )
        return out

    def _opposed(self, tap: str, seen: Seen, parameters: Mapping[str, float]) -> bool:
        """Whether a drag that adds to the tap's signal makes the motion there no faster.

        It does where a model taps the net force; where motion is an input, nothing changes it.
        """
        time, data = self._runs[0]
        size = max(abs(seen.low), abs(seen.high)) or 1.0
        motion = []
        for sign in (0.0, 1.0):
            drag = Drag(tap, sign * PROBE * size / (seen.related["velocity"] or 1.0))
            self._simulated(time, data, parameters, drag)
            motion.append(drag.motion)
        return not motion[1] > motion[0] * (1 + 1e-12)

    def _simulated(
        self, time: FloatArray, data: Mapping[str, FloatArray], parameters: Mapping[str, float], tap: Callable[..., Any]
    ) -> list[FloatArray]:
        """The predicted channels; a parameter set at which the model diverges makes them NaN and no noise. So does one
        at which it fails, such as by the root of a negative number: at its defaults it worked."""
        try:
            with np.errstate(all="ignore"):
                made = self.model.simulate(time, data, parameters, tap)
        except (ArithmeticError, ValueError, TypeError):
            return [np.full(time.size, np.nan)] * len(self.model.channels)
        return [np.asarray(made[c], dtype=float) for c in self.model.channels]

    def start(self) -> FloatArray:
        """Where a fit of the model by itself begins: of several places in its parameters' ranges, the one from where
        it comes farthest in a few steps. From the defaults alone, a resonance may never find its frequency."""
        if self._start is None:
            size = len(self.model.parameters)
            places = [self.coordinates({p.name: p.default for p in self.model.parameters})]
            if size:
                places += list(ndtri(qmc.Halton(size, seed=0).random(PLACES)))
            costs = [float(np.sum(np.square(self._residual(place, {})))) for place in places]
            nearest = [places[k] for k in np.argsort(costs) if k][:CLOSEST]
            fits = [fit(self, nuisance=place, iterations=12) for place in (places[0], *nearest)]
            best = min(fits, key=lambda f: f.objective)
            self._start = best.nuisance
            self._quieter(best)
        return self._start.copy()

    def _quieter(self, alone: Fit) -> None:
        """Lower the noise of channels to the roughness of the residual of the model by itself."""
        if self._stride > 1 or hasattr(self.model, "observe"):
            return  # a thinned or filtered channel has no high band to read noise from
        at = 0
        left = {c: list[FloatArray]() for c in self.model.channels}
        for keeps, measured in zip(self._keep, self._measured, strict=True):
            for channel, keep, m in zip(self.model.channels, keeps, measured, strict=True):
                residual = alone.residual[at : at + len(keep)] * self._noise.sigma[channel]
                left[channel].append(residual[moves(m[keep])])
                at += len(keep)
        self._noise.lower(left)
        self.sigma = self._by_row()

    def under_simple_law(self, candidate: Candidate, unit: FloatArray) -> Fit | None:
        return None

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        """Where else a fit with the last of some effects might begin: of several places in its prior, with the model's
        parameters halfway between their fit without it and anywhere in their ranges, the one from where it comes
        farthest in a few steps. An effect that takes over half of the model's part (a slow mode, a yield) is seldom
        found downhill from the model's own fit."""
        many = min(SEARCH_WORK // max(self._work, 1), SEARCHED)
        if many < 2:
            return None
        size, alone = len(hypothesis[-1].parameters), self.start()
        places = qmc.Halton(size + len(alone), seed=0).random(many)
        fits = [
            fit(self, hypothesis, np.r_[unit[:-size], p[:size]], 0.5 * (alone + ndtri(p[size:])), iterations=6)
            for p in places
        ]
        best = min(fits, key=lambda f: f.objective)
        return Start(self.prior_mean, self.prior_sd, best.nuisance, best.unit)

    def lateness(self, fitted: Fit) -> None:
        return None

    def noise_scale(self, active: Active) -> None:
        return None

    def unwhitened(self, residual: FloatArray, active: Active) -> FloatArray:
        return residual * self.sigma

    def walk_log_bayes(self, fitted: Fit) -> float:
        return np.inf

    def belies(self, fitted: Fit) -> bool:
        return False

    def chance_log_bayes(self, fitted: Fit) -> float:
        return 0.0

    def parameters(self, nuisance: FloatArray) -> dict[str, float]:
        """The model's parameters at a nuisance vector."""
        return {p.name: from_unit(p, float(u)) for p, u in zip(self.model.parameters, ndtr(nuisance), strict=True)}

    def quantities(self, nuisance: FloatArray) -> dict[str, tuple[float, str]]:
        values = self.parameters(nuisance)
        return {p.name: (values[p.name], p.unit) for p in self.model.parameters}

    def at_the_end(self, found: Fit) -> list[str]:
        """Remarks on parameters that a fit has at an end of their range, of effects at the upper one: the lower one is
        no effect, or as sharp a one as may be."""
        out = [
            f"parameter {p.name} of the model ends at {_of_range(p, u)}: are the range and its unit right? Recordings "
            "are in SI"
            for p, u in zip(self.model.parameters, ndtr(found.nuisance), strict=True)
            if not END < u < 1.0 - END
        ]
        fitted = [(c, p) for c in found.hypothesis for p in c.parameters]
        return out + [
            f"{p.name} of {c.key} ends at {_of_range(p, u)}: the effect may go beyond it, or be of another form"
            for (c, p), u in zip(fitted, found.unit.tolist(), strict=True)
            if p.unit != "choice" and u > 1.0 - END
        ]

    def coordinates(self, parameters: Mapping[str, float]) -> FloatArray:
        """The nuisance vector of the model's parameters; `parameters` inverts it."""
        units = [to_unit(p, parameters[p.name]) for p in self.model.parameters]
        return np.asarray(ndtri(np.clip(units, EDGE, 1.0 - EDGE)))

    def _residual(self, nuisance: FloatArray, active: Active) -> FloatArray:
        p = self.parameters(nuisance)
        parts = []
        for k, ((time, data), keeps, measured) in enumerate(zip(self._runs, self._keep, self._measured, strict=True)):
            made = self._simulated(time, data, p, Acting(self._at_taps(active, k), time, self._seen))
            for channel, keep, m, foretold in zip(self.model.channels, keeps, measured, made, strict=True):
                with np.errstate(over="ignore"):
                    parts.append((m[keep] - foretold[keep]) / self._noise.sigma[channel])
        # A parameter set at which the model diverges is a very bad one, not an error.
        return np.clip(np.nan_to_num(np.concatenate(parts), nan=DIVERGED), -DIVERGED, DIVERGED)

    def _at_taps(self, active: Active, k: int) -> dict[str, list[tuple[GenericEffect, Mapping[str, float]]]]:
        """The effects that act at each tap in run ``k``."""
        at: dict[str, list[tuple[GenericEffect, Mapping[str, float]]]] = {}
        for candidate, values in active.items():
            tap, own = candidate.key.split("@", 1)[1], f"{INITIAL}_{k + 1}"
            here = {**values, INITIAL: values[own]} if own in values else values
            at.setdefault(tap, []).append((self._by_key[candidate.key], here))
        return at

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        residual = self._residual(nuisance, active)
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        jacobian = np.empty((len(residual), len(nuisance)))
        for k in range(len(nuisance)):
            moved = nuisance.copy()
            moved[k] += 1e-4
            jacobian[:, k] = (residual - self._residual(moved, active)) / 1e-4
        return Evaluation(residual, jacobian)


def against_the_model(mark: Signature, problem: Problem, alone: Fit) -> bool:
    """Whether a channel that stands at its end does so against the model by itself: most of the values there are
    foretold beyond, or are foretold to move. A motor at rest stands at nought, and so it should. True of any other
    mark."""
    sign = {"saturation": 1.0, "lower_saturation": -1.0}.get(mark.effect)
    if sign is None:
        return True
    codes, names = problem.rows.labels["channel"]
    here = np.flatnonzero(codes == names.index(mark.channel))
    measured, foretold = sign * problem.measured[here], sign * predicted(problem, alone)[here]
    at = np.flatnonzero(measured >= np.max(measured) - problem.sigma[here])
    if np.median((foretold - measured)[at] / problem.sigma[here][at]) > 1.0:
        return True
    stands = np.split(foretold[at], np.flatnonzero(np.diff(at) > 1) + 1)
    return sum(len(s) * float(np.ptp(s)) for s in stands) > MOVING * len(at) * float(np.ptp(measured))


def _of_range(p: Parameter, u: float) -> str:
    """A parameter's value at a unit coordinate, and its range, in words."""
    unit = f" {p.unit}" if p.unit != "1" else ""
    return f"{from_unit(p, float(u)):.4g}{unit}, the end of its range {p.low:.4g} … {p.high:.4g}{unit}"


def _comparable(
    measured: Sequence[Sequence[FloatArray]], foretold: Sequence[Sequence[FloatArray]], stride: int
) -> list[list[NDArray[np.intp]]]:
    """Every ``stride``-th of the samples, by run and channel, that have a measured and a predicted value."""
    return [
        [np.flatnonzero(np.isfinite(m) & np.isfinite(p))[::stride] for m, p in zip(ms, ps, strict=True)]
        for ms, ps in zip(measured, foretold, strict=True)
    ]


def _flat(by_run: Sequence[Sequence[_Array]]) -> list[_Array]:
    """Arrays by run and channel, one after the other."""
    return [array for by_channel in by_run for array in by_channel]


def _on_one_time_base(recording: Recording, model: ForwardModel) -> tuple[FloatArray, dict[str, FloatArray]]:
    """All channels and set-points of a recording on the time base of the first predicted channel."""
    base = recording.stream(model.channels[0])
    finite = np.isfinite(base.time)
    time = base.time[finite]
    if len(time) < FEWEST:
        raise ModelError(
            f"recording {recording.info.id}: channel {model.channels[0]} has {len(time)} samples; {FEWEST} are needed"
        )

    def on_base(series: Series) -> FloatArray:
        value = np.asarray(series.value, dtype=float)
        if len(series.time) == len(base.time) and np.array_equal(series.time, base.time):
            return value[finite]
        sampled: FloatArray = np.interp(time, series.time, value)
        return sampled

    data = {name: on_base(series) for name, series in recording.streams.items()}
    for name, series in recording.setpoints.items():
        # Of a set-point and a channel of one name, that name alone means the channel.
        data[f"setpoint_{name}"] = on_base(series)
        data.setdefault(name, data[f"setpoint_{name}"])
    return time, data
