"""The library of effects: behaviour of real instruments and skin that the nominal chain lacks.

``effects("cutometer")`` gives those of one instrument by name. Other packages add their own under the entry point
``acquire.effects``: an ``Effect``, an iterable of them, or a function that returns either. One that does not load is
listed by ``broken()`` and disturbs nobody.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from itertools import product

from protocols import units
from sim_devices.chain import Chain, Effect, Parameter
from sim_devices.effects import (
    actuator,
    force_sensor,
    interface,
    processing,
    pulse,
    robot_axes,
    sensor,
    timing,
    tissue,
)
from sim_devices.effects.build import CHOICE

GROUP = "acquire.effects"


def effects(instrument: str | None = None) -> dict[str, Effect]:
    """Effects by name, in the order of the stages; of one instrument, or all.

    Where an effect takes other units on other instruments, the list of all has it as ``name`` for the first one and as
    ``name@instrument`` for the others.
    """
    found: dict[str, Effect] = {}
    for effect in _all()[0]:
        if instrument is None:
            key = effect.name if effect.name not in found else f"{effect.name}@{effect.instruments[0]}"
            found.setdefault(key, effect)
        elif instrument in effect.instruments:
            found.setdefault(effect.name, effect)
    return found


def broken() -> dict[str, str]:
    """Plugins of effects that did not load: name of the entry point -> error."""
    return dict(_all()[1])


def variants(effect: Effect) -> dict[str, Effect]:
    """One effect for each combination of its choices, these fixed: ``backlash[form=1]``; itself if it has none.

    Parameters that mean nothing in a form are fixed as well.
    """
    choices = [p for p in effect.parameters if p.unit == CHOICE and p.name != "seed"]
    if not choices:
        return {effect.name: effect}
    found = {}
    for numbers in product(*(range(int(p.low), int(p.high) + 1) for p in choices)):
        fixed = {p.name: float(n) for p, n in zip(choices, numbers, strict=True)}
        idle = [p for p in effect.parameters if p.only and fixed.get("form") not in p.only]
        if any(fixed.get(p.name, p.default) != p.default for p in idle):
            continue  # a choice that means nothing in this form
        key = f"{effect.name}[{','.join(f'{k}={v:g}' for k, v in fixed.items())}]"
        unused = {p.name: p.default if p.null is None else p.null for p in idle}
        found[key] = _fixed(effect, fixed | unused)
    return found


def parse_effect(text: str, instrument: str | None = None) -> tuple[Effect, dict[str, float]]:
    """The effect and the given parameters, SI, of ``name`` or ``name:parameter=value,...``; values may carry a unit.

    >>> effect, values = parse_effect("regulator_lag:tau=300ms")
    >>> effect.name, values
    ('regulator_lag', {'tau': 0.3})

    Raises ValueError that names the effect, parameter or value it cannot use.
    """
    name, _, rest = text.partition(":")
    known = effects(instrument)
    name = name.strip()
    if name not in known:
        raise ValueError(f"no effect {name!r}{f' of {instrument}' if instrument else ''}; there are {', '.join(known)}")
    effect = known[name]
    parameters = {p.name: p for p in effect.parameters}
    values = {}
    for item in filter(None, (part.strip() for part in rest.split(","))):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not equals or key not in parameters:
            have = ", ".join(parameters)
            raise ValueError(f"effect {name} has no parameter {item!r}; write parameter=value, with one of {have}")
        values[key] = _number(name, parameters[key], value)
    return effect, values


def _number(effect: str, parameter: Parameter, text: str) -> float:
    where = f"effect {effect}, parameter {parameter.name} = {text!r}"
    try:
        value = units.parse_in(text, "" if parameter.unit == CHOICE else parameter.unit)
    except ValueError as error:
        if parameter.unit == CHOICE:
            raise ValueError(f"{where}: a whole number is needed: {parameter.meaning}") from None
        raise ValueError(f"{where}: a number in {parameter.unit} is needed: {error}") from None
    if asked := _impossible(parameter, value):
        raise ValueError(f"{where}: it must be {asked}")
    return value


def _impossible(parameter: Parameter, value: float) -> str:
    """The values that a parameter can have, in words, where ``value`` is none of them; else ''.

    A prior without negative values belongs to a parameter that has none, a logarithmic one to one that is not 0 unless
    that switches the effect off. How far it may go up is anybody's choice.
    """
    if parameter.unit == CHOICE:
        high = math.inf if parameter.name == "seed" else parameter.high
        ends = "0 or more" if math.isinf(high) else f"{parameter.low:g} to {high:g}"
        return "" if value.is_integer() and parameter.low <= value <= high else f"a whole number, {ends}"
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    if parameter.low < 0 or value > 0 or value == parameter.null:
        return ""
    if parameter.scale == "log" and parameter.null != 0:
        return f"more than 0{unit}"
    return "" if value == 0 else f"0{unit} or more"


def _fixed(effect: Effect, fixed: Mapping[str, float]) -> Effect:
    """``effect`` with some of its parameters at ``fixed`` values."""

    def install(chain: Chain, values: Mapping[str, float]) -> Chain:
        return effect.install(chain, {**values, **fixed})

    def scatter(instrument: str, values: Mapping[str, float]) -> Mapping[str, float]:
        return effect.scatter(instrument, {**values, **fixed}) if effect.scatter else {}

    def wander(values: Mapping[str, float]) -> Mapping[str, float]:
        return effect.wander({**values, **fixed}) if effect.wander else {}

    def rhythm(values: Mapping[str, float]) -> Mapping[str, float]:
        return effect.rhythm({**values, **fixed}) if effect.rhythm else {}

    free = tuple(p for p in effect.parameters if p.name not in fixed)
    form = int(fixed.get("form", 0))
    beats = rhythm if rhythm({p.name: p.default for p in effect.parameters}) else None
    return replace(effect, parameters=free, install=install, scatter=scatter, wander=wander, rhythm=beats, form=form)


@cache
def _all() -> tuple[tuple[Effect, ...], tuple[tuple[str, str], ...]]:
    own = [
        e
        for module in (timing, actuator, robot_axes, interface, tissue, pulse, sensor, force_sensor, processing)
        for e in module.EFFECTS
    ]
    added, errors = _plugins(entry_points(group=GROUP))
    return (*own, *added), tuple(errors.items())


def _plugins(entries: Iterable[EntryPoint]) -> tuple[list[Effect], dict[str, str]]:
    """Effects of the entry points, and the error of each that gives none."""
    found: list[Effect] = []
    errors: dict[str, str] = {}
    for entry in entries:
        try:
            made = entry.load()
            made = made() if callable(made) else made
            listed = [made] if isinstance(made, Effect) else list(made)
            wrong = [type(e).__name__ for e in listed if not isinstance(e, Effect)]
            if wrong:
                raise TypeError(f"it gives {wrong[0]} where effects are expected")
            found += listed
        except Exception as error:  # whatever a stranger's module does
            errors[entry.name] = f"{entry.value}: {type(error).__name__}: {error}"
    return found, errors


__all__ = ["GROUP", "broken", "effects", "parse_effect", "variants"]
