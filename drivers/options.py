"""Options of a station entry: taken by name, defaults given, anything else refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from drivers.instrument import Entry
from drivers.signals import REFERENCE, Channel


def take(entry: Entry, **defaults: Any) -> dict[str, Any]:
    """The entry's options over ``defaults``.

    Raises ValueError that names an option the instrument does not have, or one that is not true or false but must be.
    """
    unknown = sorted(set(entry.options) - set(defaults))
    if unknown:
        known = ", ".join(sorted(defaults)) or "none"
        raise ValueError(f"{entry.instrument}: unknown option {unknown[0]!r}; it has {known}")
    for name, default in defaults.items():
        if isinstance(default, bool) and not isinstance(entry.options.get(name, default), bool):
            raise ValueError(f"{entry.instrument}: option {name} is true or false, not {entry.options[name]!r}")
    return {**defaults, **entry.options}


def reference(channel: Channel, options: Mapping[str, Any]) -> tuple[Channel, ...]:
    """The second gauge of a channel, if ``options`` say that there is one; the interlock compares the two."""
    name = f"{channel.name}{REFERENCE}"
    return (replace(channel, name=name),) if options[name] else ()
