"""Which law the skin under the micro-robot follows: simple ones first, then any beside a discrepancy."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from gap.inference.evidence import Fit, split
from gap.inference.hypothesis import FROZEN, Active, Candidate, Start
from gap.inference.least_squares import fit, under
from gap.null.blocks import SIMPLE_SHIFT, Block
from gap.null.sheet_law import CURVES, LAWS, MEMORIES, PLAIN, SPECTRUM, TISSUE, Law, joined, unwound
from sim_devices.chain import FloatArray

AT_NOISE = 1.3
"""χ²/n of the best simple law above which further ones are tried."""
FEW, PROMISING = 10, 4
"""First steps of the further laws' fits, and how many go on after them."""
OTHER_MODES = -1.5, 1.5
"""Logarithms of the time of a law's quicker mode, from which the best one is fitted once more."""
CLEARLY = 5.0
"""Nats by which a simple law must be more probable than all else to be the only one."""


class SheetLawBlock(Block):
    """A block whose nuisance begins with the parameters of a sheet's law, and holds changes that other sheets could
    make.

    `_take_all_laws` settles the widths of its prior; a subclass gives the parts of its nuisance (``_parts``).
    """

    TISSUE: tuple[str, ...] = TISSUE
    LAWS: tuple[Law, ...] = LAWS  # the simple ones, then the usual one
    TRUST_SIMPLE = 0.25  # of a simple law, where the data prefer it
    TRUSTS: tuple[float, ...] = (0.25, 0.15, 0.1, 0.08, 0.06)
    """In the evidence, for each of `DISCREPANCY_SCALES`: the farther the sheet is from the reduced one, the more of
    the residual may be the sheet's and look like a device's."""
    DISCREPANCY_SCALES: tuple[float, ...] = (0.03, 0.15, 0.5, 2.0, 8.0)

    _parts: dict[str, slice]
    _basis: FloatArray
    _held: Active

    def _take_all_laws(self) -> None:
        """Any law may be the skin's: `start` settles which."""
        simple = [self._simple(law) for law in self.LAWS[:-1]]
        self.prior_scales = (*simple, *(self._wide(scale) for scale in self.DISCREPANCY_SCALES))
        self.law_parameters = len(self.TISSUE)
        self._trusts: Sequence[float] = (*[self.TRUST_SIMPLE] * len(simple), *self.TRUSTS)
        self._start: FloatArray | None = None
        self._alone: tuple[FloatArray, FloatArray] | None = None  # widths and fit of a simple law that is not the null
        self._probability = -np.inf  # log evidence of the null
        self._bent = False  # whether no simple law is at the noise

    @property
    def likelihood_powers(self) -> Sequence[float]:
        return self._trusts

    @property
    def open_law(self) -> bool:  # type: ignore[override]
        return bool(self._basis.shape[1])

    @property
    def sd_without_discrepancy(self) -> FloatArray:
        sd = self.prior_sd.copy()
        sd[self._parts["discrepancy"]] = FROZEN
        return sd

    def _simple(self, law: Law) -> FloatArray:
        """Prior widths (p,) of a simple law, and of channels that are no later than those that sample."""
        sd = self.prior_sd.copy()
        sd[self._parts["tissue"]] = law.sd
        sd[self._parts["shift"]] = SIMPLE_SHIFT
        sd[self._parts["discrepancy"]] = FROZEN
        return sd

    def _wide(self, scale: float) -> FloatArray:
        """Those of the usual law beside a discrepancy of some size."""
        sd = self.prior_sd.copy()
        sd[self._parts["discrepancy"]] *= scale
        return sd

    def _from_guesses(self, law: Law, sd: FloatArray, iterations: int) -> Fit:
        """The best fit under a law of widths ``sd`` (p,), from each of its guesses."""
        rest = np.zeros(len(self.prior_mean) - len(law.sd))
        here = under(self, self.prior_mean, sd)
        fits = (fit(here, nuisance=np.concatenate([guess, rest]), iterations=iterations) for guess in law.guesses)
        best = min(fits, key=lambda f: f.objective)
        back = unwound(best.nuisance)
        return best if back is None else fit(here, nuisance=back, iterations=iterations)

    def _further(self, beside: Fit) -> Fit:
        """The best fit under one of the further laws or, where none leaves as little as the usual one ``beside`` a
        discrepancy does, the best memory with any elastic curve: a few steps from all their guesses tell which go on.
        The times of the best one's quicker mode are local optima: it is fitted from others, too."""
        remembering, bent = (
            [(law, self._from_guesses(law, self._simple(law), FEW)) for law in laws] for laws in (MEMORIES, CURVES)
        )
        tried = [f for _, f in (*remembering, *bent)]
        if min(f.chi2 for f in tried) > beside.chi2:
            memory, its = min(remembering, key=lambda pair: pair[1].objective)
            others = (PLAIN, *(joined(memory, curve, its.nuisance, f.nuisance) for curve, f in bent))
            tried += [self._from_guesses(law, self._simple(law), FEW) for law in others]
        best = sorted(tried, key=lambda f: f.objective)[:PROMISING]
        on = [fit(under(self, self.prior_mean, f.prior_sd), nuisance=f.nuisance, iterations=40) for f in best]
        first, mode = min(on, key=lambda f: f.objective), self.TISSUE.index("time1")
        for time in OTHER_MODES if first.prior_sd[mode] > FROZEN else ():
            begin = first.nuisance.copy()
            begin[mode] = time
            on.append(fit(under(self, self.prior_mean, first.prior_sd), nuisance=begin, iterations=40))
        return min(on, key=lambda f: f.objective)

    def _at_noise(self, fitted: Fit) -> bool:
        return fitted.chi2 < AT_NOISE * len(self.measured)

    def _beside(self, law: Fit) -> tuple[Fit, Sequence[FloatArray]]:
        """A further law's fit beside a discrepancy, and the prior widths of any size of it.

        Any spectrum of relaxation stays free, as under the usual law: skin of three times would else be told a creep.
        """
        tissue, sizes = self._parts["tissue"], []
        freed = np.where(np.isin(self.TISSUE, SPECTRUM), self.LAWS[-1].sd, law.prior_sd[tissue])
        for scale in (1.0, *self.DISCREPANCY_SCALES):
            sizes.append(self._wide(scale))
            sizes[-1][tissue] = freed
        full, *wide = sizes
        return fit(under(self, self.prior_mean, full), nuisance=law.nuisance, iterations=15), wide

    def start(self) -> FloatArray:
        """The null's fit under the most probable law, which also tells how far other sheets are from the reduced one.

        Where that is a simple law by `CLEARLY`, the session's skin is taken to follow it, and nothing wider is kept.
        """
        if self._start is None:
            laws = self.LAWS[:-1]
            known, wide = self.prior_scales[: len(laws)], self.prior_scales[len(laws) :]
            beside = self._beside_all_sheets()
            basic = [self._from_guesses(law, sd, 40) for law, sd in zip(laws, known, strict=True)]
            further = None if not basic or any(map(self._at_noise, basic)) else self._further(beside)
            if further is not None:
                known, self._trusts = (*known, further.prior_sd), (self.TRUST_SIMPLE, *self._trusts)
                if not self._at_noise(further):
                    other, its = self._beside(further)
                    if other.log_evidence(1.0, its) > beside.log_evidence(1.0, wide):
                        beside, wide = other, tuple(its)
            self.prior_scales = (*known, *wide)
            simple = [f for f in (*basic, further) if f is not None and _settled(f)]
            best = max([*simple, beside], key=lambda f: f.log_evidence(1.0, self.prior_scales))
            self._probability = best.log_evidence(1.0, self.prior_scales)
            self._start, self.prior_sd = best.nuisance, best.best_prior(self.prior_scales)
            self._bent = not any(map(self._at_noise, simple))
            if simple:
                law = max(simple, key=_own_evidence)
                self._alone = law.prior_sd, law.nuisance
                if _own_evidence(law) > beside.log_evidence(1.0, wide) + CLEARLY:
                    self._probability = _own_evidence(law)
                    self._keep(law, min(basic, key=lambda f: f.objective) if law is further else None)
            if self.row_noise.memory is None and self.remember(self._null(self._start)):
                null = self._null(self._start)
                self._start, self._probability = null.nuisance, null.log_evidence(1.0, self.prior_scales)
        return self._start.copy()

    def _null(self, begin: FloatArray) -> Fit:
        """The fit of the simulation by itself under its own widths, from ``begin`` (p,)."""
        return fit(under(self, self.prior_mean, self.prior_sd), nuisance=begin, iterations=10)

    def _beside_all_sheets(self) -> Fit:
        """The fit of the usual law beside a discrepancy, which leaves noise whichever law is the skin's: from it the
        sensors' slow noise is known, where no reference told it."""
        found = self._from_guesses(self.LAWS[-1], self.prior_sd, 40)
        if self.row_noise.memory is not None or len(self.LAWS) == 1 or not self.remember(found):
            return found
        return self._null(found.nuisance)

    def _keep(self, law: Fit, basic: Fit | None) -> None:
        """Take the skin to follow a simple law, without the discrepancy; but a further law's change may be nothing but
        an effect on ``basic`` skin."""
        shape = self._parts["discrepancy"]
        self._basis = self._basis[:, :0]
        self._parts["discrepancy"] = slice(shape.start, shape.start)
        self.prior_mean, self._start = (np.delete(v, shape) for v in (self.prior_mean, law.nuisance))
        kept = [(np.delete(f.prior_sd, shape), np.delete(f.nuisance, shape)) for f in (law, basic) if f is not None]
        self.prior_sd = kept[0][0]
        self.prior_scales = tuple(sd for sd, _ in kept)
        self._trusts = (self.TRUST_SIMPLE,) * len(kept)
        self._alone = kept[1] if basic is not None else None

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        """Under a simple law, which takes on little of an effect, where the null needs more than that; also from the
        laws' guesses where none of them is at the noise, as an effect bends the null's skin."""
        starts = [self._alone] if self._alone is not None else []
        if self._bent and self.LAWS[:-1]:
            starts.append(self._anew(hypothesis, unit))
        tries = (fit(under(self, self.prior_mean, sd), hypothesis, unit, c, iterations=8) for sd, c in starts)
        found = max(tries, key=_own_evidence, default=None)
        does = found is not None and _own_evidence(found) >= self._probability
        if found is None or not (does or self._bent):
            return None  # nor does the simple law do with these effects
        sd = found.prior_sd if does else found.best_prior(self.prior_scales)
        return Start(self.prior_mean, sd, found.nuisance, found.unit)

    def _anew(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Widths and fit (p,) of the simple law that is most probable with effects held at ``unit`` (k,)."""
        held = copy.copy(self)
        held._held = split(hypothesis, unit)
        best = max((held._from_guesses(law, self._simple(law), FEW) for law in self.LAWS[:-1]), key=_own_evidence)
        return best.prior_sd, best.nuisance


def _own_evidence(fitted: Fit) -> float:
    """log evidence under the widths that a fit was made with."""
    return fitted.log_evidence(1.0, (fitted.prior_sd,))


def _settled(fitted: Fit) -> bool:
    """Whether a fit came to an end: else the linear model promises more than there is."""
    return _own_evidence(fitted) < -0.5 * fitted.objective + CLEARLY
