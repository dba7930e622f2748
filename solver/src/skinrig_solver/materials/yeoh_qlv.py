"""Yeoh elasticity with quasi-linear viscoelasticity (paper F, eqs 1–3).

W = Σ c_i0 (Ĩ1 − 3)^i (i = 1…5) + k/2 (θ − 1)²; G = 2 c10 is the instantaneous shear modulus and
k = 2 G (1 + ν)/(3 (1 − 2 ν)).
S(t) = G(t) S^e(0) + ∫ G(t − τ) ∂S^e/∂τ dτ with G(t) = g0 + Σ g_i exp(−t/τ_i), g0 = 1 − Σ g_i, applied to the isochoric
second Piola–Kirchhoff stress; the volumetric part stays elastic (the paper does not say; assumed, as in common codes).
Each Prony term is advanced exactly for a stress that is linear in time over the step.

Stability: simple shear by k has Ĩ1 − 3 = k² and the shear stress 2 W' k, which rises with k as long as
W' + 2 (Ĩ1 − 3) W'' = Σ i (2i − 1) c_i0 (Ĩ1 − 3)^(i−1) is positive: for energies of Ĩ1 alone the condition of strong
ellipticity (Knowles and Sternberg, Arch. Rat. Mech. Anal. 63, 1977). Beyond it finite elements find states that no
tissue could hold.
"""

from __future__ import annotations

import numpy as np

from ..api import Array
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


def stable_to(p: Array) -> float:
    """Ĩ1 − 3 at which shear stress no longer rises with shear; inf where it always does. ``p``: G, ν, c20 … c50, …"""
    orders = np.arange(1, 6)
    coefficients = orders * (2 * orders - 1) * np.concatenate([[0.5 * p[0]], p[2:6]])
    roots = np.polynomial.Polynomial(coefficients).roots()
    positive = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0.0)]
    return float(positive.min()) if positive.size else float("inf")


def _relaxes_too_much(p: Array) -> str:
    """A tissue cannot relax by more than its whole stress; ``p`` ends in the pairs g_i, τ_i."""
    share = float(p[6::2].sum())
    return "" if share < 1.0 else f"the relaxing fractions add up to {share:.4g}, and must stay below 1"


def yeoh_qlv(terms: int) -> Law:
    """The law with a given number of Prony terms (paper F: three; its abstract says five)."""
    prony = tuple(f"{kind}{i}" for i in range(1, terms + 1) for kind in ("g", "tau"))
    rest = {f"{name}_{c}": 0.0 for name in ("S", *(f"h{i}" for i in range(1, terms + 1))) for c in COMPONENTS}
    names = ("G", "nu", "c20", "c30", "c40", "c50", *prony)
    return Law(f"yeoh_qlv{terms}", names, rest, _response(terms), _relaxes_too_much, stable_to)
