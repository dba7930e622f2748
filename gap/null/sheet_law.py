"""The diagnosis' reduced sheet by its parameters, and the laws of memory that a person's skin may follow.

Simple laws have two relaxation times or a power law of time; the usual one has any relaxation spectrum. Further ones,
each a textbook's, are tried where no simple one is at the noise. Other memories: of strain beside a spring, Maxwell's
arms beside an elastic sheet (Holzapfel 1996), consolidation (Terzaghi 1943), activated flow (Eyring 1936), springs that
slip (Iwan 1967). Other elastic curves: not the same this way and that, on a bed that stiffens when it is pushed, with a
toe, stiffening along each axis apart, chains that come to their end (Arruda and Boyce 1993), two families of fibres
(Holzapfel, Gasser and Ogden 2000). And the best of these memories with each of these curves. A law that is less simple
must earn its freedom.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gap.inference.hypothesis import FROZEN
from gap.null.sheet_operators import (
    USED_UP,
    Activated,
    Apart,
    Arms,
    Bedding,
    Chains,
    Consolidation,
    Fibres,
    Skew,
    Springs,
)
from gap.null.skin_laws import bounded_exp
from sim_devices.chain import Chain, FloatArray
from sim_devices.effects.tissue import spectrum
from sim_devices.stages import kernels
from sim_devices.stages.operators import Law as MemoryLaw
from sim_devices.stages.operators import Wired, after, before
from sim_devices.stages.robot import xyz
from sim_devices.stages.sheet import principal_axes
from sim_devices.stages.tissues import SheetTissue

RELAXATION_TIMES = tuple(0.025 * 2.0**k for k in range(15))
"""s, up to 400: dense enough for any relaxation spectrum. Three to a decade are not: a slow mode in between then earns
up to 80 nats on sound skin."""
SPECTRUM = tuple(f"relaxation{k + 1}" for k in range(len(RELAXATION_TIMES)))
MODES = 0.1, 3.0
"""s, about which the times of a simple law's two modes are sought."""
QUICK_MODE = 0.0, 1.0
"""Logarithms over the quicker of these from which fits begin: from one of them most stop early."""
SLOW_MODE = 0.0, 2.3
"""The same of a memory of strain, which a spring beside it makes quicker."""
TURNED = 0.0, -0.8
"""rad: flow or slip along the principal axes does not find them from half a right angle off."""
MODE = 0.15
"""Share of the force that each of them takes, to begin from."""
POWER, EXPONENT = 0.4, 0.2
"""The same for a power law: share of the force that goes within the spectrum's range, and its exponent."""
STEEPEST = 1e3
"""Largest exponent of the elastic curve: with a length as large as that, it is Fung's exponential of the energy."""
SLOWEST, FASTEST = 1e4, 1e-2
"""s, of the spectrum that stands for a power law."""
YIELDS = {"yield1": 0.1, "yield2": 0.27, "yield3": 0.6}
"""Of the typical displacement, about which springs are sought that slip there."""
SLIPS = "slip1", "slip2", "slip3"
"""Shares of those springs."""
SKEWS = tuple(f"skew{k + 1}" for k in range(10))
"""Coefficients of a cubic potential."""
ARMS = {"arm1": 0.1, "arm2": 1.0, "arm3": 10.0}
"""s, about which the times of Maxwell's arms beside an elastic sheet are sought."""
ARM_TIMES = "arm_time1", "arm_time2", "arm_time3"
"""Their logarithms above that; `EVEN` is how far their springs are as stiff in each direction."""
EVEN = "arm_even"
TOE = 0.4
"""Of the typical displacement, about which it is sought within which skin is soft."""
FIBRES: Sequence[Mapping[str, float]] = [
    {"fibre_angle": angle, "fibre_spread": spread} for angle in (0.0, 1.2) for spread in (0.0, -0.7)
]
"""rad, about none and a quarter turn between the families, from which fits of fibres begin."""
AMOUNTS: Mapping[str, tuple[str, ...]] = {
    "amount1": ("time1",),
    "amount2": ("time2",),
    "power": ("exponent",),
    "spring": (),
    "arm1": (ARM_TIMES[0], EVEN),
    "arm2": ARM_TIMES[1:2],
    "arm3": ARM_TIMES[2:],
    "closing": (),
    "activation": (),
    **{slip: (at,) for slip, at in zip(SLIPS, YIELDS, strict=True)},
    **dict.fromkeys(SKEWS, ()),
    **dict.fromkeys(("push", "pull"), ()),
    "toe": ("toe_reach",),
    "apart": ("apart_length",),
    "chains": (),
    "fibres": ("fibre_length", "fibre_angle", "fibre_spread"),
}
"""Amounts of a law's optional parts, and the parameters that are nothing without them."""
OWN = tuple(name for name in AMOUNTS if name not in ("amount1", "amount2", "power"))
"""Those that are more than a linear memory, which a sheet has itself."""
TISSUE_SD: Mapping[str, float] = {
    **dict.fromkeys(("stiffness1", "stiffness2", "stiffness3"), 1.0),  # logarithms
    "angle": 1.5,
    **dict.fromkeys(("tilt_x", "tilt_y"), 0.1),  # rad: nobody levels a forearm
    "length": 0.7,  # logarithm
    "stiffening": 0.3,
    "isotropy": 0.5,
    "softening": 0.04,
    "softening_rise": 0.5,  # logarithms
    "softening_fall": 0.5,
    "softening_end": 0.5,
    **dict.fromkeys(SPECTRUM, 0.1),
    **dict.fromkeys(("amount1", "amount2"), 0.3),
    "power": 0.4,
    "spring": 1.0,  # beside a memory of strain, of the secant stiffness
    **dict.fromkeys(ARMS, 0.7),  # of the secant stiffness
    EVEN: 0.5,
    "closing": 1.0,  # logarithm of times at the typical displacement
    "activation": 4.0,  # of the strongest force
    **dict.fromkeys(SLIPS, 0.5),  # of the secant stiffness
    **dict.fromkeys(SKEWS, 0.2),  # of the secant stiffness
    **dict.fromkeys(("push", "pull"), 0.5),  # of the secant stiffness
    "toe": 0.4,  # of the force
    "apart": 0.5,  # logarithm of the force at the typical displacement
    "chains": 0.3,  # of their length, used up at the typical displacement
    "fibres": 0.5,  # of the secant stiffness
    **dict.fromkeys(("time1", "time2", *ARM_TIMES), 1.5),  # logarithms
    "exponent": 0.5,
    **dict.fromkeys(("toe_reach", "apart_length", "fibre_length"), 0.7),  # logarithms
    **dict.fromkeys(("fibre_angle", "fibre_spread"), 1.5),  # rad
    **dict.fromkeys(YIELDS, 1.0),  # logarithms
}
"""Widths of the prior, about nought, of all that a law may free."""
TISSUE = tuple(TISSUE_SD)
OF_SHEET = TISSUE[: TISSUE.index(SPECTRUM[0])]
"""Those that every law has."""


@dataclass(frozen=True)
class Law:
    """Widths (t,) of the prior of the tissue's parameters, about nought, and where (t,) fits begin."""

    sd: tuple[float, ...]
    guesses: tuple[tuple[float, ...], ...]


def _relaxing(
    begin: dict[str, float],
    quicker: Sequence[float] = (0.0,),
    angles: Sequence[float] = (0.0,),
    also: Sequence[Mapping[str, float]] = ({},),
) -> Law:
    """The law that relaxes from the amounts ``begin`` on, its first time from any of ``quicker``, and not otherwise;
    its principal axes are turned by any of ``angles`` to begin with, and other parameters are any of those in ``also``.
    """
    sd = dict(TISSUE_SD)
    for amount in (*SPECTRUM, *AMOUNTS):
        if amount not in begin:
            sd.update(dict.fromkeys((amount, *AMOUNTS.get(amount, ())), FROZEN))
    places = (begin | {"time1": first, "angle": angle, **at} for first in quicker for angle in angles for at in also)
    return Law(tuple(sd.values()), tuple(tuple(at.get(name, 0.0) for name in TISSUE) for at in places))


TWO_TIMES = dict.fromkeys(("amount1", "amount2"), MODE)
ANY_TIMES = dict.fromkeys(SPECTRUM, 0.5 / len(SPECTRUM))
LAWS = (
    _relaxing(TWO_TIMES, QUICK_MODE),
    _relaxing({"power": POWER}),
    _relaxing(ANY_TIMES),
)
"""The simple ones and, last, the usual one."""
MEMORIES = (
    _relaxing(TWO_TIMES | {"spring": 0.05}, SLOW_MODE),
    _relaxing(dict.fromkeys(ARMS, 0.2), angles=TURNED),
    _relaxing(TWO_TIMES | {"closing": -0.3}, QUICK_MODE),
    _relaxing(TWO_TIMES | {"activation": 2.0}, QUICK_MODE, TURNED),
    _relaxing(TWO_TIMES | dict.fromkeys(SLIPS, 0.1), QUICK_MODE, TURNED),
)
PLAIN = LAWS[-1]
CURVES = (
    _relaxing(TWO_TIMES | dict.fromkeys(SKEWS, 0.0), QUICK_MODE),
    _relaxing(TWO_TIMES | {"push": 0.1, "pull": 0.0, "toe": 0.1}, QUICK_MODE),
    _relaxing(ANY_TIMES | {"apart": 0.2}, angles=TURNED),
    _relaxing(ANY_TIMES | {"chains": 0.2}),
    _relaxing(ANY_TIMES | {"fibres": 0.2}, also=FIBRES),
)
"""Those that are tried where no simple one is at the noise: sheets of another memory, the usual one by itself, or
sheets of another elastic curve."""
OF_CURVES = tuple(p for a in (*SKEWS, "push", "pull", "toe", "apart", "chains", "fibres") for p in (a, *AMOUNTS[a]))
"""Parameters of the other elastic curves."""


def joined(memory: Law, curve: Law, remembered: FloatArray, bent: FloatArray) -> Law:
    """The law of a sheet with one law's ``memory`` and another's elastic ``curve``, from fits (p,) of both: the sheet's
    own parameters of either."""
    of_curve, of_sheet = np.isin(TISSUE, OF_CURVES), np.isin(TISSUE, OF_SHEET)
    sd = np.where(of_curve, curve.sd, memory.sd)
    known, other = remembered[: len(TISSUE)], bent[: len(TISSUE)]
    begins = [np.where(of_curve, guess, known) for guess in curve.guesses]
    begins.append(np.where(of_curve | of_sheet, other, known))
    return Law(tuple(sd.tolist()), tuple(tuple(begin.tolist()) for begin in begins))


def sheet(nuisance: FloatArray, base: SheetTissue, typical: float) -> SheetTissue:
    """The sheet at a nuisance vector (p,), the tissue's parameters first: as ``base`` but for them.

    Its stiffness is the secant one at a ``typical`` displacement (m), ``stiffening`` the logarithm of what that is
    above the one at rest; the length is then only the curve's shape. Slope and exponent at rest instead would make a
    valley so bent that fits take hundreds of steps and stop early.
    """
    c = dict(zip(TISSUE, nuisance.tolist(), strict=False))
    length = base.length * _scale(c["length"], 3.0)
    nominal, here = (math.log1p((typical / x) ** 2) for x in (base.length, length))
    exponent = min(max((base.exponent * nominal + c["stiffening"]) / here, -0.3), STEEPEST)
    at_rest = base.exponent * nominal - exponent * here
    k1, k2, k3 = (
        k * math.exp(min(max(c[f"stiffness{i + 1}"] + at_rest, -8.0), 5.0)) for i, k in enumerate(base.stiffness)
    )
    memory = _memory(c)
    return replace(
        base,
        stiffness=(k1, k2, k3),
        angle=base.angle + c["angle"],
        tilt=(c["tilt_x"], c["tilt_y"]),
        length=length,
        exponent=exponent,
        isotropy=0.5 + c["isotropy"],
        relaxation=tuple(g for g, _ in memory),
        times=tuple(tau for _, tau in memory),
        softening=base.softening + c["softening"],
        softening_rise=base.softening_rise * _scale(c["softening_rise"], 2.0),
        softening_fall=base.softening_fall * _scale(c["softening_fall"], 2.0),
        softening_end=min(max(c["softening_end"], 0.0), 1.0),
    )


def unwound(nuisance: FloatArray) -> FloatArray | None:
    """A nuisance vector (p,) without the half turns that its angle has made, which change nothing but the prior's
    penalty; None where it has made none."""
    out, angle = nuisance.copy(), TISSUE.index("angle")
    out[angle] -= np.pi * np.round(out[angle] / np.pi)
    return None if out[angle] == nuisance[angle] else out


def quantities(tissue: SheetTissue) -> Mapping[str, tuple[float, str]]:
    """The sheet's parameters for a report: value and unit, SI."""
    along = zip(("along", "across", "normal"), tissue.stiffness, strict=True)
    return {
        **{f"stiffness_{name}": (value, "N/m") for name, value in along},
        "angle": (tissue.angle, "rad"),
        "stiffening_length": (tissue.length, "m"),
        "stiffening_exponent": (tissue.exponent, "1"),
        "relaxation": (float(sum(tissue.relaxation)), "1"),
    }


Made = Callable[[tuple[str, ...], tuple[str, ...]], Wired] | None
"""Makes an operator from names of forces and of what it makes of them."""


def rewired(chain: Chain, nuisance: FloatArray, typical: float, strongest: float) -> Chain:
    """The chain of a sheet with the further parts of its law at a nuisance vector (p,): an elastic curve, then a memory
    that is no linear one of the force, then what is beside the sheet. ``typical`` displacement in m, ``strongest``
    force in N."""
    c = dict(zip(TISSUE, nuisance.tolist(), strict=False))
    if not any(c[name] for name in OWN):
        return chain
    skin: SheetTissue = chain["tissue"].tissue  # type: ignore[attr-defined]
    secant = bounded_exp(skin.exponent * math.log1p((typical / skin.length) ** 2))
    stiffness = np.array(skin.stiffness) * secant
    if c["apart"]:
        chain = _apart(chain, skin, c["apart"], typical * _scale(c["apart_length"], 3.0), typical)
    prony = _prony(skin)
    beside = _beside(c, skin, tuple(stiffness.tolist()), typical)
    memory, curve = _memory_of_force(c, skin, prony, typical, strongest), _curve(c, skin, stiffness, typical)
    if curve or memory or c["spring"]:  # the sheet's own memory would be ahead of them
        chain = chain.tuned("tissue", tissue=replace(skin, relaxation=(), times=()))
    if c["spring"]:
        chain = before(chain, "tissue", lambda s, t: MemoryLaw("strain_memory", "tissue", s, t, kernels.prony, prony))
    elif curve and not memory:
        memory = partial(MemoryLaw, "memory", "tissue", kernel=kernels.prony, parameters=prony)
    strained = chain["tissue"].source  # type: ignore[attr-defined]
    for part in (beside, memory, curve and (lambda s, t: curve("curve", "tissue", s + strained, t))):
        chain = after(chain, "tissue", part) if part else chain
    return chain


def _prony(skin: SheetTissue) -> tuple[float, ...]:
    """The sheet's own memory, as of `kernels.prony`."""
    return 1.0, *(x for g, tau in zip(skin.relaxation, skin.times, strict=True) for x in (-g, tau))


def _memory_of_force(
    c: Mapping[str, float], skin: SheetTissue, prony: tuple[float, ...], typical: float, strongest: float
) -> Made:
    """A memory of the force that is not linear."""
    if c["closing"]:
        (quick, slow), closing = _modes(c), c["closing"] / typical**2
        return lambda s, t: Consolidation("memory", "tissue", s + xyz("skin"), t, quick, slow, closing)
    if c["activation"]:
        parameters = (c["activation"] / strongest, *prony[1:])
        return lambda s, t: Activated("memory", "tissue", s, t, skin.angle, parameters)
    return None


def _beside(c: Mapping[str, float], skin: SheetTissue, springs: tuple[float, ...], typical: float) -> Made:
    """Shares of ``springs`` (N/m along the axes) beside the sheet: behind Maxwell's dashpots, which soften with it;
    slipping one after another, about shares of the ``typical`` way (m); or whole, beside a memory of strain."""
    if c["arm1"]:
        times = (tau * _scale(c[name], 4.0) for name, tau in zip(ARM_TIMES, ARMS.values(), strict=True))
        arms = tuple(zip((c[name] for name in ARMS), times, strict=True))
        even = sum(springs) / len(springs)
        own = tuple(k + c[EVEN] * (even - k) for k in springs)
        shape = skin.angle, arms, (skin.softening, skin.softening_force, *skin.softening_law)
        return lambda s, t: Arms("arms", "tissue", s + xyz("skin"), t, own, *shape)
    if c["slip1"]:
        lengths = [at * typical * bounded_exp(c[name]) for name, at in YIELDS.items()]
        slips = tuple(zip((c[name] for name in SLIPS), lengths, strict=True))
        return lambda s, t: Springs("slips", "tissue", s + xyz("skin"), t, springs, skin.angle, slips)
    if c["spring"]:
        shares = tuple(c["spring"] * k for k in springs)
        return lambda s, t: Springs("spring", "tissue", s + xyz("skin"), t, shares, skin.angle)
    return None


def _apart(chain: Chain, skin: SheetTissue, stiffening: float, length: float, typical: float) -> Chain:
    """The chain of a sheet whose force grows along each of its axes by itself, by the logarithm ``stiffening`` at the
    ``typical`` way, with a curve of some ``length`` (m)."""
    exponent = min(max(stiffening / math.log1p((typical / length) ** 2), -0.3), STEEPEST)
    axes = tuple(principal_axes(skin).ravel().tolist())
    return before(chain, "tissue", lambda s, t: Apart("apart", "tissue", s, t, axes, exponent, length))


def _curve(
    c: Mapping[str, float], skin: SheetTissue, secant: FloatArray, typical: float
) -> Callable[..., Wired] | None:
    """Makes the operator of an elastic law's further part, about a ``secant`` stiffness (3,) N/m at the ``typical`` way
    (m); nothing of a law that has none."""
    if c["chains"]:
        axes = principal_axes(skin)
        matrix = axes @ np.diag(skin.stiffness) @ axes.T
        end = float(np.mean(skin.stiffness)) * typical**2 / min(max(c["chains"], FROZEN), USED_UP)
        return partial(Chains, matrix=tuple(matrix.ravel().tolist()), end=end)
    if c["fibres"]:
        length = typical * _scale(c["fibre_length"], 2.0)
        at_rest = c["fibres"] * float(np.mean(secant[:2])) * math.exp(-min((typical / length) ** 2, 20.0))
        spread = math.pi / 4 + c["fibre_spread"]
        return partial(Fibres, stiffness=at_rest, angle=c["fibre_angle"], spread=spread, length=length)
    if c["push"] or c["pull"] or c["toe"]:
        normal = float(secant[2]) / typical
        reach = TOE * typical * _scale(c["toe_reach"], 3.0)
        return partial(Bedding, push=c["push"] * normal, pull=c["pull"] * normal, toe=c["toe"], reach=reach)
    if not any(c[name] for name in SKEWS):
        return None
    cubic = np.array([c[name] for name in SKEWS]) * float(np.mean(secant)) * typical
    return partial(Skew, cubic=tuple(cubic.tolist()), length=typical)


def _scale(logarithm: float, most: float) -> float:
    """The factor of a ``logarithm`` that is believed up to ``most`` either way."""
    return math.exp(min(max(logarithm, -most), most))


def _memory(c: Mapping[str, float]) -> list[tuple[float, float]]:
    """Shares of the force that relax, and their times (s)."""
    memory = [(c[name], tau) for name, tau in zip(SPECTRUM, RELAXATION_TIMES, strict=True)]
    memory += _modes(c)
    if c["power"]:
        exponent = min(max(EXPONENT + c["exponent"], -0.5), 1.5)
        pairs = spectrum(SLOWEST, FASTEST, lambda tau: tau**-exponent)
        whole = sum(g for g, _ in pairs)
        memory += [(c["power"] * g / whole, tau) for g, tau in pairs]
    return [(g, tau) for g, tau in memory if abs(g) > FROZEN]


def _modes(c: Mapping[str, float]) -> list[tuple[float, float]]:
    """The two of a simple law."""
    return [(c[f"amount{k + 1}"], tau * _scale(c[f"time{k + 1}"], 4.0)) for k, tau in enumerate(MODES)]
