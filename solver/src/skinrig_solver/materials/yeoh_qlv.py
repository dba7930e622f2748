"""Yeoh elasticity with quasi-linear viscoelasticity (paper F, eqs 1–3).

W = Σ c_i0 (Ĩ1 − 3)^i (i = 1…5) + k/2 (θ − 1)²; G = 2 c10 is the instantaneous shear modulus and
k = 2 G (1 + ν)/(3 (1 − 2 ν)).
Relaxation: see `prony`.

Stability: simple shear by k has Ĩ1 − 3 = k² and the shear stress 2 W' k, which rises with k as long as
W' + 2 (Ĩ1 − 3) W'' = Σ i (2i − 1) c_i0 (Ĩ1 − 3)^(i−1) is positive: for energies of Ĩ1 alone the condition of strong
ellipticity (Knowles and Sternberg, Arch. Rat. Mech. Anal. 63, 1977). Beyond it finite elements find states that no
tissue could hold.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..api import Array
from ..law import Law, Values
from ..tensor import Sym, Tensor, identity
from ..trace import Expr, power
from . import prony


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


def _bulk(p: Values) -> Expr:
    return p["G"] * (2.0 * (1.0 + p["nu"]) / (3.0 * (1.0 - 2.0 * p["nu"])))


def stable_to(p: Array) -> float:
    """Ĩ1 − 3 at which shear stress no longer rises with shear; inf where it always does. ``p``: G, ν, c20 … c50, …"""
    orders = np.arange(1, 6)
    coefficients = orders * (2 * orders - 1) * np.concatenate([[0.5 * p[0]], p[2:6]])
    if coefficients.min() >= 0.0:
        return float("inf")
    roots = np.polynomial.Polynomial(coefficients).roots()
    positive = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0.0)]
    return float(positive.min()) if positive.size else float("inf")


def yeoh_qlv(terms: int) -> Law:
    """The law with a given number of Prony terms (paper F: three; its abstract says five)."""
    return Law(
        f"yeoh_qlv{terms}",
        ("G", "nu", "c20", "c30", "c40", "c50", *prony.names(terms)),
        prony.rest(terms),
        partial(prony.relaxing, elastic, _bulk, terms),
        partial(prony.relaxes_too_much, terms),
        stable_to,
    )
