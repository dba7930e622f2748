"""The suction models that papers F and W describe: parameters with their bounds and sources, geometries."""

from __future__ import annotations

from dataclasses import replace

from ..api import ModelInfo, Parameter
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
