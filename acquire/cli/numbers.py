"""Numbers on the command line, read as they are spelt and within bounds: to Python ``-3_0`` is -30."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

LARGEST = 2**31 - 1
MOST_JOBS = 1024
FASTEST = 1e5  # simulated seconds per second that a session takes


def real(low: float, high: float) -> Callable[[str | float], float]:
    """A parser of numbers above ``low``, up to ``high``."""

    def parse(text: str | float) -> float:
        value = _number(str(text))
        if not low < value <= high:
            raise typer.BadParameter(f"{value:g} is not above {low:g} and at most {high:g}.")
        return value

    return parse


def whole(low: int = 0, high: int = LARGEST) -> Callable[[str | int], int]:
    """A parser of whole numbers from ``low`` to ``high``."""

    def parse(text: str | int) -> int:
        value = _number(str(text))
        if not (low <= value <= high and value == int(value)):
            raise typer.BadParameter(f"{text} is not a whole number from {low} to {high}.")
        return int(value)

    return parse


def _number(text: str) -> float:
    from protocols.files import number  # imported here, so that --help stays quick

    try:
        return number(text)
    except ValueError as error:
        raise typer.BadParameter(f"{error}.") from None


Speed = Annotated[float, typer.Option(parser=real(0, FASTEST), help="Simulated seconds per second.")]
