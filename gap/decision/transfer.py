"""How far the gap shrinks on data that were not used: other repeats, levels, directions and, above all, other
waveforms.

A wrong effect can shrink the gap on the fitted data and their repeats almost as well as the right one; on another
waveform it cannot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.recording.model import Recording
from gap.data.labels import direction, level
from gap.inference.evidence import Belief, Fit, Hypothesis
from gap.inference.hypothesis import Active, Candidate, Evaluation
from gap.inference.least_squares import fit, under
from gap.inference.problem import Problem
from gap.inference.workers import each
from sim_devices.chain import FloatArray

SHOWS = 1.02
"""Gap of recordings below which there is nothing in them to shrink."""
KNOWN = 1e10
"""Precision of an effect's parameters, in prior quantiles, that are as good as given."""


@dataclass(frozen=True)
class Shrink:
    """rms of the whitened residual on the withheld rows before and after, strained tolerances included as in
    `plain_gap`; shrink = (before − after)/(before − 1)."""

    before: float
    after: float

    @property
    def value(self) -> float:
        return shrink(self.before, self.after)

    @property
    def shows(self) -> bool:
        """Whether there is anything to shrink or to grow."""
        return max(self.before, self.after) > SHOWS


def shrink(before: float, after: float, floor: float = 1.0) -> float:
    """(before − after)/(before − floor); 0 where nothing stood above the floor."""
    return float((before - after) / (before - floor)) if before > floor * 1.0001 else 0.0


class _Masked:
    """A problem that sees only some of its rows."""

    sound: FloatArray | None = None
    resets: Sequence[float] = ()

    def __init__(self, problem: Problem, keep: NDArray[np.bool_]) -> None:
        self.problem, self.keep = problem, keep
        self.name, self.rows = problem.name, problem.rows
        self.measured, self.sigma, self.trusts = problem.measured, problem.sigma, problem.trusts
        self.prior_mean, self.prior_sd, self.alternatives = problem.prior_mean, problem.prior_sd, problem.alternatives
        self.plain_sd = problem.plain_sd

    def start(self) -> FloatArray:
        return self.problem.start()

    def anchored(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> None:
        return None

    def lateness(self, fitted: Fit) -> None:
        return None

    def widening(self, active: Active) -> FloatArray | None:
        wider = self.problem.widening(active)
        return None if wider is None else np.where(self.keep, wider, 1.0)

    def unlike(self, fitted: Fit) -> float:
        return 0.0

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        full = self.problem.evaluate(nuisance, active, want_jacobian)
        residual = np.where(self.keep, full.residual, 0.0)
        return Evaluation(residual, full.jacobian * self.keep[:, None] if want_jacobian else full.jacobian)


def waveform(recording: Recording) -> str:
    """``step``, ``ramp``, ``cyclic`` or ``path`` of the first set-point that moves; "-" without one."""
    for series in recording.setpoints.values():
        value, time = np.asarray(series.value, dtype=float), np.asarray(series.time, dtype=float)
        span = float(np.ptp(value)) if len(value) > 1 else 0.0
        if span == 0:
            continue
        grid = np.linspace(time[0], time[-1], 4000)
        v = np.interp(grid, time, value)
        rate = np.abs(np.diff(v)) / (span * (grid[1] - grid[0]))
        middle = np.diff((np.abs(v) > 0.5 * float(np.max(np.abs(v)))).astype(int))
        loadings = int(np.sum(middle > 0)) + int(np.abs(v[0]) > 0.5 * float(np.max(np.abs(v))))
        ramping = float(np.mean((rate > 1e-3) & (rate < 2.0)))
        shape = "ramp" if ramping > 0.15 else "step"
        return f"{shape}, cyclic" if loadings > 1 else shape
    return "-"


def splits(recordings: Sequence[Recording]) -> dict[str, set[int]]:
    """Which recordings to withhold, for each kind of split that the session allows."""
    keys: dict[str, Callable[[Recording], str]] = {"level": level, "direction": direction, "waveform": waveform}
    out: dict[str, set[int]] = {}
    for name, key in keys.items():
        groups: dict[str, set[int]] = {}
        for k, r in enumerate(recordings):
            groups.setdefault(key(r), set()).add(k)
        if len(groups) > 1:
            # Withhold the smaller part, but never the top level: that would be extrapolation.
            ordered = sorted(groups.items(), key=lambda kv: (len(kv[1]), kv[0]))
            out[name] = ordered[0][1] if name != "level" else sorted(groups.items(), key=_leading_number)[0][1]
    conditions: dict[tuple[str, str, str], list[int]] = {}
    for k, r in enumerate(recordings):
        conditions.setdefault((level(r), direction(r), waveform(r)), []).append(k)
    repeats = {members[-1] for members in conditions.values() if len(members) > 1}
    if repeats and len(repeats) < len(recordings):
        out["repeat"] = repeats
    return out


SAME = 0.02
"""Difference of two commands, in parts of their range or duration, below which they are the same."""


def splits_of_a_rig(recordings: Sequence[Recording]) -> dict[str, set[int]]:
    """The same for a rig that is not ours, where only what was commanded tells a repeat from another waveform.

    Without set-points nobody knows which it is: the last recording is withheld as just that, a ``recording``.
    """
    if len(recordings) < 2:
        return {}
    if not all(any(len(s.time) > 1 for s in r.setpoints.values()) for r in recordings):
        return {"recording": {len(recordings) - 1}}
    kinds: list[list[int]] = []
    for k, r in enumerate(recordings):
        like = next((kind for kind in kinds if _same_command(recordings[kind[0]], r)), None)
        if like is None:
            kinds.append([k])
        else:
            like.append(k)
    rare = min(range(len(kinds)), key=lambda k: (len(kinds[k]), -k))
    out = {"waveform": set(kinds[rare])} if len(kinds) > 1 else {}
    repeats = {kind[-1] for kind in kinds if len(kind) > 1}
    return {**out, "repeat": repeats} if repeats else out


def _same_command(one: Recording, other: Recording) -> bool:
    if set(one.setpoints) != set(other.setpoints):
        return False
    share = np.linspace(0.0, 1.0, 1000)
    for name, a in one.setpoints.items():
        b = other.setpoints[name]
        durations = [float(s.time[-1] - s.time[0]) for s in (a, b)]
        values = [np.interp(s.time[0] + share * d, s.time, s.value) for s, d in zip((a, b), durations, strict=True)]
        span = max(np.ptp(values), 1e-300)
        if abs(durations[0] - durations[1]) > SAME * max(durations):
            return False
        if np.sqrt(np.mean(np.square(values[0] - values[1]))) > SAME * span:
            return False
    return True


def _leading_number(item: tuple[str, set[int]]) -> float:
    try:
        return float(item[0].split()[0].rstrip("°").split("°")[0])
    except ValueError:
        return 0.0


def plain(problems: Mapping[str, Problem], h: Hypothesis, null: Hypothesis | None = None) -> Hypothesis:
    """A hypothesis as a simulation by itself: refitted without the discrepancy that skin of another law may have.

    That is the simulation people have, and its gap the one they see. ``null`` is the plain null, whose fits serve for
    blocks that the effects do not touch.
    """
    touched = {b for e in h.effects for b in e.blocks}
    fits = {}
    for block, f in h.fits.items():
        problem = problems[block]
        if null is not None and block not in touched:
            fits[block] = null.fits[block]
        elif np.array_equal(problem.plain_sd, f.prior_sd):
            fits[block] = f
        else:
            nuisance = np.where(problem.plain_sd < f.prior_sd, f.prior_mean, f.nuisance)
            here = under(problem, f.prior_mean, problem.plain_sd)
            fits[block] = fit(here, f.hypothesis, f.unit, nuisance, iterations=15, belief=f.belief)
    return Hypothesis(h.effects, fits)


def plain_gap(h: Hypothesis) -> float:
    """rms in σ of a plain hypothesis' residual, tolerances that are strained included: 1 at the noise floor, which
    effects of chance widen."""
    n = sum(len(f.residual) for f in h.fits.values())
    return float(np.sqrt(sum(f.chi2 + f.penalty for f in h.fits.values()) / n))


def transferred(
    problems: Mapping[str, Problem],
    null: Hypothesis,
    answers: Sequence[Hypothesis],
    withheld: Mapping[str, set[int]],
    jobs: int = 1,
) -> list[dict[str, Shrink]]:
    """For each of the ``answers`` and each split: fit it without the ``withheld`` recordings, hold what that says of
    the effect, and see how well these can be met with it; before, how well they can be met without.

    Only the effect has to carry over: tissue and calibration are fitted to the withheld recordings, too, as whether a
    person's skin follows our law to another waveform is not the effect's doing.
    """
    outs = {(s, b): np.isin(p.rows.recording, list(out)) for s, out in withheld.items() for b, p in problems.items()}
    outs = {key: out for key, out in outs.items() if out.any() and not out.all()}
    square = {(id(null), *key): _left(null.fits[key[1]], out) for key, out in outs.items()}
    touched = [{b for e in answer.effects for b in e.blocks} for answer in answers]
    parts = [(h, s, b) for h, blocks in zip(answers, touched, strict=True) for s, b in outs if b in blocks]
    left = each(lambda part: _carried(problems[part[2]], part[0].fits[part[2]], outs[part[1:]]), parts, jobs)
    square |= {(id(h), s, b): x for (h, s, b), x in zip(parts, left, strict=True)}

    def shrunk(answer: Hypothesis, split: str) -> Shrink:
        keys = [key for key in outs if key[0] == split]
        n = sum(np.count_nonzero(outs[key]) for key in keys)
        if not n:
            return Shrink(1.0, 1.0)
        before = sum(square[id(null), *key] for key in keys)
        after = sum(square.get((id(answer), *key), square[id(null), *key]) for key in keys)
        return Shrink(float(np.sqrt(before / n)), float(np.sqrt(after / n)))

    return [{split: shrunk(answer, split) for split in withheld} for answer in answers]


def _left(f: Fit, out: NDArray[np.bool_]) -> float:
    """χ² of a fit on the rows ``out`` (n,), with their share of what tolerances are strained by."""
    return float(f.residual[out] @ f.residual[out]) + (f.penalty - f.belief.cost(f.unit)) * float(np.mean(out))


def _carried(problem: Problem, full: Fit, out: NDArray[np.bool_]) -> float:
    """`_left` with an effect whose parameters are fitted without the rows ``out`` (n,), and all else with them."""
    problem = under(problem, full.prior_mean, full.prior_sd)
    masked = _Masked(problem, ~out)
    trained = fit(
        masked, full.hypothesis, full.unit, full.nuisance, iterations=5, jacobian=full.jacobian * ~out[:, None],
        belief=full.belief,
    )  # fmt: skip
    known = Belief(trained.unit, KNOWN * np.eye(len(trained.unit)))
    held = fit(
        problem, full.hypothesis, trained.unit, full.nuisance, iterations=8, jacobian=full.jacobian, gram=full.gram,
        belief=known,
    )  # fmt: skip
    return _left(held, out)
