"""Plugins: a broken one is a line in a list, not a crash."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pytest

from acquire import plugins
from acquire.plugins import instrument


def found(group: str) -> tuple[EntryPoint, ...]:
    return (
        EntryPoint("good", "math:sqrt", group),
        EntryPoint("missing", "no_such_package.thing:x", group),
        EntryPoint("nameless", "math:no_such_name", group),
        EntryPoint("good", "math:cos", group),
    )


def test_broken_plugins_are_data() -> None:
    known = plugins.plugins("acquire.instruments", found)
    assert list(known) == ["good", "missing", "nameless"]
    assert known["good"].working
    assert known["good"].object(9) == 3
    assert "no_such_package" in known["missing"].error
    assert "no_such_name" in known["nameless"].error


def test_a_broken_driver_says_so_when_it_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "_instruments", lambda: plugins.plugins("acquire.instruments", found))
    with pytest.raises(ValueError, match=r"driver of missing \(no_such_package.thing:x\) does not load"):
        instrument("missing")
    with pytest.raises(ValueError, match="there is good, missing, nameless"):
        instrument("toaster")


def test_our_own_instruments_are_plugins() -> None:
    assert instrument("cutometer").quantities == ("pressure",)
    assert instrument("microrobot").quantities == ("probe_x", "probe_y", "probe_z")
