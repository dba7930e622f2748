"""Features of the parameters of which a model's curves are smoother functions than of the parameters themselves.

Prony terms act on a curve through the relaxation function alone. Its logarithm at a few times says the same as weights
and time constants, and curves are nearly linear in it where they bend strongly in a time constant that may be nearly
anything.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from ..api import Array
from ..emulator import Features
from .cases import Case
from .variables import Variables

WEIGHT = re.compile(r"(.*?)g(\d+)")
EARLIEST, LATEST = 1.0 / 300.0, 1.0  # of the longest recording: when the relaxation function is looked at. What it does
# in the last third cannot be told from before where a term is slow, and an emulator without it was off by 0.3 there
FURTHER = 4  # times more than there are free Prony parameters
LEAST = 0.02  # of the instant stiffness: a relaxation function below it is taken to end there


def features(variables: Variables, cases: Sequence[Case]) -> Features | None:
    """Free parameters as they are, but Prony terms as their relaxation function's logarithm; None without such terms.

    Terms are known by their names: g1, tau1, g2, … after a prefix that they share, such as ``skin.``.
    """
    every = series(variables)
    if not every:
        return None
    span = max(float(np.ptp(case.experiment.time)) for case in cases)
    functions = [_Relaxation(terms, span) for terms in every]
    inside = {k for terms in every for term in terms for k in term.free}
    others = [k for k in range(len(variables.free)) if k not in inside]

    def values(z: Array) -> Array:
        return np.concatenate([z[:, others], *(np.log(f.left(z)[0]) for f in functions)], axis=1)

    def rates(z: Array) -> Array:
        plain = np.zeros((len(z), len(others), z.shape[1]))
        plain[:, range(len(others)), others] = 1.0
        return np.concatenate([plain, *(f.rates(z) for f in functions)], axis=1)

    return Features(values, rates)


def relaxes_wholly(every: Sequence[Sequence[Term]], z: Array) -> NDArray[np.bool_]:
    """Which of the points (b, m) have Prony terms that take the whole stress or more: models refuse them."""
    found = np.zeros(len(z), dtype=bool)
    for terms in every:
        found |= np.sum([term.weight.values(z) for term in terms], axis=0) >= 1.0
    return found


@dataclass(frozen=True)
class Exchange:
    """Prony terms that may change places without changing curves or priors: coordinates (k,) of weights and times, and
    the units (k,) that the weights' coordinates count.

    A posterior has each of its humps k! times then, and a chain that goes from one to another finds nothing new. One
    order of the time constants holds all there is to know.
    """

    weights: tuple[int, ...]
    constants: tuple[int, ...]
    units: tuple[float, ...]

    @property
    def orders(self) -> int:
        """How many orders the terms may stand in."""
        return factorial(len(self.weights))

    def sorted(self, z: Array) -> Array:
        """The points (b, m) with time constants that rise from term to term."""
        found = z.copy()
        order = np.argsort(z[:, self.constants], axis=1)
        found[:, self.constants] = np.take_along_axis(z[:, self.constants], order, axis=1)
        weights = z[:, self.weights] * np.array(self.units)
        found[:, self.weights] = np.take_along_axis(weights, order, axis=1) / np.array(self.units)
        return found

    def in_order(self, z: Array) -> NDArray[np.bool_]:
        """At which of the points (b, m) they rise."""
        return np.asarray(np.all(np.diff(z[:, self.constants], axis=1) >= 0.0, axis=1))


def exchanges(variables: Variables) -> list[Exchange]:
    """Of each Prony series: free terms with the same bounds and priors, to which no other parameter is tied."""
    tied = {t.tied for t in variables.tied}
    found = []
    for terms in series(variables):
        for group in _alike(variables, terms, tied):
            if len(group) > 1:
                weights, constants = [t.weight for t in group], [t.constant.k for t in group]
                units = tuple(w.factor for w in weights)
                found.append(Exchange(tuple(w.k for w in weights), tuple(constants), units))
    return found


def _alike(variables: Variables, terms: Sequence[Term], tied: set[str]) -> list[list[Term]]:
    """The free terms, none of whose symbols is ``tied`` to, in groups of the same bounds and priors."""
    alike: dict[tuple[object, ...], list[Term]] = {}
    for term in terms:
        own = (term.weight.k, term.constant.k)
        if min(own) >= 0 and not tied & {variables.symbols[k] for k in own}:
            frees = [variables.free[k] for k in own]
            kind = tuple((f.lower, f.upper, f.log, f.prior) for f in frees)
            alike.setdefault(kind, []).append(term)
    return list(alike.values())


@dataclass(frozen=True)
class Column:
    """One parameter over the coordinates z (b, m): ``factor`` times exp z_k or z_k, or held where k is negative."""

    k: int
    factor: float
    log: bool

    @staticmethod
    def of(variables: Variables, symbol: str) -> Column:
        tie = next((t for t in variables.tied if t.symbol == symbol), None)
        source, factor = (tie.tied, tie.factor) if tie else (symbol, 1.0)
        if source not in variables.symbols:
            return Column(-1, variables.held[symbol], False)
        k = variables.symbols.index(source)
        free = variables.free[k]
        return Column(k, factor if free.log else factor * free.unit, free.log)

    def values(self, z: Array) -> Array:
        """(b,)"""
        if self.k < 0:
            return np.full(len(z), self.factor)
        return np.asarray(self.factor * (np.exp(z[:, self.k]) if self.log else z[:, self.k]))

    def slope(self, values: Array) -> Array:
        """(b,): derivative by its own coordinate."""
        return values if self.log else np.full_like(values, self.factor)


@dataclass(frozen=True)
class Term:
    """Weight and time constant of one Prony term."""

    weight: Column
    constant: Column

    @property
    def free(self) -> set[int]:
        return {c.k for c in (self.weight, self.constant) if c.k >= 0}


def series(variables: Variables) -> list[list[Term]]:
    """The Prony series with a free parameter, without terms that are held at nothing."""
    found: dict[str, list[Term]] = {}
    for symbol in variables.info.symbols:
        match = WEIGHT.fullmatch(symbol)
        if match and (constant := f"{match[1]}tau{match[2]}") in variables.info.symbols:
            term = Term(Column.of(variables, symbol), Column.of(variables, constant))
            if term.weight.k >= 0 or term.weight.factor:
                found.setdefault(match[1], []).append(term)
    return [terms for terms in found.values() if any(term.free for term in terms)]


class _Relaxation:
    """The share of the stress that is left at each of some times."""

    def __init__(self, terms: Sequence[Term], span: float) -> None:
        self.terms = terms
        free = len(set().union(*(term.free for term in terms)))
        self.times = np.geomspace(EARLIEST * span, LATEST * span, free + FURTHER)

    def left(self, z: Array) -> tuple[Array, NDArray[np.bool_]]:
        """(b, times) at points (b, m), and where it was cut off."""
        total = np.ones((len(z), self.times.size))
        for term in self.terms:
            fading = np.exp(-self.times / term.constant.values(z)[:, None])
            total -= term.weight.values(z)[:, None] * (1.0 - fading)
        return np.maximum(total, LEAST), total < LEAST

    def rates(self, z: Array) -> Array:
        """(b, times, m): derivatives of its logarithm."""
        left, ended = self.left(z)
        found = np.zeros((*left.shape, z.shape[1]))
        for term in self.terms:
            weight, constant = term.weight.values(z), term.constant.values(z)
            fading = np.exp(-self.times / constant[:, None])
            if term.weight.k >= 0:
                found[:, :, term.weight.k] -= (1.0 - fading) * term.weight.slope(weight)[:, None]
            if term.constant.k >= 0:
                slope = (weight * term.constant.slope(constant) / constant**2)[:, None]
                found[:, :, term.constant.k] += slope * fading * self.times
        return np.where(ended[:, :, None], 0.0, found / left[:, :, None])
