"""Yeoh elasticity with quasi-linear viscoelasticity (paper F, eqs 1–3).

W = Σ c_i0 (Ĩ1 − 3)^i (i = 1…5) + k/2 (θ − 1)²; G = 2 c10 is the instantaneous shear modulus and
k = 2 G (1 + ν)/(3 (1 − 2 ν)).
S(t) = G(t) S^e(0) + ∫ G(t − τ) ∂S^e/∂τ dτ with G(t) = g0 + Σ g_i exp(−t/τ_i), g0 = 1 − Σ g_i, applied to the isochoric
second Piola–Kirchhoff stress; the volumetric part stays elastic (the paper does not say; assumed, as in common codes).
Each Prony term is advanced exactly for a stress that is linear in time over the step.
"""

from __future__ import annotations

from ..law import Law, Response, Values
from ..tensor import Sym, Tensor, identity
from ..trace import Expr, expm1, lift, power

COMPONENTS = ("rr", "rz", "zz", "tt")


def elastic(F: Tensor, p: Values) -> Sym:
    """Isochoric second Piola–Kirchhoff stress 2 J^(−2/3) W'(Ĩ1) (I − ⅓ I1 C⁻¹) [Pa]."""
    C = F.right_cauchy_green()
    scale = power(F.det(), -2.0 / 3.0)
    i1 = C.trace()
    x = scale * i1 - 3.0
    slope = 0.5 * p["G"]
    for order in range(2, 6):
        slope = slope + float(order) * p[f"c{order}0"] * power(x, order - 1)
    return (identity() - C.inverse() * (i1 / 3.0)) * (2.0 * scale * slope)


def _response(terms: int) -> Response:
    def response(F: Tensor, theta: Expr, state: Values, p: Values, dt: Expr) -> tuple[Tensor, Expr, dict[str, Expr]]:
        now = elastic(F, p)
        change = now - Sym(*(state[f"S_{c}"] for c in COMPONENTS))
        new = {f"S_{c}": v for c, v in zip(COMPONENTS, now.components(), strict=True)}
        total = now * (1.0 - sum((p[f"g{i}"] for i in range(1, terms + 1)), start=lift(0.0)))
        for i in range(1, terms + 1):
            lost = -expm1(-(dt / p[f"tau{i}"]))
            ramp = p[f"g{i}"] * lost * p[f"tau{i}"] / dt
            branch = Sym(*(state[f"h{i}_{c}"] for c in COMPONENTS)) * (1.0 - lost) + change * ramp
            new |= {f"h{i}_{c}": v for c, v in zip(COMPONENTS, branch.components(), strict=True)}
            total = total + branch
        bulk = p["G"] * (2.0 * (1.0 + p["nu"]) / (3.0 * (1.0 - 2.0 * p["nu"])))
        return F.times(total), bulk * (theta - 1.0), new

    return response


def yeoh_qlv(terms: int) -> Law:
    """The law with a given number of Prony terms (paper F: three; its abstract says five)."""
    prony = tuple(f"{kind}{i}" for i in range(1, terms + 1) for kind in ("g", "tau"))
    rest = {f"{name}_{c}": 0.0 for name in ("S", *(f"h{i}" for i in range(1, terms + 1))) for c in COMPONENTS}
    return Law(f"yeoh_qlv{terms}", ("G", "nu", "c20", "c30", "c40", "c50", *prony), rest, _response(terms))
