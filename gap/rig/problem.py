"""A user's forward model on recordings of any channels, as a problem of the diagnosis."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from acquire.recording.model import Recording, Series
from gap.data.labels import label_rows
from gap.data.noise import coarse_counts, high_band_sigma
from gap.data.signatures import Signature
from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Candidate, Evaluation, Start, from_unit, to_unit
from gap.inference.least_squares import fit, predicted
from gap.inference.problem import Problem
from gap.rig.generic import GENERIC, INITIAL, GenericEffect, counted
from gap.rig.model import ForwardModel, ModelError, check_model
from gap.rig.noise import moves, roughness, stated_noise
from gap.rig.taps import Acting, Drag, Seen, Survey, scaled
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
PROBE = 1e-3
"""Drag, in signal over velocity, that shows the meaning of a tap's sign."""


class RigProblem:
    """Recordings of one rig against its forward model; nuisance = the model's own parameters.

    Nuisance coordinates are normal quantiles of the stated range (or of its logarithm): a standard normal prior is a
    uniform one in the range, and nothing leaves it. Outside, a model imitates an effect by its tolerances.
    """

    name = "rig"
    sound: FloatArray | None = None
    resets: Sequence[float] = ()
    open_law = False

    def __init__(
        self, recordings: Sequence[Recording], model: ForwardModel, further: Sequence[GenericEffect] = ()
    ) -> None:
        check_model(model, recordings)
        self.model = model
        self._effects = (*GENERIC, *getattr(model, "effects", ()), *further)
        self._unit = recordings[0].stream(model.channels[0]).unit
        self._runs = [_on_one_time_base(r, model) for r in recordings]
        self.prior_mean = np.zeros(len(model.parameters))
        self.prior_sd = np.ones(len(model.parameters))
        nominal, self._seen, self._work = self._survey()
        observe = getattr(model, "observe", lambda time, data: data)
        measured = [self._series("observe", time, self._asked(observe, time, data)) for time, data in self._runs]
        # Of the channel as recorded: noise that `observe` filters out counts, too.
        recorded = {c: [run[1][c] for run in self._runs] for c in model.channels}
        self._counts = {c: counts for c, v in recorded.items() if (counts := coarse_counts(np.concatenate(v)))}
        self._stated = stated_noise(model, recordings)
        everything = [data for _, data in self._runs]
        self._sigma = {c: roughness(c, values, everything) for c, values in recorded.items()}
        self._sigma |= {c: counts.sigma for c, counts in self._counts.items()} | self._stated
        total = sum(len(run[0]) for run in self._runs) * len(model.channels)
        self._stride = max(1, int(np.ceil(total / MAX_ROWS)))
        keep = [
            [np.flatnonzero(np.isfinite(m) & np.isfinite(p))[:: self._stride] for m, p in zip(ms, ps, strict=True)]
            for ms, ps in zip(measured, nominal, strict=True)
        ]
        if not any(len(k) for ks in keep for k in ks):
            raise ModelError(f"model {model.name}: no sample has both a measured and a finite predicted value")
        self._keep, self._measured = keep, measured
        self.measured = np.concatenate(
            [m[k] for ms, ks in zip(measured, keep, strict=True) for m, k in zip(ms, ks, strict=True)]
        )
        self.sigma = self._by_row()
        self._start: FloatArray | None = None
        self.likelihood_powers = (0.6,)
        self.prior_scales: Sequence[FloatArray] = (self.prior_sd,)
        self.sd_without_discrepancy = self.prior_sd
        self.rows = label_rows(
            [(r, c, run[0][k]) for r, run, ks in zip(recordings, self._runs, keep, strict=True)
             for c, k in zip(model.channels, ks, strict=True)]
        )  # fmt: skip
        library = self._library()
        self.candidates = tuple(c for c, _ in library)
        self._by_key = {c.key: e for c, e in library}

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
        return np.concatenate([np.full(len(k), self._sigma[c]) for c, k in kept])

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

    def _library(self) -> list[tuple[Candidate, GenericEffect]]:
        seen = self._seen
        time = self._runs[0][0]
        dt, duration = float(np.median(np.diff(time))), float(time[-1] - time[0])
        measured = float(max(np.ptp(m[np.isfinite(m)]) for ms in self._measured for m in ms))
        out = []
        for tap, stage in self.model.stages.items():
            if tap not in seen:
                continue
            for effect in self._effects:
                if effect.taps and tap not in effect.taps:
                    continue
                if effect.needs and effect.needs not in seen[tap].related:
                    continue
                if effect.of_turns and not seen[tap].turns(effect.needs):
                    continue
                if effect.looks_ahead and not seen[tap].whole:
                    continue
                size = max(abs(seen[tap].low), abs(seen[tap].high))
                if size < 1e-9 * measured and not effect.needs:
                    continue  # a tap that carries nothing nominally can only gain something from a related signal
                if seen[tap].high - seen[tap].low < 1e-9 * size and any(p.unit == "level" for p in effect.parameters):
                    continue  # a signal that stands still ends at no level
                unit = getattr(self.model, "units", {}).get(tap) or self._unit
                if effect.name == "quantisation" and tap in self._counts:
                    effect = counted(self._counts[tap], unit)
                parameters = tuple(
                    one
                    for p in effect.parameters
                    for one in self._of_each(scaled(p, seen[tap], measured, dt, duration, unit))
                )
                key = f"{effect.form or effect.name}@{tap}"
                candidate = Candidate(
                    key, effect.name, stage, parameters, (self.name,), f"{effect.meaning} (at {tap})", effect.remedy
                )
                out.append((candidate, effect))
        return out

    def _of_each(self, parameter: Parameter) -> list[Parameter]:
        """A parameter of an effect; of the state in which a recording begins one for each."""
        if parameter.name != INITIAL or len(self._runs) == 1:
            return [parameter]
        return [replace(parameter, name=f"{INITIAL}_{k}") for k in range(1, len(self._runs) + 1)]

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
        """Lower the noise of a channel to the roughness of the residual of the model by itself: where it is excited
        broadly, its own roughness is the signal's."""
        if self._stride > 1 or hasattr(self.model, "observe"):
            return  # a thinned or filtered channel has no high band to read noise from
        at = 0
        left = {c: list[FloatArray]() for c in self.model.channels}
        for keeps, measured in zip(self._keep, self._measured, strict=True):
            for channel, keep, m in zip(self.model.channels, keeps, measured, strict=True):
                residual = alone.residual[at : at + len(keep)] * self._sigma[channel]
                left[channel].append(residual[moves(m[keep])])
                at += len(keep)
        for channel in set(left) - set(self._stated) - set(self._counts):
            rough = float(np.median([high_band_sigma(v) for v in left[channel] if len(v)]))
            self._sigma[channel] = min(self._sigma[channel], rough)
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

    def timing_log_bayes(self, fitted: Fit) -> float:
        return 0.0

    def parameters(self, nuisance: FloatArray) -> dict[str, float]:
        """The model's parameters at a nuisance vector."""
        return {p.name: from_unit(p, float(u)) for p, u in zip(self.model.parameters, ndtr(nuisance), strict=True)}

    def quantities(self, nuisance: FloatArray) -> dict[str, tuple[float, str]]:
        values = self.parameters(nuisance)
        return {p.name: (values[p.name], p.unit) for p in self.model.parameters}

    def at_the_end(self, nuisance: FloatArray) -> list[str]:
        """Remarks on parameters that a fit has at an end of their range."""
        out = []
        for p, u in zip(self.model.parameters, ndtr(nuisance), strict=True):
            if not END < u < 1.0 - END:
                out.append(
                    f"parameter {p.name} of the model ends at {from_unit(p, float(u)):.4g} {p.unit}, the end of its "
                    f"range {p.low:g} … {p.high:g}: are the range and its unit right? Recordings are in SI"
                )
        return out

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
                    parts.append((m[keep] - foretold[keep]) / self._sigma[channel])
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
