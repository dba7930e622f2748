"""The suction models that papers F and W describe: parameters with their bounds and sources, geometries."""

from __future__ import annotations

from dataclasses import replace

from ..api import ModelInfo, Parameter
from ..law import Law
from ..materials.hyperelastic import dispersed_fibres, hyperelastic, mooney_rivlin, neo_hooke
from ..materials.rubin_bodner import RUBIN_BODNER, RUBIN_BODNER_GAMMA
from ..materials.yeoh_qlv import yeoh_qlv
from .models import SuctionModel

PA, HZ, S = "Pa", "Hz", "s"


def _interface(friction: float, spring: float, source: str) -> tuple[Parameter, ...]:
    return (
        Parameter("friction", "", 0.0, 2.0, friction, "Coulomb coefficient between skin and rim", source),
        Parameter("spring_force", "N", 0.0, 5.0, spring, "force that presses the probe on before suction", source),
    )


def _thickness(prefix: str = "") -> Parameter:
    meaning = "thickness relative to the geometry's"
    return Parameter(f"{prefix}thickness_factor", "", 0.3, 3.0, 1.0, meaning, "1 by definition", "log")


def _yeoh(symbol: str, default: float, order: str) -> Parameter:
    """A higher coefficient. An energy without a negative one is stable at any strain; a fit must be told to try one."""
    return Parameter(symbol, PA, -1e6, 1e7, default, f"{order} Yeoh coefficient", "assumed", fit_lower=0.0)


YEOH_SUCTION = SuctionModel(
    info=ModelInfo(
        name="suction_yeoh_qlv",
        problem="suction",
        parameters=(
            Parameter("G", PA, 1e2, 1e7, 2.0e4, "instantaneous shear modulus, 2 c10", "assumed", "log"),
            Parameter("nu", "", 0.3, 0.49999, 0.49, "Poisson's ratio of the bulk modulus", "assumed"),
            _yeoh("c20", 1.0e4, "second"),
            _yeoh("c30", 0.0, "third"),
            _yeoh("c40", 0.0, "fourth"),
            _yeoh("c50", 0.0, "fifth"),
            Parameter("g1", "", 0.0, 0.9, 0.15, "relaxing fraction, first Prony term", "assumed"),
            Parameter("tau1", S, 1e-3, 1e4, 0.5, "time constant, first Prony term", "assumed", "log"),
            Parameter("g2", "", 0.0, 0.9, 0.10, "relaxing fraction, second Prony term", "assumed"),
            Parameter("tau2", S, 1e-3, 1e4, 5.0, "time constant, second Prony term", "assumed", "log"),
            Parameter("g3", "", 0.0, 0.9, 0.10, "relaxing fraction, third Prony term", "assumed"),
            Parameter("tau3", S, 1e-3, 1e4, 50.0, "time constant, third Prony term", "assumed", "log"),
            _thickness(),
            *_interface(0.35, 0.55, "paper F"),
        ),
        channels=("apex_height",),
        description="One layer, Yeoh elasticity with quasi-linear viscoelasticity (three Prony terms)",
        source="paper F, eqs 1-3; default values assumed, the paper's identified ones are not known",
    ),
    law=yeoh_qlv(3),
    layers=("tissue",),
    defaults={
        "cutometer": {
            "opening_radius": 2e-3,
            "layers": {"tissue": 3e-3},  # assumed: the paper's thickness is not known
            "radius": 25e-3,
            "probe_radius": 8e-3,  # assumed
        },
        "aspiration": {"opening_radius": 4e-3, "layers": {"tissue": 9.7e-3}, "radius": 72.5e-3},
    },
)


def _prony(prefix: str, terms: int) -> tuple[Parameter, ...]:
    """Relaxing fractions and times, a decade apart."""
    found = []
    for i in range(1, terms + 1):
        share, time = 0.15 if i == 1 else 0.10, 0.5 * 10.0 ** (i - 1)
        found += [
            Parameter(f"{prefix}g{i}", "", 0.0, 0.9, share, f"relaxing fraction, Prony term {i}", "assumed"),
            Parameter(f"{prefix}tau{i}", S, 1e-3, 1e4, time, f"time constant, Prony term {i}", "assumed", "log"),
        ]
    return tuple(found)


def _modulus(symbol: str, default: float, meaning: str) -> Parameter:
    return Parameter(symbol, PA, 1e2, 1e7, default, meaning, "assumed", "log")


def _poisson(prefix: str = "") -> Parameter:
    return Parameter(f"{prefix}nu", "", 0.3, 0.49999, 0.49, "Poisson's ratio of the bulk modulus", "assumed")


def one_layer(name: str, law: Law, parameters: tuple[Parameter, ...], description: str, source: str) -> SuctionModel:
    """A model of one tissue in paper F's set-up: ``law`` as `materials.hyperelastic` makes it, with two Prony terms or
    as many as it has, and the law's own ``parameters``; the rest is the same for all."""
    terms = sum(symbol.startswith("tau") for symbol in law.parameters)
    shared = (_poisson(), *_prony("", terms), _thickness(), *_interface(0.35, 0.55, "paper F"))
    info = ModelInfo(name, "suction", parameters + shared, ("apex_height",), description, source)
    return SuctionModel(info, law, ("tissue",), YEOH_SUCTION.defaults)


NEO_HOOKE_SUCTION = one_layer(
    "suction_neo_hooke",
    hyperelastic("neo_hooke", ("G",), neo_hooke, lambda p: p["G"], 2),
    (_modulus("G", 3e4, "instantaneous shear modulus"),),
    "One layer, neo-Hooke elasticity with two Prony terms",
    "Rivlin 1948; default values assumed",
)
MOONEY_SUCTION = one_layer(
    "suction_mooney_rivlin",
    hyperelastic("mooney_rivlin", ("c10", "c01"), mooney_rivlin, lambda p: 2.0 * (p["c10"] + p["c01"]), 2),
    (
        _modulus("c10", 1.2e4, "coefficient of the first invariant"),
        Parameter("c01", PA, 0.0, 1e7, 3e3, "coefficient of the second invariant", "assumed"),
    ),
    "One layer, Mooney-Rivlin elasticity with two Prony terms",
    "Mooney 1940, Rivlin 1948; default values assumed",
)
FIBRE_SUCTION = one_layer(
    "suction_fibres",
    hyperelastic("dispersed_fibres", ("G", "k1", "k2", "h"), dispersed_fibres, lambda p: p["G"], 2),
    (
        _modulus("G", 1.5e4, "shear modulus of the matrix"),
        Parameter("k1", PA, 0.0, 1e7, 2e4, "fibre modulus", "assumed"),
        Parameter("k2", "", 1e-3, 100.0, 1.0, "fibre stiffening", "assumed", "log"),
        Parameter("h", "", 1.0 / 3.0, 0.5, 0.45, "fibres in the skin's plane: 1/2 all, 1/3 alike in space", "assumed"),
    ),
    "One layer, neo-Hooke matrix and fibres dispersed about the skin's plane, two Prony terms",
    "Gasser, Ogden and Holzapfel 2006; default values assumed",
)


def _yeoh_layer(layer: str, modulus: float, c20: float) -> tuple[Parameter, ...]:
    higher = (_yeoh(f"{layer}.c{i}0", c20 if i == 2 else 0.0, word) for i, word in _ORDERS)
    return (
        _modulus(f"{layer}.G", modulus, "instantaneous shear modulus, 2 c10"),
        _poisson(f"{layer}."),
        *higher,
        *_prony(f"{layer}.", 1),
        _thickness(f"{layer}."),
    )


_ORDERS = ((2, "second"), (3, "third"), (4, "fourth"), (5, "fifth"))
_STACK = {"skin": (4e4, 2e4, 1.5e-3), "fat": (3e3, 1e3, 3.5e-3), "muscle": (1e4, 5e3, 5e-3)}  # G, c20, thickness


def _layered(name: str, layers: tuple[str, ...]) -> SuctionModel:
    thickness = {layer: _STACK[layer][2] for layer in layers}  # assumed
    parameters = tuple(p for layer in layers for p in _yeoh_layer(layer, *_STACK[layer][:2]))
    words = " over ".join(layers)
    info = ModelInfo(
        name,
        "suction",
        parameters + _interface(0.35, 0.55, "paper F"),
        ("apex_height",),
        f"{words[0].upper()}{words[1:]}, each Yeoh elasticity with one Prony term",
        "paper F's law in layers; default values assumed",
    )
    instruments = {n: {**options, "layers": thickness} for n, options in YEOH_SUCTION.defaults.items()}
    return SuctionModel(info, yeoh_qlv(1), layers, instruments)


YEOH_TWO_LAYERS = _layered("suction_yeoh_2", ("skin", "fat"))
YEOH_THREE_LAYERS = _layered("suction_yeoh_3", ("skin", "fat", "muscle"))


def _layer(layer: str, **v: float) -> tuple[Parameter, ...]:
    """Rubin–Bodner parameters of one layer: physics.md's table, paper W."""
    w = "paper W" if layer != "muscle" else "paper W (not identified there)"
    fixed = f"{w}, held"
    return (
        Parameter(f"{layer}.mu0", PA, 1e2, 1e7, v["mu0"], "modulus of the energy", w, "log"),
        Parameter(f"{layer}.q", "", 1e-3, 500.0, v["q"], "stiffening exponent", w, "log"),
        Parameter(f"{layer}.m1", "", 10.0, 1e5, 1000.0, "resistance to volume change", fixed, "log"),
        Parameter(f"{layer}.m2", "", 1e-5, 2.0, v["m2"], "weight of the total distortion", w, "log"),
        Parameter(f"{layer}.m5", "", 0.0, 2.0, v["m5"], "weight of the elastic dissipative distortion", fixed),
        Parameter(f"{layer}.Gamma1", HZ, 1e-8, 1e4, v["Gamma1"], "rate of time-dependent relaxation", w, "log"),
        Parameter(f"{layer}.Gamma2", "", 1e-4, 1e5, v["Gamma2"], "rate-independent relaxation", w, "log"),
        Parameter(f"{layer}.n", "", 0.05, 5.0, v["n"], "exponent of the overstress", w, "log"),
        Parameter(f"{layer}.r1", "", 1e-4, 1e4, v["r1"], "hardening of the time-dependent part", fixed, "log"),
        Parameter(f"{layer}.r2", "", 1e-4, 1e4, v["r2"], "hardening of the rate-independent part", w, "log"),
        Parameter(f"{layer}.r3", HZ, 1e-14, 1.0, v["r3"], "rate at which the hardening changes over", fixed, "log"),
        Parameter(f"{layer}.r4", HZ, 0.0, 1.0, 1e-4, "rate at which hardening recovers", fixed),
        _thickness(f"{layer}."),
    )


RUBIN_BODNER_SUCTION = SuctionModel(
    info=ModelInfo(
        name="suction_rubin_bodner",
        problem="suction",
        parameters=(
            *_layer(
                "skin",
                mu0=0.086e6,
                q=39.74,
                m2=0.027,
                m5=0.981,
                Gamma1=1.34,
                Gamma2=67.3,
                n=0.5,
                r1=20.0,
                r2=6.91,
                r3=1e-10,
            ),
            *_layer(
                "smas",
                mu0=0.004e6,
                q=21.58,
                m2=0.014,
                m5=0.987,
                Gamma1=5.89,
                Gamma2=43.7,
                n=1.0,
                r1=0.2,
                r2=1.74,
                r3=1e-8,
            ),
            *_layer(
                "muscle",
                mu0=0.37e6,
                q=25.0,
                m2=0.0008,
                m5=0.0,
                Gamma1=0.005,
                Gamma2=20.0,
                n=1.0,
                r1=0.2,
                r2=1.3,
                r3=1e-8,
            ),
            *_interface(0.0, 0.0, "paper W"),
        ),
        channels=("apex_height",),
        description="Skin over SMAS (over muscle, aspiration), Rubin-Bodner elastic-viscoplastic",
        source="paper W, eqs 1-2 and its table; evolution equations reconstructed",
    ),
    law=RUBIN_BODNER,
    layers=("skin", "smas", "muscle"),
    defaults={
        "cutometer": {"opening_radius": 1e-3, "layers": {"skin": 1.7e-3, "smas": 3.0e-3}, "radius": 25e-3},
        "aspiration": {
            "opening_radius": 4e-3,
            "layers": {"skin": 1.7e-3, "smas": 3.0e-3, "muscle": 5.0e-3},
            "radius": 72.5e-3,
        },
    },
)

RUBIN_BODNER_GAMMA_SUCTION = replace(
    RUBIN_BODNER_SUCTION,
    law=RUBIN_BODNER_GAMMA,
    info=replace(
        RUBIN_BODNER_SUCTION.info,
        name="suction_rubin_bodner_gamma",
        description=f"{RUBIN_BODNER_SUCTION.info.description}; hardening with the factor γ that some authors write",
    ),
)
