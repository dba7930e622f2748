"""A law of one's own in one file: Demiray's exponential elasticity with a Maxwell branch, under a Cutometer.

W = a/(2 b) (exp(b (Ĩ1 − 3)) − 1) + k/2 (θ − 1)²; a fraction g of the stress relaxes with the time constant tau.
Run ``python examples/demiray.py``.
"""

from __future__ import annotations

import numpy as np

from skinrig_solver import Experiment, ModelInfo, Parameter
from skinrig_solver.law import Law, Values
from skinrig_solver.suction import SuctionModel
from skinrig_solver.tensor import Sym, Tensor, identity
from skinrig_solver.trace import Expr, exp

COMPONENTS = ("rr", "rz", "zz", "tt")


def response(F: Tensor, theta: Expr, state: Values, p: Values, dt: Expr) -> tuple[Tensor, Expr, dict[str, Expr]]:
    """First Piola–Kirchhoff stress, ∂W/∂θ and the state at the end of a step of dt."""
    unimodular = F.unimodular()
    C = unimodular.right_cauchy_green()
    b = unimodular.push(identity())
    tau = b.dev() * (p["a"] * exp(p["b"] * (C.trace() - 3.0)))  # Kirchhoff stress of the whole spring
    inverse = F.inverse()
    elastic = inverse.push(tau)  # second Piola–Kirchhoff stress: what a branch may remember, whatever turns
    keep = exp(-(dt / p["tau"]))
    old, last = (Sym(*(state[f"{name}_{c}"] for c in COMPONENTS)) for name in ("branch", "last"))
    branch = old * keep + (elastic - last) * (p["g"] * keep)
    new = {f"branch_{c}": v for c, v in zip(COMPONENTS, branch.components(), strict=True)}
    new |= {f"last_{c}": v for c, v in zip(COMPONENTS, elastic.components(), strict=True)}
    return F.times(elastic * (1.0 - p["g"]) + branch), p["k"] * (theta - 1.0), new


REST = {f"{name}_{c}": 0.0 for name in ("branch", "last") for c in COMPONENTS}
DEMIRAY = Law("demiray", ("a", "b", "k", "g", "tau"), REST, response)

MODEL = SuctionModel(
    info=ModelInfo(
        name="suction_demiray",
        problem="suction",
        parameters=(
            Parameter("a", "Pa", 1e2, 1e6, 2e4, "shear modulus", "example", "log"),
            Parameter("b", "", 1e-3, 50.0, 2.0, "stiffening", "example", "log"),
            Parameter("k", "Pa", 1e4, 1e9, 1e6, "bulk modulus", "example", "log"),
            Parameter("g", "", 0.0, 0.95, 0.3, "relaxing fraction", "example"),
            Parameter("tau", "s", 1e-3, 1e3, 2.0, "relaxation time", "example", "log"),
            Parameter("friction", "", 0.0, 2.0, 0.0, "Coulomb coefficient between skin and rim", "example"),
            Parameter("spring_force", "N", 0.0, 5.0, 0.0, "force that presses the probe on", "example"),
        ),
        channels=("apex_height",),
        description="Demiray elasticity with one relaxing branch, one layer",
        source="example",
    ),
    law=DEMIRAY,
    layers=("tissue",),
    defaults={"cutometer": {"opening_radius": 1e-3, "layers": {"tissue": 3e-3}, "radius": 20e-3}},
)

if __name__ == "__main__":
    time = np.linspace(0.0, 10.0, 101)
    run = Experiment("cutometer", time, {"pressure": np.where(time > 0.0, -20e3, 0.0)})
    result = MODEL.simulate(run, {}, ["a", "b", "tau"])
    assert result.sensitivities is not None
    rise, slopes = result.channels["apex_height"], result.sensitivities["apex_height"]
    for i in (1, 10, 100):
        shares = slopes[i] * [2e4, 2.0, 2.0] / rise[i]
        print(f"t = {time[i]:4.1f} s: {1e3 * rise[i]:.4f} mm; relative change by a, b, tau: {np.round(shares, 3)}")
