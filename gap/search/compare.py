"""The comparison of hypotheses on one case: screen every effect, refit the best, then pairs, each jointly with the
nuisance.

A case is one or several blocks (independent data with their own nuisance; for a suction instrument command ->
pressure and pressure -> height). A hypothesis changes only the blocks its effects touch, so the evidence of the
others is shared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np

from gap.data.noise import mean_correlation
from gap.inference.evidence import Fit, Hypothesis
from gap.inference.hypothesis import Candidate, to_unit, touched
from gap.inference.least_squares import fit, under
from gap.inference.linear import Projector
from gap.inference.problem import Problem
from gap.inference.workers import each
from gap.search.refits import belied, promise, refit
from gap.search.restarts import all_or_nothing, begun_anew, leaves_much_of
from gap.search.screening import Screened, as_if_known, from_sound, screen
from gap.search.starts import plain_start
from sim_devices.chain import FloatArray

ALIKE = 0.85
"""Cosine between the best effect's change and another's trace from which that one is refitted, too."""
SCATTERED = 3
"""Effects of chance at most that are refitted for their rank."""
FORMS = 2
"""Further forms of the best effect that are refitted."""
SPANNED, SPANNING = 0.97, 9
"""The same of a combination of an effect's traces, and of how many at most."""
HOPELESS = 4.0
"""Fall of χ² in the screening below which an effect is not refitted."""
LIMITS = 2
"""Effects that set in at a limit only which are begun from all over their priors, too."""

LEAST_TEMPER = 0.5
"""Share of the assumed variance of the noise that is believed at least: less may be a nuisance that followed it."""


@dataclass(frozen=True)
class Weight:
    """log ``evidence`` of a hypothesis over all blocks, up to a constant; and how far each block's is trusted."""

    evidence: float
    trust: Mapping[str, float]


@dataclass
class Comparison:
    """All hypotheses tried on a case, and their cost."""

    problems: dict[str, Problem]
    null: Hypothesis
    hypotheses: list[Hypothesis] = field(default_factory=list)
    screened: list[Screened] = field(default_factory=list)
    simulations: int = 0

    def weighed(self, temper: Mapping[str, float]) -> dict[int, Weight]:
        """The weight of every hypothesis by its `id`, each block and each width of its prior as far as trusted.

        Under one width hypotheses are compared as far as that width is trusted; the widths among each other as far as
        the narrowest is.
        """
        every = (self.null, *self.hypotheses)
        evidence = np.zeros(len(every))
        trust: list[dict[str, float]] = [{} for _ in every]
        for name, problem in self.problems.items():
            fits = {id(h.fits[name]): h.fits[name] for h in every}
            rows = {
                k: f.evidences(temper[name], problem.prior_scales) - problem.chance_log_bayes(f)
                for k, f in fits.items()
            }
            table = np.array([rows[id(h.fits[name])] for h in every])
            best, likelihood_powers = table.max(axis=0), np.asarray(problem.likelihood_powers)
            table = likelihood_powers[0] * (best - best.max()) + likelihood_powers * (table - best)
            evidence += np.logaddexp.reduce(table, axis=1)
            for h, width in zip(trust, np.argmax(table, axis=1), strict=True):
                h[name] = float(likelihood_powers[width])
        return {id(h): Weight(float(e), t) for h, e, t in zip(every, evidence, trust, strict=True)}

    def temper(self) -> dict[str, float]:
        """Per block: how much of χ² to believe, from the best hypothesis' own misfit and its correlation in time.

        1 when the best residual is white at the noise floor, less where the noise turns out to be less than assumed.
        Untempered evidence turns wrong as effects grow: the form error of the right effect is then worth hundreds of
        nats to a spurious one.
        """
        out = {}
        for name in self.problems:
            best = min((h.fits[name] for h in (self.null, *self.hypotheses)), key=lambda f: f.chi2)
            misfit = best.chi2 / max(len(best.residual) - len(best.nuisance), 1)
            correlation = mean_correlation(best.residual, self.problems[name].rows.recording)
            out[name] = max(misfit * correlation, LEAST_TEMPER)
        return out


def _refit_all(comparison: Comparison, parts: Sequence[tuple[Hypothesis, Screened]], jobs: int) -> None:
    """Add to the comparison each base with one effect more."""
    fitted = each(lambda part: refit(comparison.problems, *part), parts, jobs)
    for (base, screened), (fits, n) in zip(parts, fitted, strict=True):
        if not belied(comparison.problems, fits):
            comparison.hypotheses.append(Hypothesis((*base.effects, screened.candidate), base.fits | fits))
        comparison.simulations += n


@dataclass(frozen=True)
class Effort:
    """How wide the search is."""

    quick_fits: int = 10  # screened effects that get a few steps of a fit, where straight lines may mislead
    least_score: float = 8.0  # twice the nats, at any size, below which one gets none for being far from linear
    far_fits: int = 12  # at most so many get some for that, the most hopeful ones
    refit_singles: int = 9
    known_law: int = 4  # those that explain most if the law is a simple one, where the null says it is none
    imitators: int = 3  # of the best, that are refitted besides
    anew: int = 4  # of the best, that are begun from all over their priors where the best leaves much
    pair_bases: int = 2
    refit_pairs: int = 3  # second effects, of different names, for each of the bases
    pair_gain: float = 12.0  # tempered fall of χ² below which a second effect is not even refitted
    pair_evidence: float = 3.0  # nats that the best single effect must have earned

    def quicker(self) -> Effort:
        """A narrower search: few refits, no pairs."""
        return replace(
            self, quick_fits=4, refit_singles=4, known_law=0, imitators=0, anew=0, pair_bases=0, least_score=20.0
        )

    def shallower(self) -> Effort:
        """The same without pairs and further starts, for nuisance so flexible that each fit is long and that what it
        leaves is no effect's alone."""
        return replace(self, anew=0, pair_bases=0)


def compare(
    problems: Sequence[Problem],
    candidates: Sequence[Candidate],
    effort: Effort = Effort(),
    suspects: Sequence[Candidate] = (),
    jobs: int = 1,
    tell: Callable[[str, float], None] = lambda stage, share: None,
) -> Comparison:
    """Null, best singles and best pairs of ``candidates`` on ``problems``, by ``jobs`` processes; ``suspects`` are
    refitted wherever they rank. ``tell`` hears the name of each stage, and which share of
    a diagnosis is usually over when it begins."""
    blocks = {p.name: p for p in problems}
    tell("fitting the simulation by itself", 0.22)
    fits = {name: fit(p, iterations=60, tolerance=1e-5) for name, p in blocks.items()}
    comparison = Comparison(blocks, Hypothesis((), fits), simulations=sum(f.simulations for f in fits.values()))
    usable = [c for c in candidates if set(c.blocks) <= set(blocks)]
    tell(f"screening {len(usable)} effects", 0.25)
    comparison.screened, n = screen(
        blocks, comparison.null, usable, (), effort.quick_fits, jobs, effort.least_score, effort.far_fits
    )
    comparison.simulations += n
    chosen = _shortlist(comparison.screened, effort.refit_singles)
    apart, n = from_sound(blocks, comparison.null, comparison.screened)
    comparison.simulations += n
    known, n = as_if_known(blocks, comparison.screened, effort.known_law, jobs)
    comparison.simulations += n
    apart += known
    chosen += [s for s in comparison.screened if (s.sure or s.candidate in suspects or s in apart) and s not in chosen]
    tell(f"fitting the {len(chosen)} most promising effects", 0.55)
    _refit_all(comparison, [(comparison.null, s) for s in chosen], jobs)
    others = _imitators(comparison, [s for s in comparison.screened if s not in chosen])
    chosen += others[: effort.imitators]
    _refit_all(comparison, [(comparison.null, s) for s in others[: effort.imitators]], jobs)
    if effort.imitators:
        _refit_all(comparison, [(comparison.null, s) for s in _other_forms(comparison, chosen)], jobs)
        _fit_again(comparison, _extending(comparison), jobs)
    _begin_anew(comparison, effort.anew, jobs)
    _finish_null(comparison)
    tell("trying pairs of effects", 0.73)
    _pairs(comparison, usable, effort, jobs)
    one_of_two(comparison, jobs)
    return comparison


def _finish_null(comparison: Comparison) -> None:
    """Fit the null again from where the effects' fits ended, and under the laws that these ended with: one that stopped
    early, or has not found a simple law that does, would give them nats they have not earned."""
    for block, problem in comparison.problems.items():
        null = comparison.null.fits[block]
        others = [h.fits[block] for h in comparison.hypotheses if h.fits[block] is not null]
        nearest = [min(others, key=by) for by in (attrgetter("chi2"), attrgetter("objective")) if others]
        likely = [max(others, key=lambda f: promise(f, problem))] if others else []
        tries = [(problem, start) for start in (null, *nearest)]
        tries += [(under(problem, start.prior_mean, start.prior_sd), start) for start in (*nearest, *likely)]
        for looked, start in tries:
            again = fit(looked, nuisance=start.nuisance, iterations=40, tolerance=1e-5)
            comparison.simulations += again.simulations
            if promise(again, problem) > promise(comparison.null.fits[block], problem):
                comparison.null.fits[block] = again
    for h in comparison.hypotheses:
        for block in comparison.problems.keys() - touched(h.effects):
            h.fits[block] = comparison.null.fits[block]


def _shortlist(screened: Sequence[Screened], size: int) -> list[Screened]:
    """The best, no more than two forms of one concept, and few that are by chance: every concept near the top gets its
    chance, and wider noise takes the place of any response that is not understood yet.

    Effects that the linear screening sees no use in (below `HOPELESS`) are left, but the first three always go.
    """
    out: list[Screened] = []
    for s in screened:
        if len(out) >= 3 and s.gain < HOPELESS:
            break
        if s.by_chance and sum(o.by_chance for o in out) >= SCATTERED:
            continue
        if sum(o.candidate.name == s.candidate.name for o in out) < 2:
            out.append(s)
        if len(out) == size:
            break
    return out


def _imitators(comparison: Comparison, others: Sequence[Screened]) -> list[Screened]:
    """Those of the ``others``, one of each name, whose traces point where the best effect's change does, beside the
    nuisance; the most alike first. Along a straight line from the null a slow or bent effect may look useless.
    """
    if not comparison.hypotheses:
        return []
    weight = comparison.weighed(comparison.temper())
    best = max(comparison.hypotheses, key=lambda h: weight[id(h)].evidence)
    projectors = {b: Projector(f.jacobian, f.prior_sd) for b, f in comparison.null.fits.items()}
    ways = [_Way.of(changes, projectors) for changes in _changes(comparison, best)]
    found: dict[str, Screened] = {}  # one of each name
    for alike, s in sorted(((max(w.likeness(s) for w in ways), s) for s in others), key=lambda pair: -pair[0]):
        if alike > ALIKE:
            found.setdefault(s.candidate.name, s)
    return list(found.values())


def _changes(comparison: Comparison, best: Hypothesis) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """The ``best`` effect's change of each block, as it was refitted and by itself: where a tolerance had taken the
    effect on, the refit changes the tolerance and no residual."""
    refitted, alone = {}, {}
    for block, before in comparison.null.fits.items():
        fitted = best.fits[block]
        refitted[block] = before.residual - fitted.residual
        active = comparison.problems[block].evaluate(before.nuisance, fitted.active, want_jacobian=False)
        alone[block] = before.residual - active.residual
    return refitted, alone


@dataclass(frozen=True)
class _Way:
    """A change of the residuals, ``seen`` beside the nuisance, and its ``size`` there."""

    seen: Mapping[str, FloatArray]
    size: float
    projectors: Mapping[str, Projector]

    @classmethod
    def of(cls, changes: Mapping[str, FloatArray], projectors: Mapping[str, Projector]) -> _Way:
        seen = {b: projectors[b].apply(change) for b, change in changes.items()}
        return cls(seen, float(np.sqrt(max(sum(float(v @ changes[b]) for b, v in seen.items()), 0.0))), projectors)

    def likeness(self, s: Screened) -> float:
        """The cosine of a screened effect's traces with the change, at most. A shape between or beyond those that were
        screened may be more alike: of few of them the best combination counts, if it is nearly the change."""
        if self.size < 1.0:  # of the size of the noise: it points nowhere
            return 0.0
        along = sum((self.seen[b] @ traces for b, traces in s.traces.items()), np.zeros(len(s.units)))
        lengths = np.array([length for _, length in s.detectability])
        alone = float(np.max(along / np.maximum(lengths * self.size, 1e-9), initial=0.0))
        if s.candidate.event or not 1 < len(s.units) <= SPANNING:
            return alone
        gram = sum((t.T @ self.projectors[b].apply(t) for b, t in s.traces.items()), np.zeros((len(along), len(along))))
        spanned = float(along @ np.linalg.pinv(gram, rcond=1e-4, hermitian=True) @ along)
        together = float(np.sqrt(max(spanned, 0.0))) / max(self.size, 1e-9)
        return max(alone, together) if together > SPANNED else alone


def _other_forms(comparison: Comparison, chosen: Sequence[Screened]) -> list[Screened]:
    """Forms of the best effect that were not ``chosen`` yet: others would repair the rest that a near form leaves."""
    weight = comparison.weighed(comparison.temper())
    best = max(comparison.hypotheses, key=lambda h: weight[id(h)].evidence, default=None)
    if best is None or weight[id(best)].evidence <= weight[id(comparison.null)].evidence:
        return []
    name = best.effects[0].name
    return [s for s in comparison.screened if s.candidate.name == name and s not in chosen][:FORMS]


def _extending(comparison: Comparison) -> list[Screened]:
    """Effects that become the best one in a limit of their parameters, to be fitted from where that is."""
    weight = comparison.weighed(comparison.temper())
    best = max(comparison.hypotheses, key=lambda h: weight[id(h)].evidence, default=comparison.null)
    if len(best.effects) != 1:
        return []
    known, out = best.values(best.effects[0]), []
    for s in comparison.screened:
        if best.effects[0].name in s.candidate.extends:
            unit = plain_start(s.candidate)
            for k, p in enumerate(s.candidate.parameters):
                unit[k] = to_unit(p, known[p.name]) if p.name in known else unit[k]
            out.append(replace(s, starts={b: (unit,) for b in s.starts}))
    return out[:FORMS]


def _begin_anew(comparison: Comparison, most: int, jobs: int) -> None:
    """Where the best effect leaves much, fit ``most`` of those of several parameters from elsewhere, too, and `LIMITS`
    of those that set in at a limit, wherever they rank."""
    weight = comparison.weighed(comparison.temper())
    ranked = sorted(comparison.hypotheses, key=lambda h: -weight[id(h)].evidence)
    left = leaves_much_of(ranked[0], comparison.problems) if most and ranked else set()
    if not left:
        return
    parts = _of_several_parameters(comparison, ranked)[:most]
    parts += _of_a_limit(comparison, left, [s for _, s in parts])[:LIMITS]
    looked = each(lambda part: begun_anew(*part, comparison.problems), parts, jobs)
    comparison.simulations += sum(n for _, n in looked)
    _fit_again(comparison, [s for s, _ in looked], jobs)


def _of_several_parameters(comparison: Comparison, ranked: Sequence[Hypothesis]) -> list[tuple[Hypothesis, Screened]]:
    """Those of the ``ranked`` hypotheses whose effect has several parameters and is no chance and no event."""
    known = {s.candidate: s for s in comparison.screened if not (s.by_chance or s.candidate.event)}
    firsts = [(h, h.effects[0]) for h in ranked]
    return [(h, known[e]) for h, e in firsts if e in known and len(e.parameters) > 1]


def _of_a_limit(comparison: Comparison, left: set[str], begun: Sequence[Screened]) -> list[tuple[Hypothesis, Screened]]:
    """Screened effects that set in at a limit, on one of the blocks ``left``, beside the null; not those ``begun``: a
    fit does not lead from where a limit is met nowhere to where it is met."""
    others = [s for s in comparison.screened if not (s.by_chance or s.candidate.event or s in begun)]
    return [(comparison.null, s) for s in others if left & set(s.candidate.blocks) and all_or_nothing(s)]


def _fit_again(comparison: Comparison, parts: Sequence[Screened], jobs: int) -> None:
    """Fit single effects from other starts; they count where they are new, or explain more than before."""
    fitted = each(lambda s: refit(comparison.problems, comparison.null, s), parts, jobs)
    for s, (fits, n) in zip(parts, fitted, strict=True):
        comparison.simulations += n
        if belied(comparison.problems, fits):
            continue
        known = next((h for h in comparison.hypotheses if h.effects == (s.candidate,)), None)
        if known is None:
            comparison.hypotheses.append(Hypothesis((s.candidate,), comparison.null.fits | fits))
        elif _earned(fits, comparison.problems) > _earned({b: known.fits[b] for b in fits}, comparison.problems):
            known.fits.update(fits)


def _earned(fits: Mapping[str, Fit], problems: Mapping[str, Problem]) -> float:
    """log evidence of fits, a block each, as far as the noise is believed wholly."""
    return sum(promise(f, problems[b]) for b, f in fits.items())


def _pairs(comparison: Comparison, candidates: Sequence[Candidate], effort: Effort, jobs: int) -> None:
    temper = comparison.temper()
    weight = comparison.weighed(temper)
    earned = {id(h): weight[id(h)].evidence - weight[id(comparison.null)].evidence for h in comparison.hypotheses}
    ranked = sorted(comparison.hypotheses, key=lambda h: -earned[id(h)])
    singles = ranked[: effort.pair_bases]
    if not singles or earned[id(singles[0])] < effort.pair_evidence:
        return
    # Wider noise takes on any response that is not understood yet, and hides it from a second effect.
    by_chance = {s.candidate for s in comparison.screened if s.by_chance}
    if by_chance.issuperset(h.effects[0] for h in singles):
        singles += [h for h in ranked if h.effects[0] not in by_chance][:1]
    tried: set[frozenset[str]] = set()
    parts = []
    for base in singles:
        others = [c for c in candidates if c.name != base.effects[0].name]
        screened, n = screen(comparison.problems, base, others, comparison.screened)
        comparison.simulations += n
        seconds: dict[str, Screened] = {}
        for s in screened:
            if s.gain / max(temper[b] for b in s.candidate.blocks) >= effort.pair_gain:
                seconds.setdefault(s.candidate.name, s)
        for s in list(seconds.values())[: effort.refit_pairs]:
            together = frozenset((base.effects[0].key, s.candidate.key))
            if together not in tried:
                tried.add(together)
                parts.append((base, s))
    _refit_all(comparison, parts, jobs)


def one_of_two(comparison: Comparison, jobs: int = 1) -> None:
    """Fit each effect of a pair that is more probable than any single one by itself, from where the pair has it: its
    own fit may have ended elsewhere, as an interval has an optimum near each of its multiples, and the other effect
    hardly act."""
    weight = comparison.weighed(comparison.temper())
    pair = max(comparison.hypotheses, key=lambda h: weight[id(h)].evidence, default=comparison.null)
    if len(pair.effects) > 1:
        own = [s for s in comparison.screened if s.candidate in pair.effects]
        parts = [replace(s, starts={b: (pair.fits[b].told(s.candidate)[0],) for b in s.starts}) for s in own]
        _fit_again(comparison, parts, jobs)
