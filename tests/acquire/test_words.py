"""Numbers as people read them: never an exponent where a number will do, never inf or nan."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from acquire.words import clock, number, share, shown, span

ANY = st.floats(allow_nan=True, allow_infinity=True)


@given(ANY)
def test_no_infinity_and_no_nan_is_ever_shown(value: float) -> None:
    for text in (share(value), span(abs(value)), shown(value, "Pa"), clock(value)):
        assert "inf" not in text
        assert "nan" not in text


def test_times() -> None:
    assert [span(s) for s in (0.25, 90.0, 7200.0, 40 * 86400.0)] == ["0.25 s", "90 s", "2 h", "40 d"]
    assert span(6.41e3 * 86400) == span(math.inf) == "more than a year"
    assert span(math.nan) == "–"


def test_shares() -> None:
    assert [share(x) for x in (0.0, 0.0254, 0.4, 1.0, 2.5)] == ["0 %", "2.5 %", "40 %", "100 %", "250 %"]
    assert share(2e-4) == "below 0.1 %"
    assert share(99.0) == "more than 1000 %"
    assert share(math.inf) == share(None) == "–"


def test_numbers() -> None:
    assert [number(x) for x in (0.01234, 12.345, 1234.5, -45678.0)] == ["0.0123", "12.3", "1234", "-45678"]
