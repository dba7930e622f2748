"""Rubin–Bodner elastic-viscoplastic skin (paper W, eqs 1–2; the evolution equations are reconstructed).

W = μ0/(2q) (exp(q g) − 1), g = 2 m1 (J − 1 − ln J) + m2 (tr b' − 3) + m5 (tr b'_de − 3), so that
τ = μ0 exp(q g) [m1 (J − 1) I + m2 dev b' + m5 dev b'_de]. The paper's fibre term has m3 = 0 everywhere and is left out.

Evolution: ḃ'_de = l b' + b' lᵀ − ⅔ (d:I) b' − Γ (b' − 3/(tr b'⁻¹) I), det b'_de = 1;
Γ = (Γ1 + Γ2 ε̇) exp(−½ (β/γ)^2n), γ = sqrt(3/2) |½ dev b'_de|, ε̇ = sqrt(2/3) |dev d|;
β̇ = (r1 r3 + r2 ε̇)/(r3 + ε̇) Γ − r4 β^r5, r5 = 1 in every layer (r4 β here). Some authors write a factor γ in the
first term: that is a law of its own, ``RUBIN_BODNER_GAMMA``.

Integration: over a step flow and deformation act in turn, half the flow, the deformation, the other half (Strang
1968). Both are exact in what they keep: the flow at fixed strain shrinks the deviator of b'_de by exp(−∫Γ dt), its
trace follows from det = 1, and β grows by K ∫Γ dt. ∫Γ dt over each half solves a monotone scalar equation in which
ln Γ is the mean of its values at the half's start and end: second order, and without overshoot where Γ collapses
within a step, since a mean of logarithms leans to the smaller value. ε̇ dt comes from ¼ (b' − b'⁻¹) of the step's own
deformation, which is exact to second order. The state (A, b'_de pulled back; D, the unimodular C'⁻¹ of the step's
start; and β) is referential, so superposed rotations change nothing (as in M. B. Rubin and O. Papes, J. Mech. Mater.
Struct. 6, 2011, whose rule is of first order).
"""

from __future__ import annotations

from functools import partial

from ..law import Law, Values
from ..tensor import Sym, Tensor, identity
from ..trace import Expr, exp, lift, log, root, sqrt

PARAMETERS = (
    "mu0", "q", "m1", "m2", "m5", "Gamma1", "Gamma2", "n", "r1", "r2", "r3", "r4",
)  # fmt: skip
TINY = 1e-24  # added under square roots of squared strains: a strain of 1e-12 stands for rest
ROOT = 1e-6  # relative step at which Newton stops: the error left is its square


def _sym(state: Values, name: str) -> Sym:
    return Sym(*(state[f"{name}_{c}"] for c in ("rr", "rz", "zz", "tt")))


def decay(x: Expr) -> Expr:
    """exp(−x) to second order, positive and without overflow for every x >= 0."""
    return 1.0 / (1.0 + x * (1.0 + 0.5 * x))


def overstress(x: Expr, beta: Expr, rate: Expr, gamma: Expr, n: Expr, by_gamma: bool) -> Expr:
    """(β/γ)^2n after a flow x = ∫Γ dt that began at β and γ; β grows by ``rate`` x, or by ``rate`` ∫γ Γ dt."""
    shrink = decay(x)
    grown = rate * gamma * (1.0 - shrink) if by_gamma else rate * x
    return exp(2.0 * n * log((beta + grown) / (gamma * shrink)))


def relaxation(y: Expr, amplitude: Expr, beta: Expr, rate: Expr, gamma: Expr, n: Expr) -> Expr:
    """y − ln amplitude + ½ of the mean overstress, y = ln x: increasing and convex, so Newton's path is monotone."""
    return (
        y
        - log(amplitude)
        + 0.25 * (overstress(lift(0.0), beta, rate, gamma, n, False) + overstress(exp(y), beta, rate, gamma, n, False))
    )


def relaxation_gamma(y: Expr, amplitude: Expr, beta: Expr, rate: Expr, gamma: Expr, n: Expr) -> Expr:
    """`relaxation` for hardening that carries a factor γ."""
    return (
        y
        - log(amplitude)
        + 0.25 * (overstress(lift(0.0), beta, rate, gamma, n, True) + overstress(exp(y), beta, rate, gamma, n, True))
    )


def unimodular_trace(third: Expr, norm: Expr, det: Expr) -> Expr:
    """det(D + t I) − 1 for a deviator D: t³ − ½ |D|² t + det D − 1."""
    return third * third * third - 0.5 * norm * third + det - 1.0


def _flow(norm: Expr, det: Expr, beta: Expr, amplitude: Expr, rate: Expr, n: Expr, by_gamma: bool) -> tuple[Expr, ...]:
    """Flow at fixed strain of a tensor whose deviator has the given square and determinant.

    Returns the factor by which the deviator shrinks, the third of the trace that det = 1 asks for then, and β.
    """
    gamma = sqrt(0.375 * norm + TINY)
    args = (beta + 1e-12, rate, gamma, n)
    first = overstress(lift(0.0), *args, by_gamma)
    upper = log(amplitude) - 0.5 * first  # β/γ grows with x: the root lies below
    lower = log(amplitude) - 0.25 * (first + overstress(exp(upper), *args, by_gamma))
    x = exp(root(relaxation_gamma if by_gamma else relaxation, lower, upper, upper, (amplitude, *args), ROOT))
    shrink = decay(x)
    grown = rate * gamma * (1.0 - shrink) if by_gamma else rate * x
    norm, det = norm * shrink * shrink, det * shrink * shrink * shrink
    bound = 1.0 + 0.5 * norm
    return shrink, root(unimodular_trace, 0.0, bound, bound, (norm, det), ROOT), beta + grown


def _response(
    by_gamma: bool, F: Tensor, theta: Expr, state: Values, p: Values, dt: Expr
) -> tuple[Tensor, Expr, dict[str, Expr]]:
    unimodular = F.unimodular()
    b = unimodular.push(identity())
    elastic = unimodular.push(_sym(state, "A"))
    step = unimodular.push(_sym(state, "D"))  # b' of the deformation since the step's start
    turned = step.inverse()
    change = (step - turned).dev()
    strain = sqrt(change.inner(change) / 24.0 + TINY)  # sqrt(2/3) |¼ (b' − b'⁻¹)|
    half = 0.5 * (p["Gamma1"] * dt + p["Gamma2"] * strain)
    hardening = (p["r1"] * p["r3"] * dt + p["r2"] * strain) / (p["r3"] * dt + strain)

    # the first half flows at the strain of the step's start, where the metric is D
    deviator = elastic - step * (elastic.inner(turned) / 3.0)
    shrink, third, beta = _flow(
        deviator.square(turned), deviator.det(), state["beta"], half, hardening, p["n"], by_gamma
    )

    # the second half at the strain of its end
    deviator = (deviator * shrink + step * third).dev()
    beta = beta * exp(-(p["r4"] * dt))
    shrink, third, beta = _flow(deviator.inner(deviator), deviator.det(), beta, half, hardening, p["n"], by_gamma)
    deviator = deviator * shrink
    b_de = deviator + identity() * third

    g = 2.0 * p["m1"] * (theta - 1.0 - log(theta)) + p["m2"] * (b.trace() - 3.0) + p["m5"] * (3.0 * third - 3.0)
    modulus = p["mu0"] * exp(p["q"] * g)
    tau = (b.dev() * p["m2"] + deviator * p["m5"]) * modulus
    pressure = modulus * p["m1"] * (theta - 1.0) / theta

    back = unimodular.inverse()
    new = {"beta": beta}
    for name, value in (("A", back.push(b_de)), ("D", back.push(identity()))):
        new |= {f"{name}_{c}": v for c, v in zip(("rr", "rz", "zz", "tt"), value.components(), strict=True)}
    return F.piola(tau), pressure, new


_REST = {f"{name}_{c}": float(c != "rz") for name in ("A", "D") for c in ("rr", "rz", "zz", "tt")}
RUBIN_BODNER = Law("rubin_bodner", PARAMETERS, {**_REST, "beta": 0.0}, partial(_response, False))
RUBIN_BODNER_GAMMA = Law("rubin_bodner_gamma", PARAMETERS, {**_REST, "beta": 0.0}, partial(_response, True))
