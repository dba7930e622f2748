"""The gap: rows without noise do not count, and a small block's is not lost in that of all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.decision.gaps import (
    excess_left,
    gap_but_for_skin,
    gap_of,
    in_changed_blocks,
    in_session,
    noisy,
    shrink,
    worst_gap,
)
from gap.inference.evidence import Fit, Hypothesis
from tests.gap.decision.waves import weak_wave


@pytest.fixture
def of_residuals(linear, candidate):
    """A hypothesis whose blocks leave given residuals."""
    like = next(iter(weak_wave(linear, candidate, 0.0)[0].null.fits.values()))

    def made(**left: np.ndarray) -> Hypothesis:
        def fit(r: np.ndarray) -> Fit:
            return replace(like, residual=r, chi2=float(r @ r), penalty=0.0)

        return Hypothesis((), {name: fit(r) for name, r in left.items()})

    return made


def test_rows_without_noise_do_not_dilute_a_gap(of_residuals) -> None:
    noise, arithmetic = np.full(100, 1.5), np.full(100, 1e-3)
    both, alone = of_residuals(force=noise, matrix=arithmetic), of_residuals(matrix=arithmetic)
    assert gap_of(both, noisy(both)) == pytest.approx(1.5)
    assert in_session(both, both).before == pytest.approx(1.5)
    assert gap_of(alone, noisy(alone)) == pytest.approx(1e-3)


def test_arithmetic_that_is_wrong_counts(of_residuals) -> None:
    wrong = of_residuals(force=np.ones(100), matrix=np.full(100, 7.0))
    right = of_residuals(force=np.ones(100), matrix=np.full(100, 1e-3))
    assert gap_of(wrong, noisy(wrong)) == pytest.approx(5.0)
    # Of a wrong unit that is mended the same rows are looked at: what it left of the others is no larger for it.
    assert in_session(wrong, right).after == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_the_worst_block_is_larger_than_its_rows_chance(of_residuals) -> None:
    many, few = np.ones(2000), np.full(50, 1.1)
    assert worst_gap(of_residuals(height=many, reference=few)) < 1.0
    assert worst_gap(of_residuals(height=many, reference=3.0 * few)) > 2.0


def test_skin_of_another_law_is_no_cause_to_be_found(of_residuals) -> None:
    """Ten of twelve development sessions of which skin left 1.2 to 7 by itself were sound, and were told that something
    outside the library acts."""
    plain = of_residuals(force=np.full(100, 5.0), axes=np.full(300, 1.2))
    compared = of_residuals(force=np.full(100, 1.0), axes=np.full(300, 1.0))
    assert gap_but_for_skin(plain, compared, {"force"}) == pytest.approx(np.sqrt(0.25 + 0.75 * 1.44))
    assert gap_but_for_skin(plain, compared, set()) == pytest.approx(np.sqrt(0.25 * 25.0 + 0.75 * 1.44))


def test_a_gap_is_told_of_the_changed_blocks_that_show_it(of_residuals, candidate) -> None:
    """A jump of a transducer takes most off a reference's gap, and next to nothing off that of skin of another law."""
    null = of_residuals(force=np.full(900, 1.5), reference=np.full(100, 1.4), axes=np.full(100, 9.0))
    answer = of_residuals(force=np.full(900, 1.5), reference=np.full(100, 0.9), axes=np.full(100, 9.0))
    answer = replace(answer, effects=(replace(candidate("jump"), blocks=("force", "reference")),))
    assert in_changed_blocks(null, answer).after == pytest.approx(1.451, abs=1e-3)
    assert in_changed_blocks(null, answer, ["reference"]).after == pytest.approx(0.9)
    assert in_changed_blocks(null, answer, ["axes"]) == in_changed_blocks(null, answer)


def test_next_to_nothing_above_the_floor_has_no_share() -> None:
    assert shrink(1.04, 1.0) is None
    assert shrink(3.0, 2.0) == pytest.approx(0.5)


def test_whatever_arithmetic_leaves_is_excess(of_residuals) -> None:
    """Of 100 rows at 1.1 and a computed channel at .4 a repair of the channel leaves the rest of the others."""
    null = of_residuals(force=np.full(100, 1.1), matrix=np.full(100, 0.4))
    mended = of_residuals(force=np.full(100, 1.1), matrix=np.zeros(100))
    assert noisy(null) == ["force"]
    assert excess_left(null, mended, noisy(null)) == pytest.approx(0.21 / (0.21 + 0.16))
    assert excess_left(null, null, noisy(null)) == pytest.approx(1.0)
