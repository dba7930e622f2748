"""How large the gap is, in all data or in some, and how far it shrinks.

A gap is the rms of whitened residuals, in σ: 1 at the noise floor. Rows that hold no noise of their own do not count:
a micro-robot's probe position and force are computed from its other channels, which have that noise already, and half
of all rows at 0 would halve any gap.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from gap.inference.evidence import Fit, Hypothesis
from gap.inference.hypothesis import touched

MEASURABLE = 1.05
"""Gap below which what stands above the noise is of the size of the noise's own error: no share of it is told."""
EXACT = 0.25
"""χ² a row below which a block is arithmetic, where any noise leaves about 1."""
SURE = 2.0
"""Standard deviations of χ² that are allowed for, before one block's gap is more than its few rows' chance."""


@dataclass(frozen=True)
class Shrink:
    """Gaps before and after in so many ``rows``, strained tolerances included as in `gap_without_discrepancy`;
    ``value`` is (before − after)/(before − 1)."""

    before: float
    after: float
    rows: int = 0

    @property
    def value(self) -> float | None:
        return shrink(self.before, self.after)

    @property
    def fall(self) -> float:
        """Share of the gap that goes."""
        return 1.0 - self.after / self.before if self.before > 0.0 else 0.0

    @property
    def squares(self) -> float:
        """The χ² that goes."""
        return self.rows * (self.before**2 - self.after**2)


def above(gap: float, quiet: float) -> float:
    """How much of a ``gap``, in squares, is above one that is ``quiet``."""
    return float(max(gap**2 - quiet**2, 0.0))


def shrink(before: float, after: float, floor: float = 1.0) -> float | None:
    """(before − after)/(before − floor); None where next to nothing stands above the floor."""
    return float((before - after) / (before - floor)) if before > floor * MEASURABLE else None


def exact(fit: Fit) -> bool:
    """Whether a block holds no noise of its own, as its χ² says."""
    return fit.chi2 < EXACT * len(fit.residual)


def noisy(null: Hypothesis, within: Collection[str] | None = None) -> list[str]:
    """The blocks, all or ``within`` some, that hold noise without an effect; all of them where none does."""
    names = list(null.fits) if within is None else [b for b in null.fits if b in within]
    return [b for b in names if not exact(null.fits[b])] or names


def gap_of(h: Hypothesis, blocks: Collection[str]) -> float:
    """The gap of a hypothesis in some blocks, skin of another law allowed for."""
    fits = [h.fits[b] for b in blocks]
    return float(np.sqrt(sum(f.chi2 for f in fits) / sum(len(f.residual) for f in fits)))


def gap_without_discrepancy(h: Hypothesis, blocks: Collection[str]) -> float:
    """The gap of a plain hypothesis in some ``blocks``, tolerances that are strained included; effects of chance widen
    the noise."""
    fits = [h.fits[b] for b in blocks]
    return float(np.sqrt(sum(f.chi2 + f.penalty for f in fits) / sum(len(f.residual) for f in fits)))


def gap_but_for_skin(plain: Hypothesis, compared: Hypothesis, skin: Collection[str]) -> float:
    """The gap of a plain hypothesis in all that holds noise, but that the blocks of ``skin`` are as ``compared``: that
    the law of a person's skin is another one is no cause to be found."""
    where = noisy(plain)
    squares = sum(compared.fits[b].chi2 if b in skin else plain.fits[b].chi2 + plain.fits[b].penalty for b in where)
    return float(np.sqrt(squares / sum(len(plain.fits[b].residual) for b in where)))


def excess_left(null: Hypothesis, answer: Hypothesis, blocks: Collection[str]) -> float:
    """The share of the null's excess χ² that an answer leaves: above 1 for each row of the noisy ``blocks``, and all of
    it in arithmetic."""
    n = sum(len(null.fits[b].residual) for b in blocks)
    return min(max(answer.chi2 - n, 0.0) / max(null.chi2 - n, 1e-9 * n), 1.0)


def worst_gap(h: Hypothesis) -> float:
    """The largest gap of one block, skin of another law allowed for, less the chance of its number of rows: what a
    small block leaves is lost in the gap of all."""
    each = [(f.chi2 / len(f.residual), len(f.residual)) for f in h.fits.values()]
    return float(np.sqrt(max(0.0, *(square * (1.0 - SURE * np.sqrt(2.0 / n)) for square, n in each))))


def in_session(null: Hypothesis, answer: Hypothesis) -> Shrink:
    """The plain gap before and after, in all that holds noise."""
    where = noisy(null)
    return Shrink(gap_without_discrepancy(null, where), gap_without_discrepancy(answer, where))


def in_changed_blocks(null: Hypothesis, answer: Hypothesis, among: Collection[str] = ()) -> Shrink:
    """The plain gap before and after, in the blocks that an answer's effects change, or in those ``among`` them."""
    where = noisy(null, touched(answer.effects) & set(among) or touched(answer.effects))
    return Shrink(gap_without_discrepancy(null, where), gap_without_discrepancy(answer, where))


def in_each_block(null: Hypothesis, answer: Hypothesis) -> dict[str, Shrink]:
    """The same for every such block by itself."""
    where = sorted(touched(answer.effects))
    return {b: Shrink(gap_without_discrepancy(null, [b]), gap_without_discrepancy(answer, [b])) for b in where}
