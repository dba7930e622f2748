"""Options of a station entry: taken by name, defaults given, anything else refused."""

from __future__ import annotations

from typing import Any

from drivers.instrument import Entry


def take(entry: Entry, **defaults: Any) -> dict[str, Any]:
    """The entry's options over ``defaults``. Raises ValueError that names an option the instrument does not have."""
    unknown = sorted(set(entry.options) - set(defaults))
    if unknown:
        known = ", ".join(sorted(defaults)) or "none"
        raise ValueError(f"{entry.instrument}: unknown option {unknown[0]!r}; it has {known}")
    return {**defaults, **entry.options}
