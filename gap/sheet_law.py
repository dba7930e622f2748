"""The diagnosis' reduced sheet by its parameters, and the laws of memory that a person's skin may follow.

Simple laws have two relaxation times or a power law of time; the usual one has any relaxation spectrum. What is less
simple must earn its freedom.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gap.hypothesis import FROZEN, FloatArray
from sim_devices.effects.tissue import spectrum
from sim_devices.stages.tissues import SheetTissue

RELAXATION_TIMES = tuple(0.025 * 2.0**k for k in range(15))
"""s, up to 400: dense enough for any relaxation spectrum. Three to a decade are not: a slow mode in between then earns
up to 80 nats on sound skin."""
SPECTRUM = tuple(f"relaxation{k + 1}" for k in range(len(RELAXATION_TIMES)))
MODES = 0.1, 3.0
"""s, about which the times of a simple law's two modes are sought."""
QUICK_MODE = 0.0, 1.0
"""Logarithms over the quicker of these from which fits begin: from one of them most stop early."""
MODE = 0.15
"""Share of the force that each of them takes, to begin from."""
POWER, EXPONENT = 0.4, 0.2
"""The same for a power law: share of the force that goes within the spectrum's range, and its exponent."""
SLOWEST, FASTEST = 1e4, 1e-2
"""s, of the spectrum that stands for a power law."""
MEMORY: Mapping[str, str] = {"amount1": "time1", "amount2": "time2", "power": "exponent"}
"""Amounts of relaxation, and what is nothing without them."""
TISSUE = (
    "stiffness1", "stiffness2", "stiffness3", "angle", "length", "stiffening", "isotropy", "softening",
    *SPECTRUM, *MEMORY, *MEMORY.values(),
)  # fmt: skip
TISSUE_SD = (1.0, 1.0, 1.0, 1.5, 0.7, 0.3, 0.5, 0.04, *[0.1] * len(SPECTRUM), 0.3, 0.3, 0.4, 1.5, 1.5, 0.5)


@dataclass(frozen=True)
class Law:
    """Widths (t,) of the prior of the tissue's parameters, about nought, and where (t,) fits begin."""

    sd: tuple[float, ...]
    guesses: tuple[tuple[float, ...], ...]


def _relaxing(begin: dict[str, float], quicker: Sequence[float] = (0.0,)) -> Law:
    """The law that relaxes from the amounts ``begin`` on, its first time from any of ``quicker``, and not otherwise."""
    sd = dict(zip(TISSUE, TISSUE_SD, strict=True))
    for amount in (*SPECTRUM, *MEMORY):
        if amount not in begin:
            sd[amount] = sd[MEMORY.get(amount, amount)] = FROZEN
    places = (begin | {"time1": first} for first in quicker)
    return Law(tuple(sd.values()), tuple(tuple(at.get(name, 0.0) for name in TISSUE) for at in places))


LAWS = (
    _relaxing(dict.fromkeys(("amount1", "amount2"), MODE), QUICK_MODE),
    _relaxing({"power": POWER}),
    _relaxing(dict.fromkeys(SPECTRUM, 0.5 / len(SPECTRUM))),
)
"""The simple ones and, last, the usual one."""


def sheet(nuisance: FloatArray, base: SheetTissue, typical: float) -> SheetTissue:
    """The sheet at a nuisance vector (p,), the tissue's parameters first: as ``base`` but for them.

    Its stiffness is the secant one at a ``typical`` displacement (m), ``stiffening`` the logarithm of what that is
    above the one at rest; the length is then only the curve's shape. Slope and exponent at rest instead would make a
    valley so bent that fits take hundreds of steps and stop early.
    """
    c = dict(zip(TISSUE, nuisance.tolist(), strict=False))
    length = base.length * float(np.exp(np.clip(c["length"], -3, 3)))
    nominal, here = (float(np.log1p((typical / x) ** 2)) for x in (base.length, length))
    exponent = float(np.clip((base.exponent * nominal + c["stiffening"]) / here, -0.3, 30.0))
    at_rest = base.exponent * nominal - exponent * here
    k1, k2, k3 = (
        k * float(np.exp(np.clip(c[f"stiffness{i + 1}"] + at_rest, -8, 5))) for i, k in enumerate(base.stiffness)
    )
    memory = _memory(c)
    return replace(
        base,
        stiffness=(k1, k2, k3),
        angle=base.angle + c["angle"],
        length=length,
        exponent=exponent,
        isotropy=0.5 + c["isotropy"],
        relaxation=tuple(g for g, _ in memory),
        times=tuple(tau for _, tau in memory),
        softening=base.softening + c["softening"],
    )


def _memory(c: Mapping[str, float]) -> list[tuple[float, float]]:
    """Shares of the force that relax, and their times (s)."""
    memory = [(c[name], tau) for name, tau in zip(SPECTRUM, RELAXATION_TIMES, strict=True)]
    for k, tau in enumerate(MODES):
        memory.append((c[f"amount{k + 1}"], tau * float(np.exp(np.clip(c[f"time{k + 1}"], -4, 4)))))
    if c["power"]:
        exponent = float(np.clip(EXPONENT + c["exponent"], -0.5, 1.5))
        pairs = spectrum(SLOWEST, FASTEST, lambda tau: tau**-exponent)
        whole = sum(g for g, _ in pairs)
        memory += [(c["power"] * g / whole, tau) for g, tau in pairs]
    return [(g, tau) for g, tau in memory if abs(g) > FROZEN]
