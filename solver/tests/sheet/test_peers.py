"""The Ogden sheet against felupe and NGSolve, independent finite element libraries."""

from __future__ import annotations

import pytest
import sheet_peers
from numpy.testing import assert_allclose


def test_ogden_sheet_agrees_with_felupe() -> None:
    case = sheet_peers.Case()
    ours, _, _ = sheet_peers.ours(case, 6, 16, 3)
    theirs, _, _ = sheet_peers.with_felupe(case, 4, 6, 3, quadratic=True)
    assert_allclose(ours, theirs, rtol=3e-3)


def test_ogden_sheet_agrees_with_ngsolve() -> None:
    """Curved triangles of third order, the thickness an unknown of its own."""
    pytest.importorskip("ngsolve")
    case = sheet_peers.Case()
    ours, _, _ = sheet_peers.ours(case, 6, 16, 6)
    theirs, _, _ = sheet_peers.with_ngsolve(case, 3, 4.0, 6)
    assert_allclose(ours, theirs, rtol=1e-3)
