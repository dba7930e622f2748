"""Fitted parameters with their standard errors: those of causes, and those of the nominal model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gap.decision.classes import Cause
from gap.decision.verdict import NOISY
from gap.diagnosis import Diagnosis
from gap.inference.evidence import Fit
from gap.inference.hypothesis import FROZEN, from_unit
from gap.inference.problem import Problem
from sim_devices.chain import FloatArray

STEP = 1e-3
"""Standard deviations (or quantiles) by which a parameter is moved for a derivative."""


def rounded(x: float) -> float:
    """``x`` to five significant digits, as reports give it."""
    return float(f"{x:.5g}")


def has_no_size(d: Diagnosis, cause: Cause) -> bool:
    """Whether the noise of its marks alone tells the first cause, so that what was fitted to it is no size of it: of
    one that is fitted as noise itself it is."""
    chance = (d.problems[b].noise_scale(f.active) for b, f in cause.hypothesis.fits.items())
    return d.verdict.settled_by == NOISY and all(times is None for times in chance)


def of_cause(d: Diagnosis, cause: Cause) -> dict[str, dict[str, Any]]:
    """Values, standard errors and units of a cause's parameters."""
    out: dict[str, dict[str, Any]] = {}
    for effect in cause.effects:
        block = cause.hypothesis.surest(effect)
        f, temper = cause.hypothesis.fits[block], d.verdict.posterior.temper[block]
        at = f.place(effect)
        for k, p in enumerate(effect.parameters):
            u = float(f.unit[at + k])
            slope = (from_unit(p, min(u + STEP, 1.0)) - from_unit(p, max(u - STEP, 0.0))) / (2 * STEP)
            variance = f.covariance[at + k, at + k] * temper
            key = p.name if len(cause.effects) == 1 else f"{effect.name}.{p.name}"
            se = abs(slope) * float(np.sqrt(max(variance, 0.0)))
            out[key] = {"value": rounded(from_unit(p, u)), "se": rounded(se), "unit": p.unit}
            if effect.event and p.name == "moment":
                out[key] |= _on_its_clock(d, from_unit(p, u))
    return out


def _on_its_clock(d: Diagnosis, moment: float) -> dict[str, Any]:
    """The recording in which a ``moment`` (s) of the session falls, or that follows it, and the time from its first
    sample."""
    begins: dict[int, float] = {}
    for problem in d.problems.values():
        for k in np.unique(problem.rows.recording).tolist():
            first = float(np.min(problem.rows.time[problem.rows.recording == k]))
            begins[k] = min(first, begins.get(k, np.inf))
    before = [k for k in begins if begins[k] <= moment] or [min(begins, key=lambda k: begins[k])]
    run = max(before, key=lambda k: begins[k])
    return {"recording": d.recordings[run].info.id, "in_recording": rounded(moment - begins[run])}


def of_model(d: Diagnosis) -> dict[str, dict[str, Any]]:
    """Parameters of the simulation by itself: value, standard error, unit, and the block of channels that tells them;
    ``with_effect`` is the value beside the effect that is claimed."""
    out: dict[str, dict[str, Any]] = {}
    for name, problem in d.problems.items():
        alone, beside = d.null.fits[name], d.best.fits[name]
        errors = _errors(problem, alone, d.verdict.posterior.temper[name])
        with_effect = problem.quantities(beside.nuisance)
        for key, (value, unit) in problem.quantities(alone.nuisance).items():
            entry = {"value": rounded(value), "se": rounded(errors[key]), "unit": unit, "block": name}
            if d.verdict.claims and beside is not alone and key in with_effect:
                entry["with_effect"] = rounded(with_effect[key][0])
            out[key if key not in out else f"{name}.{key}"] = entry
    return out


def _errors(problem: Problem, f: Fit, temper: float) -> Mapping[str, float]:
    """Standard errors of a problem's quantities."""
    names, matrix = covariance(problem, f, temper)
    return dict(zip(names, np.sqrt(np.maximum(np.diag(matrix), 0.0)).tolist(), strict=True))


def covariance(problem: Problem, f: Fit, temper: float) -> tuple[tuple[str, ...], FloatArray]:
    """Names of a problem's quantities and their covariance (q, q), by the curvature of a fit, whose χ² counts as much
    as it is true."""
    free = np.flatnonzero(f.prior_sd > FROZEN)
    at = {key: value for key, (value, _) in problem.quantities(f.nuisance).items()}
    if not at or not len(free):
        return tuple(at), np.zeros((len(at), len(at)))
    precision = np.where(np.isfinite(f.prior_sd), 1.0 / np.square(f.prior_sd), 0.0)
    spread = np.linalg.pinv((f.gram / temper + np.diag(precision))[np.ix_(free, free)], hermitian=True)
    slopes: dict[str, FloatArray] = {key: np.zeros(len(free)) for key in at}
    for j, k in enumerate(free):
        step = STEP * float(np.sqrt(np.maximum(spread[j, j], 1e-300)))
        moved = f.nuisance.copy()
        moved[k] += step
        for key, (value, _) in problem.quantities(moved).items():
            if key in slopes:
                slopes[key][j] = (value - at[key]) / step
    rows = np.array(list(slopes.values()))
    return tuple(slopes), np.asarray(rows @ spread @ rows.T)
