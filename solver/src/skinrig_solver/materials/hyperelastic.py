"""Any hyperelastic law by its energy alone, with any number of Prony terms; and those of the catalogue.

W = Ŵ(C̄; p) + k/2 (θ − 1)², C̄ = J^(−2/3) FᵀF. The energy is written once; S̄ = 2 ∂Ŵ/∂C̄ is differentiated from it,
and S = J^(−2/3) (S̄ − ⅓ (S̄ : C) C⁻¹) (Holzapfel, Nonlinear Solid Mechanics, 2000, eq. 6.90). k = 2 G (1 + ν) /
(3 (1 − 2 ν)) with the energy's initial shear modulus G.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from ..law import Law, Values
from ..tensor import Sym, Tensor
from ..trace import Expr, derivatives, exp, lift, power, select, substitute, variables
from . import prony

Energy = Callable[[Sym, Values], Expr]  # [J/m³] of the unimodular C̄ and the parameters
Modulus = Callable[[Values], Expr]  # [Pa]
_SYMBOLS = tuple(f"C_{c}" for c in prony.COMPONENTS)


def hyperelastic(name: str, parameters: Sequence[str], energy: Energy, shear: Modulus, terms: int = 0) -> Law:
    """A law from its energy and its initial shear modulus; its parameters are ``parameters``, nu and g1, tau1, ….

    In an axisymmetric body rr, zz and tt are the radial, axial and hoop directions.

    >>> law = hyperelastic("neo_hooke", ("G",), lambda C, p: 0.5 * p["G"] * (C.trace() - 3.0), lambda p: p["G"], 1)
    >>> law.parameters
    ('G', 'nu', 'g1', 'tau1')
    """
    return Law(
        f"{name}_{terms}",
        (*parameters, "nu", *prony.names(terms)),
        prony.rest(terms),
        partial(prony.relaxing, partial(_stress, energy), partial(_bulk, shear), terms),
        partial(prony.relaxes_too_much, terms),
    )


def first_invariant(C: Sym) -> Expr:
    """Ī1."""
    return C.trace()


def second_invariant(C: Sym) -> Expr:
    """Ī2 = ½ (Ī1² − tr C̄²)."""
    return 0.5 * (C.trace() * C.trace() - C.inner(C))


def _stress(energy: Energy, F: Tensor, p: Values) -> Sym:
    C = F.right_cauchy_green()
    scale = power(F.det(), -2.0 / 3.0)
    symbols = variables(*_SYMBOLS)
    values = dict(zip(symbols, (C * scale).components(), strict=True))
    slopes = derivatives([lift(energy(Sym(*symbols), p))], symbols)[0]
    # a symmetric tensor's off-diagonal entry stands for two: half its slope belongs to each
    rr, rz, zz, tt = (
        substitute(slopes[s], values) * factor if s in slopes else lift(0.0)
        for s, factor in zip(symbols, (2.0, 1.0, 2.0, 2.0), strict=True)
    )
    bar = Sym(rr, rz, zz, tt)
    return (bar - C.inverse() * (bar.inner(C) / 3.0)) * scale


def _bulk(shear: Modulus, p: Values) -> Expr:
    return shear(p) * (2.0 * (1.0 + p["nu"]) / (3.0 * (1.0 - 2.0 * p["nu"])))


def neo_hooke(C: Sym, p: Values) -> Expr:
    """G/2 (Ī1 − 3)."""
    return 0.5 * p["G"] * (C.trace() - 3.0)


def mooney_rivlin(C: Sym, p: Values) -> Expr:
    """c10 (Ī1 − 3) + c01 (Ī2 − 3) (Mooney 1940; Rivlin 1948)."""
    return p["c10"] * (first_invariant(C) - 3.0) + p["c01"] * (second_invariant(C) - 3.0)


def dispersed_fibres(C: Sym, p: Values) -> Expr:
    """G/2 (Ī1 − 3) + k1/(2 k2) (exp(k2 ⟨E⟩²) − 1), E = h (C̄_rr + C̄_tt) + (1 − 2 h) C̄_zz − 1.

    Gasser, Ogden and Holzapfel (J. R. Soc. Interface 3, 2006) with the structure tensor diag(h, 1 − 2 h, h) of fibres
    that lie alike in all directions of the skin's plane: h = 1/2 all in the plane, h = 1/3 alike in space. Fibres that
    prefer a direction of the plane have no axisymmetric suction; they resist stretch only.
    """
    E = p["h"] * (C.rr + C.tt) + (1.0 - 2.0 * p["h"]) * C.zz - 1.0
    stretched = select(E, E, 0.0)
    fibres = (exp(p["k2"] * stretched * stretched) - 1.0) * (0.5 * p["k1"] / p["k2"])
    return neo_hooke(C, p) + fibres
