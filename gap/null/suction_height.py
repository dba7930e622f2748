"""Recorded pressure -> apex height of a suction instrument.

The block is fed with the *smoothed* recorded pressure (raw gauge noise would imitate friction and preload) and meets
the tissue. Which law a person's skin has, nobody knows: simple ones are tried first, with an elastic curve of three
parameters and two creep times or a power law of time, or nonlinear ones (`gap.null.skin_laws`); then four creep
times under any elastic curve; then, beside these, a discrepancy that other laws could leave
(`gap.null.suction_discrepancy`), so that only a change beyond any tissue is a device effect. A less simple law
must earn its freedom (`Problem.prior_scales`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from gap.data.rhythms import in_common
from gap.inference.evidence import Fit
from gap.inference.hypothesis import FROZEN, Active, Candidate, Evaluation, Start
from gap.inference.least_squares import fit, under
from gap.inference.linear import compressed
from gap.inference.workers import each
from gap.null.blocks import SIMPLE_SHIFT
from gap.null.chains import Kept
from gap.null.groups import Group, GroupedSession
from gap.null.skin_laws import BASIC, CREEP, FURTHER, PARTS, USUAL, Part, SkinLaw, guesses, rewired, switched
from gap.null.skin_tries import Alone, Try, probability
from gap.null.suction_discrepancy import USUAL_MEMORY, Suction, elastic_freedom, suction_discrepancy
from gap.null.suction_feed import FedBlock
from gap.null.suction_line import chain_of
from gap.null.suction_pressure import PressureBlock
from gap.null.suction_skin import Loaded
from protocols.specimens import SPECIMENS
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages.tissues import SuctionTissue, suction_tissue

ENOUGH = 1.05
"""χ² per sample of a law at which nothing less simple is tried."""
LATELY = 4
"""Skins that are kept: effects are tried on the same one by the hundred."""
TISSUE_STEP = 1e-3
"""Of the tissue's parameters, for differences."""
QUICK = 10
"""Steps of a fit after which its evidence, which looks ahead along a straight line, says where it leads."""
SHORT, FEW, NOISE = 6, 4, 12
"""Steps of a fit with an effect, of one that only tells whether a simple law does with it, of one for its rest."""
FAR = 4.0
"""χ² per sample of the best law from which on fits with an effect begin anew under every basic one."""
ANSWER = 0.15
"""s after a kink of the command within which a record at 25 Hz may jump as it should."""
SAME = 0.02
"""s within which recordings jump equally late."""
TAKEN = 300.0
"""Nats by which a law that is not linear may be better and still have taken on an effect (of δ 25)."""


class HeightBlock(FedBlock):
    """Recorded pressure -> apex height.

    Nuisance: the reduced tissue's parameters; per recording a gain (the skin's scatter from run to run), a zero and
    another before suction begins; the sampling convention; the elastic curve; the discrepancy of tissue laws. Gains
    are logarithms, as the compliance is: the two make up for each other along a straight line, which a fit finds.
    """

    name, channels = "height", ("apex_height",)
    open_law = True
    jobs = 1  # processes that share the fits of `start`
    trust = 0.2  # other laws of tissue leave what some device effect can repair: 5 nats in the worst of 26 sessions
    trust_simple = 0.25  # of a simple law, where the data prefer it
    PARTS: ClassVar[Mapping[str, Part]] = PARTS
    SIMPLE_LAWS: ClassVar[Sequence[SkinLaw]] = BASIC
    FURTHER_LAWS: ClassVar[Sequence[SkinLaw]] = FURTHER
    USUAL_LAW: ClassVar[SkinLaw] = USUAL
    SIMPLE_CURVE = 1e-3  # of the elastic curve's freedom, under a simple law
    GAIN_SD = 0.05
    ZERO_SD = 0.01  # of the largest height: skin still recovers while the instrument takes its zero
    CURVE_SD = 0.1  # of the largest height, per elastic curve
    DISCREPANCY_SD = 0.02  # of the height, per basis function of weight 1
    DISCREPANCY_SCALES = (0.001, 0.03, 0.1, 0.3, 1.0, 3.0)  # the first: a law that is known but for its parameters
    DISCREPANCY_SIZE = 100

    def __init__(
        self, session: GroupedSession, library: Mapping[str, Effect], pressure: PressureBlock | None = None
    ) -> None:
        super().__init__(session, library, pressure, without=tuple(SPECIMENS))
        if session.of_height is not None:
            self.row_noise.alike(session.of_height)
        self._tissue = suction_tissue("forearm")
        strongest = (-float(p.min()) for (g, _), (_, p) in zip(self.groups, self._line, strict=True) if g.skin)
        self.strongest = max(strongest, default=0.0) or 1e3  # Pa; without skin any will do
        self._runs = self.member
        self._onsets = np.array([self.session.onset(k) for k in self.runs])
        self._skins = Kept(LATELY)
        self._start: FloatArray | None = None
        self._tries: list[Try] = []
        self._size = 1.0
        self._span = size = max(float(np.ptp(self.measured)), 10 * float(np.median(self.sigma)))
        # Whether a reading is zeroed when it begins, at the first suction or at both, instruments do not agree.
        zeros = np.hstack([self._runs, self._runs * (self.stamps[:, None] < self._onsets)])
        curves = self._by_group(elastic_freedom, USUAL_MEMORY)[0]
        columns, weights = compressed(*self._by_group(suction_discrepancy), self.DISCREPANCY_SIZE)
        self._added = np.hstack([zeros, curves * size, columns * size])
        n, r, z = len(self.PARTS) + 1, self._runs.shape[1], zeros.shape[1]
        self._curve_part = slice(n + r + z, n + r + z + curves.shape[1])
        zero = float(np.hypot(self.noise[0], self.ZERO_SD * size))
        free = [size if session.begins_under_suction(k) else max(zero, self.read_at_rest(k)) for k in self.runs]
        own = [self.shift_sd, *[self.GAIN_SD] * r, *free, *[zero] * (z - r), *[self.CURVE_SD] * curves.shape[1]]
        tissue_sd = [part.sd for part in self.PARTS.values()]
        self.prior_sd = np.concatenate([tissue_sd, own, self.DISCREPANCY_SD * weights])
        self.prior_mean = np.zeros(len(self.prior_sd))
        later = self.prior_mean.copy()
        later[: n - 1] = self._first_guess()[:-1]
        earlier = later.copy()
        later[n - 1], earlier[n - 1] = 1e-3, -1e-3
        self.blur_steep_parts((self._chain_height(later, {}) - self._chain_height(earlier, {})) / 2e-3)
        end = self._curve_part.stop  # where the discrepancy begins; without skin it is empty
        self._widths = [np.concatenate([self.prior_sd[:end], self.prior_sd[end:] * s]) for s in self.DISCREPANCY_SCALES]
        self.prior_mean = self._mean(self.USUAL_LAW)
        self.laws = tuple(self.SIMPLE_LAWS)  # simple ones of `prior_scales`, the most probable first
        self.prior_scales = self._priors()

    @cached_property
    def resets(self) -> Sequence[float]:
        """Times (s) after the beginning of suction at which several recordings jump, and nothing was commanded."""
        late, kinks = [], self.session.kinks
        for k, recording in enumerate(self.session.recordings):
            if self.channels[0] not in recording.streams:
                continue
            at = self.session.breaks(self.channels[0], k)
            before = kinks[np.maximum(np.searchsorted(kinks, at) - 1, 0)]
            late += (at[at > before + ANSWER] - self.session.onset(k)).tolist()
        return in_common([delay for delay in late if delay > 0], SAME)

    def breaks(self, k: int) -> Sequence[float]:
        return [self.session.onset(k) + delay for delay in self.resets]

    def _priors(self) -> tuple[FloatArray, ...]:
        """Prior widths (p,) of the simple laws, and of the usual one beside each size of the discrepancy."""
        simple = [self._sd(self._widths[0], law) for law in self.laws]
        return (*simple, *(self._sd(sd, self.full) for sd in self._widths))

    @property
    def full(self) -> SkinLaw:
        """The usual law, with the nonlinear parts of this skin."""
        return self.USUAL_LAW.beside(self.laws[0].nonlinear)

    def _sd(self, sd: FloatArray, law: SkinLaw) -> FloatArray:
        """Prior widths ``sd`` (p,), nought for parts that a law lacks; a simple one has an elastic curve of three
        parameters and a channel that neither holds nor integrates."""
        out = sd.copy()
        out[np.flatnonzero([not law.frees(part) for part in self.PARTS.values()])] = FROZEN
        if law.simple:
            out[len(self.PARTS)] = SIMPLE_SHIFT
            out[self._curve_part] *= self.SIMPLE_CURVE
        return out

    def widths_of(self, law: SkinLaw) -> tuple[FloatArray, ...]:
        """Prior widths (p,) of a law, by itself if it is simple, and beside each size of the discrepancy."""
        alone = [self._sd(self._widths[0], law)] if law.simple else []
        return (*alone, *(self._sd(sd, self.USUAL_LAW.beside(law.nonlinear)) for sd in self._widths))

    def _mean(self, law: SkinLaw) -> FloatArray:
        """The prior's mean (p,) under a law: of each amount none."""
        mean = np.zeros(len(self.prior_sd))
        mean[: len(self.PARTS)] = [0.0 if p.of == name else p.begin for name, p in self.PARTS.items()]
        return switched(self.PARTS, mean, law)

    def _by_group(
        self, basis: Callable[..., tuple[FloatArray, FloatArray]], *more: Any
    ) -> tuple[FloatArray, FloatArray]:
        """A basis (n, q) over all groups, nought where there is no skin, and its weights (q,)."""
        parts, weights = [], np.zeros(0)
        guess = self._chain_height(self._first_guess(), {})
        marks = np.array([self.session.span(k)[0] for k in self.runs])
        for (g, at), (t, p) in zip(self.groups, self._line, strict=True):
            columns, weights = basis(Suction(t, p, guess[at], self.stamps[at], marks, self._onsets), *more)
            parts.append(columns * float(g.skin))
        return np.vstack(parts), weights

    @property
    def _at(self) -> Loaded:
        return Loaded(self._tissue, self._size, self.strongest)

    def tissue(self, nuisance: FloatArray) -> SuctionTissue:
        """The reduced tissue at a nuisance vector."""
        return self._at.tissue(self._named(nuisance))

    def _named(self, nuisance: FloatArray) -> dict[str, float]:
        """The skin's parameters in a nuisance vector, by name."""
        return dict(zip(self.PARTS, nuisance.tolist(), strict=False))

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        return self._at.quantities(self._named(nuisance))

    def start(self) -> FloatArray:
        """The simulation by itself, fitted alone; the tissue's parameters are then the prior's mean.

        Beside a free discrepancy, which can do all that they do and linearly, they would run away.
        """
        if self._start is None:
            self._know_noise()
            found, law = self._best_alone()
            self._bend(found.nuisance)
            self._start = self._alone((), np.zeros(0), [Try(law, found.nuisance, 30)])[0][0].nuisance
            self._hold(self.prior_mean, self._start)
            warm_start = [part.warm_start for part in self.PARTS.values()]
            for sd in (self.prior_sd, *self._widths):
                sd[: len(warm_start)] = np.minimum(sd[: len(warm_start)], warm_start)
            self.prior_scales = self._priors()
            self.prior_sd = fit(self, nuisance=self._start).best_prior(self.prior_scales)
        return self._start.copy()

    def _know_noise(self) -> None:
        """Take the slow noise, where no reference told it, from what the usual law beside a discrepancy leaves."""
        if self.row_noise.memory is None:
            usual = under(self, self.prior_mean, self._sd(self._widths[-1], self.full))
            self.remember(fit(usual, nuisance=self._guesses()[0], iterations=NOISE))

    def _best_alone(self) -> Alone:
        """The most probable of all laws, fitted alone: basic ones, further ones where these are not at the noise, the
        usual one where none is. From it follow `laws`, and the laws tried when effects are fitted.

        Fits begin from slower and quicker skin too: creep times have local optima.
        """
        begins = self._guesses()
        entered = {law: begins if law.timed else begins[:1] for law in self.SIMPLE_LAWS}
        alone = [found for law, its in entered.items() for found in self._race([(law, g) for g in its])]
        basic = max(alone, key=probability)
        if not self._enough(alone):
            alone += self._race([(law, begins[0]) for law in self.FURTHER_LAWS], 2)
        simple, best = max(alone, key=probability)
        self.laws = tuple(dict.fromkeys([best, *(law.beside(best.nonlinear) for law in self.SIMPLE_LAWS)]))
        self._tries = self._beside_an_effect((simple, best), basic, begins[0])
        if not self._enough(alone):
            self._bend(simple.nuisance)
            alone += self._race([(self.full, g) for g in (simple.nuisance, *begins)])
        found, law = max(alone, key=probability)
        if not law.simple:
            self._tries.append(Try(law, begins[0], 15))
        if found.chi2 > FAR * len(self.measured):  # which law it is, such a fit does not tell
            self._tries += self._untried([Try(of, g, QUICK) for of, its in entered.items() for g in its])
        return found, law

    def _untried(self, tries: Sequence[Try]) -> list[Try]:
        """Those of ``tries`` whose law and beginning are none of the block's."""
        known = {(t.law, id(t.begin)) for t in self._tries}
        return [t for t in tries if (t.law, id(t.begin)) not in known]

    def _beside_an_effect(self, best: Alone, basic: Alone, begin: FloatArray) -> list[Try]:
        """Where fits with an effect begin: at the ``best`` simple law, above the noise, where that has taken on much of
        an effect, also at ``begin`` (p,); and under the ``basic`` law if a nonlinear one is hardly better."""
        fitted, law = best
        tries = [Try(law, fitted.nuisance, 25, fitted)]
        if not self._enough([best]):
            tries.append(Try(law, begin, 25))
        if law != basic[1] and probability(best) < probability(basic) + TAKEN:
            tries.append(Try(basic[1], begin, 25))
        return tries

    def _bend(self, nuisance: FloatArray) -> None:
        """Columns of other elastic curves that go with the memory of ``nuisance`` (p,)."""
        tissue = self.tissue(nuisance)
        memory = [v for pair in zip(tissue.creep, tissue.times, strict=True) for v in pair]
        of_stress = bool(nuisance[list(self.PARTS).index("fung")])
        at = slice(self._curve_part.start - self._offset, self._curve_part.stop - self._offset)
        self._added[:, at] = self._by_group(elastic_freedom, memory, of_stress)[0] * self._span

    def _race(self, entered: Sequence[tuple[SkinLaw, FloatArray]], kept: int = 1) -> list[Alone]:
        """Laws fitted alone, each from a nuisance (p,): all a few steps, the most probable to convergence."""
        first = self._alone((), np.zeros(0), [Try(law, begin, QUICK) for law, begin in entered], self.jobs)
        best = sorted(first, key=probability, reverse=True)[:kept]
        return self._alone((), np.zeros(0), [Try(law, f.nuisance, 40, f) for f, law in best], self.jobs)

    def _enough(self, alone: Sequence[Alone]) -> bool:
        """Whether some law is at the noise, so that nothing less simple is tried."""
        return any(f.chi2 < ENOUGH * len(self.measured) for f, _ in alone)

    def _hold(self, mean: FloatArray, nuisance: FloatArray) -> None:
        """The tissue at ``nuisance`` becomes the prior's ``mean``, but for how much it creeps."""
        mean[: len(self.PARTS)] = nuisance[: len(self.PARTS)]
        mean[[k for k, name in enumerate(self.PARTS) if name in CREEP]] = 0.0

    def _guesses(self) -> list[FloatArray]:
        """Nuisance vectors (p,) to begin from."""
        return guesses(self.PARTS, len(self.prior_mean))

    @property
    def _offset(self) -> int:
        """Where the nuisance of added columns begins: behind the tissue, the shift and the gains."""
        begin: int = len(self.PARTS) + 1 + self._runs.shape[1]
        return begin

    @property
    def likelihood_powers(self) -> Sequence[float]:
        return (*[self.trust_simple] * len(self.laws), *[self.trust] * len(self.DISCREPANCY_SCALES))

    @property
    def sd_without_discrepancy(self) -> FloatArray:
        sd = self.prior_scales[len(self.laws)].copy()
        sd[self._curve_part.stop :] = FROZEN
        return sd

    def _alone(
        self, hypothesis: Sequence[Candidate], unit: FloatArray, tries: Sequence[Try], jobs: int = 1
    ) -> list[Alone]:
        """The simulation by itself, the person's tissue not yet known, with effects from ``unit`` (k,) on: a fit for
        each of the ``tries``, and its law. The usual one is left out where a simple one is at the noise."""
        wide = self.sd_without_discrepancy
        wide[: len(self.PARTS)] = [part.sd for part in self.PARTS.values()]

        def fitted(one: Try) -> Alone:
            problem = under(self, self._mean(one.law), self._sd(wide, one.law))
            begin, near = switched(self.PARTS, one.begin, one.law), one.near
            jacobian, gram = (near.jacobian, near.gram) if near else (None, None)
            return fit(problem, hypothesis, unit, begin, one.iterations, jacobian=jacobian, gram=gram), one.law

        found = each(fitted, [one for one in tries if one.law.simple], jobs)
        if not self._enough(found):
            found += each(fitted, [one for one in tries if not one.law.simple], jobs)
        return found

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        """Where the tissue alone would go with an effect; a second one begins where the first left the tissue."""
        if len(hypothesis) > 1:
            return None
        self.start()
        guess = self._guesses()[0]
        tries = self._tries or [*(Try(law, guess, 25) for law in self.SIMPLE_LAWS), Try(self.USUAL_LAW, guess, 15)]
        if len(tries) > 1:
            first = self._alone(hypothesis, unit, [t._replace(iterations=SHORT) for t in tries])
            best, law = max(first, key=probability)
            unit, tries = best.unit, [Try(law, best.nuisance, 25, best)]
        found, law = self._alone(hypothesis, unit, tries)[0]
        mean = self.prior_mean.copy()
        self._hold(mean, found.nuisance)
        return Start(mean, self.prior_scales[self._place(law)], found.nuisance, found.unit, found.jacobian)

    def under_simple_law(self, candidate: Candidate, unit: FloatArray) -> Fit | None:
        if not self._tries or (near := self._tries[0].near) is None or near.chi2 < ENOUGH * len(self.measured):
            return None
        return self._alone((candidate,), unit, [self._tries[0]._replace(iterations=FEW)])[0][0]

    def _place(self, law: SkinLaw) -> int:
        """Which of the `prior_scales` stands for a law that was fitted alone."""
        if not law.simple:
            return len(self.laws)
        return next(k for k, simple in enumerate(self.laws) if set(law.amounts) <= set(simple.amounts))

    def _first_guess(self) -> FloatArray:
        """Tissue and shift (t,) at a size of the compliance that gives the largest height measured."""
        c = np.zeros(len(self.PARTS) + 1)
        c[:-1] = [part.begin for part in self.PARTS.values()]
        c = switched(self.PARTS, c, self.USUAL_LAW)
        self._size = 1.0
        skin = np.concatenate([np.full(at.stop - at.start, g.skin) for g, at in self.groups])
        top = float(np.max(np.abs(self._chain_height(c, {})[skin]), initial=0.0))
        if top > 0:
            self._size = max(float(np.max(self.measured[skin])), 1e-7) / top
        return c

    def _law_chain(self, group: Group, nuisance: FloatArray) -> Chain:
        """The nominal chain of a group with the tissue at a nuisance vector."""

        def made() -> Chain:
            c, at = self._named(nuisance), self._at
            chain = chain_of(self.session, group, at.tissue(c))
            return rewired(chain, c, self.strongest, at.reaching(c)) if group.skin else chain

        key = (group.specimen, self._size, nuisance[: len(self.PARTS)].tobytes())
        found: Chain = self._skins.get(key, made)
        return found

    def _chain_height(self, nuisance: FloatArray, active: Active, coarse: bool = False) -> FloatArray:
        """Apex height of the chain (n,) m, before run scatter and discrepancy; ``coarse`` for differences."""
        shift = nuisance[len(self.PARTS)]
        return self.read(lambda g: self._law_chain(g, nuisance), shift, active, coarse=coarse)

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        n, r = len(self.PARTS) + 1, self._runs.shape[1]
        gain = np.exp(self._runs @ nuisance[n : n + r])
        height = self._chain_height(nuisance, active)
        predicted = height * gain + self._added @ nuisance[n + r :]
        residual = self.whitened(self.measured - predicted, active)
        if not want_jacobian:
            return Evaluation(residual, np.zeros((0, 0)))
        chain_part = np.zeros((len(residual), n))
        roughly = self._chain_height(nuisance, active, coarse=True)
        for k in np.flatnonzero(self.prior_sd[:n] > FROZEN).tolist():
            tissue = k < n - 1  # a shift by less than a node needs the fine ones, but no new simulation
            step = TISSUE_STEP if tissue else 0.05 * self.dt
            moved = nuisance.copy()
            moved[k] += step
            at, here = self._chain_height(moved, active, tissue), roughly if tissue else height
            chain_part[:, k] = (at - here) / step
        jacobian = np.hstack([chain_part * gain[:, None], self._runs * (height * gain)[:, None], self._added])
        return Evaluation(residual, self.whitened(jacobian, active))
