"""A term: a few parts with their amounts at one place; as an effect that the diagnosis tries, and as a user's file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from acquire.files import write_text
from gap.inference.hypothesis import Candidate
from gap.rig.generic import GenericEffect
from gap.terms.parts import ERROR, INPUT, OWN, Part, Place, Show, in_si
from sim_devices.chain import Chain, Effect, FloatArray, Parameter, Signals
from sim_devices.stages.operators import Names, Wired, after

TAU_RANGE, RATIO_RANGE = 5.0, 2.0
"""How many times longer or shorter a lag may be than proposed, and by how many times itself a ratio may be off."""
REMEDY = "Find out which part of the instrument does this: the term says when and how much, not why."
SOURCE = "proposed by acquire gap diagnose, which found no effect of the library"


@dataclass(frozen=True)
class Term:
    """Σ amounts_k · parts_k, added to the signals at a place; ``amounts`` in its unit."""

    place: Place
    parts: tuple[Part, ...]
    amounts: tuple[float, ...]

    @property
    def name(self) -> str:
        return f"term_at_{self.place.anchor}"

    def formula(self, show: Show = in_si) -> str:
        """The term as people write it, numbers by ``show``."""
        out = " ".join(
            f"{'−' if a < 0 else '+'} {show(abs(a), self.place.unit)} · {p.text(self.place, show)}"
            for a, p in zip(self.amounts, self.parts, strict=True)
        )
        return out.removeprefix("+ ")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The first part's amount, a strength; the others' in ratio to it and the lags' times, shapes about these."""
        first = self.amounts[0]
        size = max(self.place.size, 2.0 * abs(first))
        out = [Parameter("amount", self.place.unit, -size, size, 0.0, first, meaning="of the first part")]
        for k, (part, amount) in enumerate(zip(self.parts, self.amounts, strict=True), start=1):
            if k > 1:
                ratio, reach = amount / first, RATIO_RANGE * abs(amount / first)
                out.append(Parameter(f"ratio_{k}", "1", ratio - reach, ratio + reach, None, ratio))
            if part.tau:
                low, high = part.tau / TAU_RANGE, part.tau * TAU_RANGE
                out.append(Parameter(f"lag_{k}", "s", low, high, None, part.tau, "log"))
        return tuple(out)

    def at(self, values: Mapping[str, float]) -> Term:
        """The same with other values of its parameters."""
        first = values["amount"]
        amounts = [first, *(first * values[f"ratio_{k}"] for k in range(2, len(self.parts) + 1))]
        parts = [replace(p, tau=values.get(f"lag_{k}", 0.0)) for k, p in enumerate(self.parts, start=1)]
        return Term(self.place, tuple(parts), tuple(amounts))

    def value(self, memory: list[dict[str, Any]], time: FloatArray, signals: Mapping[str, FloatArray]) -> FloatArray:
        """The addition at ``time`` (n,) s; ``memory`` has one dictionary for each part, empty at first."""
        out = np.zeros(len(time))
        for own, part, amount in zip(memory, self.parts, self.amounts, strict=True):
            out += amount * part.value(own, time, signals, part.tau)
        return out


@dataclass(frozen=True)
class Added(Wired):
    """Each target is its source and a term of it, and of the input with the same number."""

    term: Term

    def __hash__(self) -> int:
        return hash((self.name, self.source, self.target, self.term.parts, self.term.amounts))

    def fresh(self) -> Any:
        return [[{} for _ in self.term.parts] for _ in self.target]

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        n = len(self.target)
        for k, target in enumerate(self.target):
            roles = {OWN: signals[self.source[k]]}
            if len(self.source) > n:
                roles[INPUT] = signals[self.source[n + k]]
                roles[ERROR] = roles[INPUT] - roles[OWN]
            changed = roles[OWN] + self.term.value(state[k], time, roles)
            signals[target] = np.minimum(changed, self.term.place.highest)


def _installed(chain: Chain, values: Mapping[str, float], term: Term) -> Chain:
    place = term.place
    if not values["amount"]:
        return chain

    def make(source: Names, target: Names) -> Wired:
        return Added(term.name, place.stage, (*source, *place.inputs), target, term.at(values))

    return after(chain, place.anchor, make)


def as_effect(term: Term, instruments: Sequence[str]) -> Effect:
    """A term at an operator of an instrument's chain, as an effect of the library's kind."""
    return Effect(
        term.name, term.place.stage, tuple(instruments), f"Added to {term.place.names[OWN]}: {term.formula()}.", REMEDY,
        SOURCE, term.parameters, partial(_installed, term=term),
    )  # fmt: skip


def _acting(
    state: dict[str, Any],
    time: FloatArray,
    y: FloatArray,
    related: Mapping[str, FloatArray],
    p: Mapping[str, float],
    term: Term,
) -> FloatArray:
    if not p["amount"]:
        return y
    memory = state.setdefault("parts", [{} for _ in term.parts])
    return y + term.at(p).value(memory, time, {OWN: y, **related})


def as_generic(term: Term) -> GenericEffect:
    """A term at a tap of a rig's model, as an effect of the generic kind."""
    text = f"Added to {term.place.names[OWN]}: {term.formula()}."
    related = next((s for p in term.parts for s in (p.of, p.times) if s not in ("", OWN)), "")
    return GenericEffect(
        term.name, text, REMEDY, term.parameters, partial(_acting, term=term), related, taps=(term.place.anchor,)
    )


def candidate_of(term: Term, blocks: Sequence[str]) -> Candidate:
    """A term as a possible cause in some blocks of data."""
    key = f"{term.name}@{term.place.anchor}" if term.place.rig else term.name
    return Candidate(key, term.name, term.place.stage, term.parameters, tuple(blocks), remedy=REMEDY)


def save_term(term: Term, path: Path, instrument: str, remarks: str = "") -> Path:
    """Write a term as a file for ``acquire gap diagnose --effects``. Raises CannotWrite."""
    made = "as_generic(TERM)" if term.place.rig else f"as_effect(TERM, {(instrument,)!r})"
    helper = "as_generic" if term.place.rig else "as_effect"
    parts = "".join(f"        {_written(part)},\n" for part in term.parts)
    text = (
        f'"""Added to {term.place.names[OWN]}: {term.formula()}.\n{remarks}\n\n'
        f"    acquire gap diagnose SESSION --effects {path.name}\n\n"
        'weighs it against the library; `amounts` (SI) and `parts` may be changed.\n"""\n\n'
        f"from gap.terms.parts import Part, Place\nfrom gap.terms.term import Term, {helper}\n\nTERM = Term(\n"
        f"    place={_written(term.place)},\n    parts=(\n{parts}    ),\n    amounts={term.amounts!r},\n)\n"
        f"EFFECT = {made}\n"
    )
    return write_text(path, text)


def _written(value: Part | Place) -> str:
    """A part or place as code, without default values."""
    told = [(f.name, getattr(value, f.name), f.default) for f in fields(value)]
    said = ", ".join(f"{name}={v!r}" for name, v, usual in told if v != usual and v not in ({}, ()))
    return f"{type(value).__name__}({said})"
