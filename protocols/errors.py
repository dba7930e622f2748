"""Faults of a protocol, and where they are."""

from __future__ import annotations

from dataclasses import dataclass

MOST_TOLD = 20  # problems that a message lists


@dataclass(frozen=True)
class Problem:
    """One fault. ``line`` and ``column`` count from 1 (0: not known); ``field`` is a path such as ``steps[2].rate``."""

    message: str
    field: str = ""
    line: int = 0
    column: int = 0

    def located(self, file: str) -> str:
        """``file:line:column: field: message``, the parts that are known."""
        place = file
        if self.line:
            place += f":{self.line}:{self.column}"
        return ": ".join(part for part in (place, self.field, self.message) if part)


class ProtocolError(ValueError):
    """A protocol that cannot be run as written. ``problems`` has every fault found, in the order of the file."""

    def __init__(self, problems: tuple[Problem, ...], file: str = "") -> None:
        self.problems = problems
        self.file = file
        more = [f"… and {len(problems) - MOST_TOLD} more"] if len(problems) > MOST_TOLD else []
        super().__init__("\n".join([*(p.located(file) for p in problems[:MOST_TOLD]), *more]))
