"""The Ogden sheet against felupe, an independent finite element library with automatic differentiation."""

from __future__ import annotations

import sheet_peers
from numpy.testing import assert_allclose


def test_ogden_sheet_agrees_with_felupe() -> None:
    case = sheet_peers.Case()
    ours, _, _ = sheet_peers.ours(case, 6, 16, 3)
    theirs, _, _ = sheet_peers.with_felupe(case, 4, 6, 3, quadratic=True)
    assert_allclose(ours, theirs, rtol=3e-3)
