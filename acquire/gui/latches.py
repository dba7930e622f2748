"""Which instruments are stopped until a person resets them: one latch each, whichever button shows or resets it."""

from __future__ import annotations

from collections.abc import Iterable

from acquire.gui.messages import NEEDS_RESET, View


class Latches:
    """The stops of a bench's instruments, as the worker's views tell them.

    The engine holds the latch; this only remembers the window's requests that were not answered yet: a stop latches
    at once, and a reset is not undone by a view from before it.
    """

    def __init__(self) -> None:
        self._why: dict[str, str] = {}
        self._stopping: set[str] = set()
        self._resetting: set[str] = set()

    @property
    def stopped(self) -> tuple[str, ...]:
        """Names of the instruments that wait for a reset."""
        return tuple(sorted((self._why.keys() | self._stopping) - self._resetting))

    def holds(self, name: str) -> bool:
        """Whether nothing may be started on an instrument."""
        return name in self._why or name in self._stopping or name in self._resetting

    def stop(self, names: Iterable[str]) -> None:
        """An emergency stop of ``names`` was asked for."""
        self._stopping |= set(names)
        self._resetting.clear()

    def reset(self, name: str) -> None:
        """The reset of one instrument was asked for; `answered` tells that it was carried out or refused."""
        self._stopping.discard(name)
        self._resetting.add(name)

    def answered(self, name: str) -> None:
        """The answer to a reset is there: from now on views tell the truth."""
        self._resetting.discard(name)
        self._why.pop(name, None)

    def see(self, view: View) -> None:
        """The worker's newest view of an instrument."""
        if view.state in NEEDS_RESET:
            self._stopping.discard(view.name)
            self._why[view.name] = view.trip or view.error or view.state
        elif view.name not in self._stopping:
            self._why.pop(view.name, None)

    def clear(self) -> None:
        """Another bench, or another worker: its instruments are told anew."""
        for kept in (self._why, self._stopping, self._resetting):
            kept.clear()

    def words(self) -> str:
        """The reason of each instrument's stop; '' where none is stopped."""
        reasons: dict[str, list[str]] = {}
        for name in self.stopped:
            reasons.setdefault(self._why.get(name, "everything vents"), []).append(name)
        told = [f"{', '.join(names)}: {why}" for why, names in reasons.items()]
        return f"STOPPED – {'; '.join(told)}. Look first, then reset." if told else ""
