"""Problems seen in part: only some of the rows, or recordings with a phase of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Candidate, Evaluation
from gap.inference.problem import Problem
from sim_devices.chain import FloatArray

PHASE = "phase"
"""Name of the parameter that says when a rhythm begins: nothing in one recording foretells it for another."""
COARSE, FINE = 40, 10
"""Phases that are tried over a whole turn, and then on either side of the best, between its neighbours."""


class _Part:
    """A problem of which only the evaluation is another."""

    sound: FloatArray | None = None
    resets: Sequence[float] = ()
    input_block = ""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.name, self.rows = problem.name, problem.rows
        self.measured, self.sigma, self.likelihood_powers = problem.measured, problem.sigma, problem.likelihood_powers
        self.prior_mean, self.prior_sd, self.prior_scales = problem.prior_mean, problem.prior_sd, problem.prior_scales
        self.sd_without_discrepancy, self.open_law = problem.sd_without_discrepancy, problem.open_law
        self.law_parameters = problem.law_parameters

    def start(self) -> FloatArray:
        return self.problem.start()

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> None:
        return None

    def under_simple_law(self, candidate: Candidate, unit: FloatArray) -> None:
        return None

    def lateness(self, fitted: Fit) -> None:
        return None

    def noise_scale(self, active: Active) -> FloatArray | None:
        return self.problem.noise_scale(active)

    def unwhitened(self, residual: FloatArray, active: Active) -> FloatArray:
        return self.problem.unwhitened(residual, active)

    def walk_log_bayes(self, fitted: Fit) -> float:
        return np.inf

    def belies(self, fitted: Fit) -> bool:
        return False

    def chance_log_bayes(self, fitted: Fit) -> float:
        return 0.0

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        return self.problem.quantities(nuisance)

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        return self.problem.evaluate(nuisance, active, want_jacobian)


class Masked(_Part):
    """A problem that sees only the rows ``keep`` (n,)."""

    def __init__(self, problem: Problem, keep: NDArray[np.bool_]) -> None:
        super().__init__(problem)
        self.keep = keep

    def noise_scale(self, active: Active) -> FloatArray | None:
        wider = self.problem.noise_scale(active)
        return None if wider is None else np.where(self.keep, wider, 1.0)

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        full = self.problem.evaluate(nuisance, active, want_jacobian)
        residual = np.where(self.keep, full.residual, 0.0)
        return Evaluation(residual, full.jacobian * self.keep[:, None] if want_jacobian else full.jacobian)


class OwnPhases(_Part):
    """A problem in which the effects' rhythms have phases of their own in some recordings: ``phases`` maps a
    recording's number to them, by effect."""

    def __init__(self, problem: Problem, phases: Mapping[int, Mapping[Candidate, float]]) -> None:
        super().__init__(problem)
        self.phases = phases

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        full = self.problem.evaluate(nuisance, active, want_jacobian)
        residual, jacobian = full.residual.copy(), full.jacobian.copy()
        for recording, own in self.phases.items():
            moved = {e: {**v, PHASE: own[e]} if e in own else v for e, v in active.items()}
            there = self.problem.evaluate(nuisance, moved, want_jacobian)
            at = self.rows.recording == recording
            residual[at] = there.residual[at]
            if want_jacobian:
                jacobian[at] = there.jacobian[at]
        return Evaluation(residual, jacobian)


def with_own_phases(problem: Problem, trained: Fit, out: NDArray[np.bool_]) -> Problem:
    """``problem`` in which each recording among the rows ``out`` (n,) has the phases that meet it best, all else as
    ``trained`` without them. Effects without a rhythm leave it as it is.

    An interval known to a thousandth is a whole turn off after a thousand looks.
    """
    rhythms = [e for e in trained.hypothesis if any(p.name == PHASE for p in e.parameters)]
    recordings = np.unique(problem.rows.recording[out]).tolist()
    active = trained.active
    phases = {k: {e: active[e][PHASE] for e in rhythms} for k in recordings}
    for effect in rhythms:
        low, high = next((p.low, p.high) for p in effect.parameters if p.name == PHASE)
        step = (high - low) / COARSE
        for moves in (step * np.arange(COARSE), step / FINE * np.arange(-FINE, FINE + 1)):
            begun = {k: own[effect] for k, own in phases.items()}
            tries = [{k: low + (at + move - low) % (high - low) for k, at in begun.items()} for move in moves]
            phases = _best_phases(problem, trained, phases, effect, tries)
    return OwnPhases(problem, phases) if rhythms else problem


def _best_phases(
    problem: Problem,
    trained: Fit,
    phases: dict[int, dict[Candidate, float]],
    effect: Candidate,
    tries: Sequence[Mapping[int, float]],
) -> dict[int, dict[Candidate, float]]:
    """``phases`` by recording and effect with those of one ``effect`` that meet each recording best, of ``tries``."""
    best, left = phases, dict.fromkeys(phases, np.inf)
    for at in tries:
        tried = {k: {**own, effect: at[k]} for k, own in phases.items()}
        residual = OwnPhases(problem, tried).evaluate(trained.nuisance, trained.active, want_jacobian=False).residual
        for k in phases:
            square = float(np.sum(np.square(residual[problem.rows.recording == k])))
            if square < left[k]:
                left[k], best = square, {**best, k: tried[k]}
    return best
