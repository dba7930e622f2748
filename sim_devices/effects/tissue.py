"""Effects of skin that the nominal reduced tissue does not have."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim_devices.chain import Chain, FloatArray, Signals
from sim_devices.effects.build import (
    ALL,
    PHASE,
    ROBOT,
    SUCTION,
    Values,
    choice,
    chosen,
    effect,
    for_a_while,
    height_scale,
    law_after,
    map_after,
    shape,
    signed,
    strength,
)
from sim_devices.effects.interface import Slip
from sim_devices.effects.sheet_forces import (
    Forces,
    deep_layer_force,
    fibre_force,
    stiffening_force,
    tension_for_a_while,
    tension_force,
    tether_force,
)
from sim_devices.stages import kernels, laws
from sim_devices.stages.operators import Wired, after
from sim_devices.stages.robot import xyz

_SKIN = xyz("skin")


@dataclass(frozen=True)
class Softening(Wired):
    """Force (x, y, z) less the softening by its own magnitude, by ``kernel`` with its ``parameters``; it begins anew at
    each of ``marks`` (s)."""

    kernel: kernels.Kernel
    parameters: tuple[float, ...]
    marks: tuple[float, ...] = ()

    def fresh(self) -> Any:
        return np.zeros(kernels.STATE), np.array(self.parameters)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        force = np.stack([signals[s] for s in self.source])
        size = np.sqrt((force**2).sum(axis=0))
        softened = kernels.anew(self.kernel, state[0], time, size, state[1], self.marks)
        factor = np.divide(softened, size, out=np.ones(len(time)), where=size > 0)
        signals.update(zip(self.target, force * factor, strict=True))


def spectrum(slowest: float, fastest: float, weight: Callable[[float], float]) -> list[tuple[float, float]]:
    """Pairs (g, tau) at half decades that stand for a continuous spectrum ``weight(tau)`` per unit of ln tau."""
    n = max(round(2 * math.log10(slowest / fastest)), 1)
    taus = [fastest * (slowest / fastest) ** ((i + 0.5) / n) for i in range(n)]
    return [(weight(t) * math.log(slowest / fastest) / n, t) for t in taus]


def _memory(pairs: list[tuple[float, float]], sign: float) -> tuple[float, ...]:
    return (1.0, *(x for g, tau in pairs for x in (sign * g, tau)))


def _is_robot(chain: Chain) -> bool:
    return chain.instrument == "microrobot"


def _creep(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 0:
        pairs = [(v["amount"], v["tau"])]
    else:  # the same amount spread evenly over one and a half decades of time: logarithmic creep
        pairs = spectrum(v["tau"] * 5, v["tau"] / 6, lambda _: v["amount"] / math.log(30.0))
    anchor, sign = ("tissue", -1.0) if _is_robot(chain) else ("memory", 1.0)
    share = 1.0 + v["amount"] if _is_robot(chain) else 1.0  # relaxation never exceeds the whole force
    pairs = [(g / share, tau) for g, tau in pairs]
    return law_after(chain, anchor, "slow_creep", "tissue", kernels.prony, _memory(pairs, sign))


def power_law_creep(amount: float, exponent: float) -> list[tuple[float, float]]:
    """Pairs (g, tau s) that creep as ``amount`` times (t/s) to the power ``exponent``."""
    return spectrum(1e4, 1e-2, lambda tau: amount * exponent / math.gamma(1.0 - exponent) * tau**exponent)


def _power_law(chain: Chain, v: Values) -> Chain:
    a, n = v["amount"], v["exponent"]
    if _is_robot(chain):
        pairs = spectrum(1e4, 1e-2, lambda tau: tau**-n)
        total = sum(g for g, _ in pairs) * (1.0 + a) / a
        pairs = [(g / total, tau) for g, tau in pairs]
        return law_after(chain, "tissue", "power_law_creep", "tissue", kernels.prony, _memory(pairs, -1.0))
    return law_after(chain, "memory", "power_law_creep", "tissue", kernels.prony, _memory(power_law_creep(a, n), 1.0))


def _residual(chain: Chain, v: Values) -> Chain:
    parameters = (v["amount"], v["threshold"] * height_scale(chain), v["rise"], v["fall"])
    return law_after(chain, "residual", "viscoplastic_residual", "tissue", kernels.yield_flow, parameters)


def _residual_robot(chain: Chain, v: Values) -> Chain:
    name, stage, share = "viscoplastic_residual", "tissue", v["amount"] / (1.0 + v["amount"])
    if chosen(v, "form") == 1:
        # In its plane, so that on skin nothing tells it from a support that slips: they are one class.
        return after(chain, "glue", lambda s, t: Slip(name, stage, s, t, v["threshold"] * 1e-3, share))
    parameters = (-share, v["threshold"] * 1e-3, v["rise"], v["fall"])
    return law_after(chain, "glue", name, stage, kernels.yield_flow, parameters)


def _preconditioning(chain: Chain, v: Values) -> Chain:
    name, stage = "preconditioning", "tissue"
    if chosen(v, "form") == 1:
        anchor, sign = ("tissue", -1.0) if _is_robot(chain) else ("softening", 1.0)
        return law_after(chain, anchor, name, stage, kernels.mullins, (sign * v["amount"], v["forgetting"]))
    shapes: tuple[float, ...]
    if chosen(v, "form") == 3 and _is_robot(chain):
        marks = chain["latency"].marks  # type: ignore[attr-defined]
        softer = (-v["amount"] / (1.0 + v["amount"]), 0.5 * v["rise"])
        return after(chain, "tissue", lambda s, t: Softening(name, stage, s, t, kernels.worked_off, softer, marks))
    if chosen(v, "form") == 3:
        work = v["rise"] * height_scale(chain)
        return law_after(chain, "softening", name, stage, kernels.worked, (v["amount"], v["virgin"], v["band"], work))
    if chosen(v, "form") == 2:
        kernel, shapes = kernels.by_loadings, (v["loadings"],)
    else:
        scale = 0.5 if _is_robot(chain) else height_scale(chain)
        kernel, shapes = kernels.exposure_gain, (scale, v["rise"], v["forgetting"], 0.0)
    if _is_robot(chain):
        parameters = (-v["amount"] / (1.0 + v["amount"]), *shapes)
        return after(chain, "tissue", lambda s, t: Softening(name, stage, s, t, kernel, parameters))
    return law_after(chain, "softening", name, stage, kernel, (v["amount"], *shapes))


def _with_skin(chain: Chain, name: str, function: Callable[..., Forces], parameters: tuple[float, ...]) -> Chain:
    """Forces changed in view of the skin's displacement."""
    return map_after(chain, "tissue", name, "tissue", function, parameters, reading=_SKIN)


def _deep_layer(chain: Chain, v: Values) -> Chain:
    if _is_robot(chain):
        parameters = (400.0 * v["stiffness"], v["start"] * 1e-3, 0.15e-3 * v["start"])
        return _with_skin(chain, "missing_deep_layer", deep_layer_force, parameters)
    start = v["start"] * height_scale(chain)
    parameters = (v["stiffness"], start, 0.15 * start)
    return map_after(chain, "residual", "missing_deep_layer", "tissue", laws.layered, parameters)


def _prestress(chain: Chain, v: Values) -> Chain:
    law, more = (
        (tension_force, ()),
        (fibre_force, ("slack",)),
        (tension_for_a_while, ("moment", "duration")),
    )[chosen(v, "form")]
    parameters = (v["stiffness"], v["angle"], *(v[name] for name in more))
    return _with_skin(chain, "prestress_anisotropy", law, parameters)


def _stiffening(chain: Chain, v: Values) -> Chain:
    if _is_robot(chain):
        return _with_skin(chain, "strain_stiffening", stiffening_force, (v["strength"], v["exponent"]))
    parameters = (v["strength"], v["exponent"], 0.5 * height_scale(chain))
    return map_after(chain, "elastic", "strain_stiffening", "tissue", laws.stiffening, parameters)


def _tone(chain: Chain, v: Values) -> Chain:
    parameters: tuple[float, ...] = (v["change"], v["tau"], v["form"], v["phase"])
    stronger: Callable[..., FloatArray] = laws.gain_drift
    stiffer: Callable[..., FloatArray] = laws.stiffness_drift
    if chosen(v, "form") == 3:
        parameters = (v["change"], v["moment"], v["duration"], v["ease"])
        stronger, stiffer = laws.gain_for_a_while, laws.softer_for_a_while
    anchor, law = ("tissue", stronger) if _is_robot(chain) else ("softening", stiffer)
    return map_after(chain, anchor, "muscle_tone_change", "tissue", law, parameters)


_RESIDUAL = ("viscoplastic_residual", "tissue")
_RESIDUAL_WORDS = (
    "Deformation that stays after unloading.",
    "Longer pauses; a viscoplastic mode in the tissue model.",
    "W: residual height; Rubin & Bodner 2002; Prager 1956 for the yield point",
)
_RESIDUAL_SHAPE = (
    strength("amount", "1", 0.01, 2.0, 0.25, "residual against response, when loaded for long"),
    shape("threshold", "1", 0.0, 0.8, 0.0, "response below which nothing stays, against the typical one"),
)
_RISE, _FALL = shape("rise", "s", 0.5, 120.0, 8.0, log=True), shape("fall", "s", 60.0, 1e5, 3000.0, log=True)


_FIRST_PATH = (
    shape("virgin", "1", 0.0, 1.0, 0.5, "share that is there again at the greatest load", only=(3,)),
    shape("band", "1", 1e-3, 0.5, 0.02, "share of the greatest load below which it is whole", log=True, only=(3,)),
)


def _preconditioned(instruments: tuple[str, ...], *further: str) -> Any:
    return effect(
        "preconditioning", "tissue", instruments,
        "The first loadings differ from later ones: skin softens by loading.",
        "Load a few times before the measurement; leave the same pause before every repeat.",
        "first curve of a series differs (reported; Mullins 1969 for the form by maximum)",
        (
            strength("amount", "1", 0.01, 1.0, 0.2, "softening in the end"),
            shape("rise", "s", 0.5, 120.0, 8.0, "time under load that it takes", log=True, only=(0, 3)),
            shape("forgetting", "s", 100.0, 1e5, 2000.0, "time of rest that undoes it", log=True, only=(0, 1)),
            shape("loadings", "1", 0.3, 20.0, 2.0, "loadings that it takes", log=True, only=(2,)),
            *(_FIRST_PATH if instruments == SUCTION else ()),
            choice("form", 0, "by exposure", "by the greatest load so far", "by the number of loadings", *further),
        ),
        _preconditioning,
    )  # fmt: skip


EFFECTS = (
    effect(
        "slow_creep", "tissue", ALL,
        "A slow relaxation mode that the nominal tissue lacks.",
        "Longer holds and recovery; a slow term in the tissue model.",
        "F needs three to five Prony terms; W and M see drift over minutes",
        (
            strength("amount", "1", 0.01, 2.0, 0.3, "of the response, after a time much longer than tau"),
            shape("tau", "s", 10.0, 3000.0, 100.0, log=True),
            choice("form", 0, "exponential", "logarithmic about tau"),
        ),
        _creep,
    ),
    effect(
        "power_law_creep", "tissue", ALL,
        "Fractional (power-law) memory.",
        "A fractional element in the tissue model.",
        "springpot; Magin 2010; skin creeps over decades of time",
        (
            strength("amount", "1", 0.01, 2.0, 0.25, "creep in 1 s against the instantaneous response"),
            shape("exponent", "1", 0.05, 0.7, 0.25),
        ),
        _power_law,
    ),
    effect(
        *_RESIDUAL, SUCTION, *_RESIDUAL_WORDS, (*_RESIDUAL_SHAPE, _RISE, _FALL), _residual,
    ),
    effect(
        *_RESIDUAL, ROBOT, *_RESIDUAL_WORDS,
        (
            *_RESIDUAL_SHAPE,
            choice("form", 0, "flow under load", "at once, in plane, beyond a yield point"),
            *(replace(p, only=(0,)) for p in (_RISE, _FALL)),
        ),
        _residual_robot,
    ),
    _preconditioned(SUCTION, "by work, and less along the first path"),
    _preconditioned(ROBOT, "by work, anew in each recording, which goes another way"),
    effect(
        "missing_deep_layer", "tissue", ALL,
        "A deeper layer takes part once deformation reaches it.",
        "A layered tissue model; other probe openings or amplitudes.",
        "W: SMAS and muscle under skin",
        (
            strength("stiffness", "1", 0.02, 10.0, 1.0, "deep layer against the layers above it (robot: 400 N/m)"),
            shape("start", "1", 0.1, 1.2, 0.4, "response that reaches it, against the typical height (robot: mm)"),
        ),
        _deep_layer,
    ),
    effect(
        "prestress_anisotropy", "tissue", ROBOT,
        "In-plane tension differs between directions.",
        "Free pre-stress in the model; measure more directions.",
        "M: σx and σy differ by up to two",
        (
            strength("stiffness", "N/m", 5.0, 1500.0, 150.0, "more along, less across"),
            shape("angle", "rad", 0.0, math.pi, 1.2, "direction of the greater tension"),
            shape("slack", "m", 0.0, 1e-3, 0.3e-3, "displacement at which they engage", only=(1,)),
            choice("form", 0, "tension, more along and less across", "fibres that engage late", "tension for a while"),
            *for_a_while(2),
        ),
        _prestress,
    ),
    effect(
        "sub_dermal_tether", "tissue", ROBOT,
        "A one-sided tether: stiffer one way than the opposite.",
        "Measure opposite directions; a tether in the model.",
        "retinacula and scars; M measures θ over the whole circle",
        (
            strength("stiffness", "N/m", 10.0, 3e3, 400.0),
            shape("angle", "rad", 0.0, 2 * math.pi, 0.5, "direction in which it pulls taut"),
            shape("slack", "m", 0.0, 1e-3, 0.4e-3),
        ),
        lambda chain, v: _with_skin(
            chain, "sub_dermal_tether", tether_force, (v["stiffness"], v["angle"], v["slack"])
        ),
    ),
    effect(
        "strain_stiffening", "tissue", ALL,
        "Stiffening with deformation beyond the nominal curve.",
        "A stiffer law at large strain; more levels.",
        "collagen recruitment; Fung 1993",
        (
            strength("strength", "1", 0.02, 10.0, 0.6, "at half the typical height (robot: at 1 mm)"),
            shape("exponent", "1", 1.0, 5.0, 2.0),
        ),
        _stiffening,
    ),
    effect(
        "muscle_tone_change", "tissue", ALL,
        "Stiffness changes during the session.",
        "Let the subject rest and breathe; repeat the first measurement at the end.",
        "muscle activity; gap.md",
        (
            signed("change", "1", 0.6, 0.3, "relative stiffness in the end (form 2: amplitude)"),
            shape("tau", "s", 10.0, 2000.0, 150.0, "time it takes (form 2: period)", log=True, only=(0, 1, 2)),
            choice("form", 1, "linear in time", "towards a new level", "to and fro", "for a while"),
            PHASE,
            *for_a_while(3),
            shape("ease", "s", 0.0, 20.0, 0.0, "within which it comes and goes", only=(3,)),
        ),
        _tone,
    ),
)  # fmt: skip
