"""How effects are written down: parameters in a line, operators put next to the nominal one they disturb."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from sim_devices.chain import Chain, Effect, Parameter
from sim_devices.stages.kernels import Kernel
from sim_devices.stages.operators import Delay, Law, Map, Names, Wired, after, before, last_writer

Values = Mapping[str, float]
Install = Callable[[Chain, Values], Chain]
Scatter = Callable[[str, Values], Mapping[str, float]]
Wander = Callable[[Values], Mapping[str, float]]

SUCTION = ("cutometer", "aspiration")
CUTOMETER, ASPIRATION, ROBOT = ("cutometer",), ("aspiration",), ("microrobot",)
ALL = (*SUCTION, *ROBOT)
PRESSURE = 30e3
"""Pa at which relative errors of pressure are quoted: 300 mbar."""
DRAWN = 500.0
"""Pa of suction from which on it draws a leak's edges together."""
CHOICE = "choice"
"""Unit of a shape parameter that takes whole numbers only, each a form or a channel of its own."""


def strength(
    name: str,
    unit: str,
    low: float,
    high: float,
    default: float,
    meaning: str = "",
    null: float = 0.0,
    *,
    only: tuple[int, ...] = (),
    fine: float = 1e-3,
) -> Parameter:
    """A positive strength, log-uniform a priori; 0 (or ``null``) switches the effect off."""
    return Parameter(name, unit, low, high, null, default, "log", meaning, only, fine)


def signed(
    name: str, unit: str, size: float, default: float, meaning: str = "", *, only: tuple[int, ...] = ()
) -> Parameter:
    """A strength of either sign within ±size."""
    return Parameter(name, unit, -size, size, 0.0, default, "linear", meaning, only)


def shape(
    name: str,
    unit: str,
    low: float,
    high: float,
    default: float,
    meaning: str = "",
    *,
    log: bool = False,
    only: tuple[int, ...] = (),
    fine: float = 1e-3,
) -> Parameter:
    """A parameter of form: no value of it switches the effect off. Of some forms ``only``, if these are listed."""
    return Parameter(name, unit, low, high, None, default, "log" if log else "linear", meaning, only, fine)


PHASE = Parameter("phase", "1", 0.0, 1.0, None, 0.0, "linear", "of going to and fro", (2,))
"""When a swing of form 2 begins."""


MOMENT = ("moment", "s", 1.0, 3000.0, 3.0)
"""Name, unit, range and default of when something happens."""
AT_ONCE = 1e-5
"""Step of a moment's quantile that a fit differentiates by: some ms, in which little else happens."""
LONGEST = 3000.0
"""s that an event lasts at most: to the end of any session."""


def for_a_while(*only: int, lasting: float = 3.0) -> tuple[Parameter, Parameter]:
    """When something happens, and for how long, of the forms in which it is not there always; ``lasting`` s usually."""
    return (
        shape(*MOMENT, "when it begins", log=True, only=only, fine=AT_ONCE),
        shape("duration", "s", 0.5, LONGEST, lasting, "how long it lasts", log=True, only=only, fine=1e-4),
    )


def choice(name: str, default: int, *forms: str, only: tuple[int, ...] = ()) -> Parameter:
    """One of several forms or channels, by number; where a channel belongs to some forms ``only``, these."""
    meaning = ", ".join(f"{i} {form}" for i, form in enumerate(forms))
    return Parameter(name, CHOICE, 0.0, float(len(forms) - 1), None, float(default), "linear", meaning, only)


def chosen(values: Values, name: str) -> int:
    """The whole number that a choice stands for."""
    return round(values[name])


def effect(
    name: str,
    stage: str,
    instruments: Names,
    meaning: str,
    remedy: str,
    source: str,
    parameters: tuple[Parameter, ...],
    install: Install,
    scatter: Scatter | None = None,
    sparse: bool = False,
    extends: Names = (),
    wander: Wander | None = None,
    rhythm: Wander | None = None,
) -> Effect:
    """An effect that leaves the chain alone where all its strengths are at their null values."""
    strengths = [p for p in parameters if p.null is not None]

    def guarded(chain: Chain, values: Values) -> Chain:
        return chain if all(values[p.name] == p.null for p in strengths) else install(chain, values)

    return Effect(
        name,
        stage,
        instruments,
        meaning,
        remedy,
        source,
        parameters,
        guarded,
        scatter,
        sparse,
        extends=extends,
        wander=wander,
        rhythm=rhythm,
    )


def _law(
    place: Callable[..., Chain],
    chain: Chain,
    anchor: str,
    name: str,
    stage: str,
    kernel: Kernel,
    parameters: tuple[float, ...],
    *signals: str,
    add: bool = False,
) -> Chain:
    """``kernel`` at a ``place`` about ``anchor``: on its outputs (`after`) or its inputs (`before`)."""
    return place(chain, anchor, lambda s, t: Law(name, stage, s, t, kernel, parameters, add), *signals)


law_after, law_before = partial(_law, after), partial(_law, before)


def map_after(
    chain: Chain,
    anchor: str,
    name: str,
    stage: str,
    function: Callable[..., Any],
    parameters: tuple[float, ...],
    *signals: str,
    reading: Names = (),
) -> Chain:
    """``function`` on the outputs of ``anchor``, one by one; on all at once and on those of ``reading``, if given."""

    def make(source: Names, target: Names) -> Wired:
        if reading or len(source) == 1:
            return Map(name, stage, (*source, *reading), target, function, parameters)
        return Each(name, stage, source, target, function, parameters)

    return after(chain, anchor, make, *signals)


class Each(Map):
    """``Map`` applied to each pair of source and target by itself."""

    def advance(self, state: Any, time: Any, signals: Any) -> None:
        for source, target in zip(self.source, self.target, strict=True):
            signals[target] = self.function(time, signals[source], *self.parameters)


def delayed(chain: Chain, name: str, stage: str, seconds: float, anchor: str) -> Chain:
    """Dead time on the outputs of ``anchor``."""
    return after(chain, anchor, lambda s, t: Delay(name, stage, s, t, seconds))


def on_recorded(chain: Chain, signal: str, make: Callable[[Names, Names], Wired]) -> Chain:
    """An operator behind everything else that makes ``signal``, noise included: changes of stored samples."""
    return after(chain, last_writer(chain, signal), make, signal)


def height_scale(chain: Chain) -> float:
    """The height that the chain's tissue and opening make typical, m."""
    scale: float = chain["softening"].parameters[1]  # type: ignore[attr-defined]
    return scale
