"""Plugins by entry point. A plugin that does not load is data, its name and error, and never an exception."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

GROUPS = ("acquire.instruments", "acquire.solvers", "acquire.effects")


@dataclass(frozen=True)
class Plugin:
    """One entry point: ``value`` is where it lives (``module:object``), ``error`` why it did not load, '' if it did."""

    group: str
    name: str
    value: str
    object: Any = None
    error: str = ""

    @property
    def working(self) -> bool:
        """Whether it loaded."""
        return not self.error


def plugins(group: str, finder: Callable[[str], tuple[EntryPoint, ...]] | None = None) -> dict[str, Plugin]:
    """Every plugin of ``group`` (one of `GROUPS`), loaded or with its error; the first of two with one name wins."""
    found = finder(group) if finder else tuple(entry_points(group=group))
    result: dict[str, Plugin] = {}
    for entry in found:
        if entry.name not in result:
            result[entry.name] = _load(group, entry)
    return result


def _load(group: str, entry: EntryPoint) -> Plugin:
    try:
        return Plugin(group, entry.name, entry.value, entry.load())
    except Exception as error:  # whatever a stranger's module does at import
        return Plugin(group, entry.name, entry.value, error=f"{type(error).__name__}: {error}")


def solver(model: str = "") -> Any:
    """The installed solver, by preference one that has ``model``. Raises ValueError where either is missing."""
    found = plugins("acquire.solvers").values()
    working = [plugin.object for plugin in found if plugin.working]
    if not working:
        broken = "".join(f"{p.name} ({p.value}) does not load: {p.error}. " for p in found)
        raise ValueError(
            f"{broken}no solver plugin (entry point acquire.solvers). skinrig's own is in the folder solver: "
            "pip install ./solver"
        )
    made = [make() for make in working]
    return next((s for s in made if model in s.models()), made[0])


@functools.cache
def _instruments() -> dict[str, Plugin]:
    return plugins("acquire.instruments")


def instrument(kind: str) -> Any:
    """The `drivers.instrument.Instrument` of a kind.

    Raises ValueError that lists the kinds, or says why the plugin is broken.
    """
    known = _instruments()
    if kind not in known:
        raise ValueError(f"no driver for an instrument {kind!r}; there is {', '.join(known) or 'none'}")
    plugin = known[kind]
    if plugin.error:
        raise ValueError(f"the driver of {kind} ({plugin.value}) does not load: {plugin.error}")
    return plugin.object
