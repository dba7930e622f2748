"""Quasi-linear viscoelasticity of any elastic law (paper F, eq. 3), with any number of Prony terms.

S(t) = G(t) S^e(0) + ∫ G(t − τ) ∂S^e/∂τ dτ with G(t) = g0 + Σ g_i exp(−t/τ_i), g0 = 1 − Σ g_i, applied to the isochoric
second Piola–Kirchhoff stress; the volumetric part stays elastic (the paper does not say; assumed, as in common codes).
Each term is advanced exactly for a stress that is linear in time over the step.
"""

from __future__ import annotations

from collections.abc import Callable

from ..api import Array
from ..law import Values
from ..tensor import Sym, Tensor
from ..trace import Expr, expm1, lift

COMPONENTS = ("rr", "rz", "zz", "tt")
Elastic = Callable[[Tensor, Values], Sym]  # isochoric second Piola–Kirchhoff stress [Pa] of F and the parameters
Bulk = Callable[[Values], Expr]  # bulk modulus [Pa]


def relaxing(
    elastic: Elastic, bulk: Bulk, terms: int, F: Tensor, theta: Expr, state: Values, p: Values, dt: Expr
) -> tuple[Tensor, Expr, dict[str, Expr]]:
    """The response of `skinrig_solver.law.Law`, once its first three arguments are given."""
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
    return F.times(total), bulk(p) * (theta - 1.0), new


def names(terms: int) -> tuple[str, ...]:
    """g1, tau1, g2, …"""
    return tuple(f"{kind}{i}" for i in range(1, terms + 1) for kind in ("g", "tau"))


def rest(terms: int) -> dict[str, float]:
    """The state of an undeformed body."""
    return {f"{name}_{c}": 0.0 for name in ("S", *(f"h{i}" for i in range(1, terms + 1))) for c in COMPONENTS}


def relaxes_too_much(terms: int, p: Array) -> str:
    """A tissue cannot relax by more than its whole stress; ``p`` ends in ``terms`` pairs g_i, τ_i."""
    share = float(p[len(p) - 2 * terms :: 2].sum())
    return "" if share < 1.0 else f"the relaxing fractions add up to {share:.4g}, and must stay below 1"
