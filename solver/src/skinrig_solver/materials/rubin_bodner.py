"""Rubin–Bodner elastic-viscoplastic skin (paper W, eqs 1–2; the evolution equations are reconstructed).

W = μ0/(2q) (exp(q g) − 1), g = 2 m1 (J − 1 − ln J) + m2 (tr b' − 3) + m5 (tr b'_de − 3), so that
τ = μ0 exp(q g) [m1 (J − 1) I + m2 dev b' + m5 dev b'_de]. The paper's fibre term has m3 = 0 everywhere and is left out.

Evolution: ḃ'_de = l b' + b' lᵀ − ⅔ (d:I) b' − Γ (b' − 3/(tr b'⁻¹) I), det b'_de = 1;
Γ = (Γ1 + Γ2 ε̇) exp(−½ (β/γ)^2n), γ = sqrt(3/2) |½ dev b'_de|, ε̇ = sqrt(2/3) |dev d|;
β̇ = (r1 r3 + r2 ε̇)/(r3 + ε̇) Γ − r4 β^r5, r5 = 1 in every layer (r4 β here). Some authors write a factor γ in the
first term: that is a law of its own, ``RUBIN_BODNER_GAMMA``.

Integration: fully implicit over the relative deformation gradient, after M. B. Rubin and O. Papes (J. Mech. Mater.
Struct. 6, 2011): the trial b'* = F' A F'ᵀ of the convected A relaxes its deviator by 1/(1 + Γ dt), where Γ dt solves
a monotone scalar equation; its trace follows from det = 1. The state (A, the unimodular C'⁻¹ of the step's start, and
β) is referential, so superposed rotations change nothing. Objective to rounding, first order in time.
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


def overstress(x: Expr, beta0: Expr, rate: Expr, trial: Expr, n: Expr, by_gamma: bool) -> Expr:
    """(β/γ)^2n with γ = trial/(1 + x) and β = β0 + rate x, or β0 + rate γ x."""
    gamma = trial / (1.0 + x)
    hardening = rate * gamma if by_gamma else rate
    return exp(2.0 * n * log((beta0 + hardening * x) / gamma))


def relaxation(y: Expr, amplitude: Expr, beta0: Expr, rate: Expr, trial: Expr, n: Expr) -> Expr:
    """y − ln amplitude + ½ (β/γ)^2n with y = ln Γ dt: increasing and convex, so Newton from above is monotone."""
    return y - log(amplitude) + 0.5 * overstress(exp(y), beta0, rate, trial, n, False)


def relaxation_gamma(y: Expr, amplitude: Expr, beta0: Expr, rate: Expr, trial: Expr, n: Expr) -> Expr:
    """`relaxation` for hardening that carries a factor γ."""
    return y - log(amplitude) + 0.5 * overstress(exp(y), beta0, rate, trial, n, True)


def unimodular_trace(third: Expr, norm: Expr, det: Expr) -> Expr:
    """det(D + t I) − 1 for a deviator D: t³ − ½ |D|² t + det D − 1."""
    return third * third * third - 0.5 * norm * third + det - 1.0


def _response(
    by_gamma: bool, F: Tensor, theta: Expr, state: Values, p: Values, dt: Expr
) -> tuple[Tensor, Expr, dict[str, Expr]]:
    unimodular = F.unimodular()
    b = unimodular.push(identity())
    trial = unimodular.push(_sym(state, "A"))
    step = unimodular.push(_sym(state, "D"))  # b' of the deformation since the step's start; ε̇ dt ≈ its half deviator
    strain = sqrt(step.dev().inner(step.dev()) / 6.0 + TINY)

    deviator = trial.dev()
    norm = deviator.inner(deviator)
    gamma_trial = sqrt(0.375 * norm + TINY)
    amplitude = p["Gamma1"] * dt + p["Gamma2"] * strain
    hardening = (p["r1"] * p["r3"] * dt + p["r2"] * strain) / (p["r3"] * dt + strain)
    decay = 1.0 / (1.0 + p["r4"] * dt)
    args = (state["beta"] * decay + 1e-12, hardening * decay, gamma_trial, p["n"])
    upper = log(amplitude) - 0.5 * overstress(lift(0.0), *args, by_gamma)  # β/γ grows with x: the root lies below
    lower = log(amplitude) - 0.5 * overstress(exp(upper), *args, by_gamma)
    x = exp(root(relaxation_gamma if by_gamma else relaxation, lower, upper, upper, (amplitude, *args), ROOT))
    shrink = 1.0 / (1.0 + x)
    if by_gamma:
        hardening = hardening * gamma_trial * shrink
    beta = (state["beta"] + hardening * x) * decay
    deviator = deviator * shrink
    norm = norm * shrink * shrink
    third = root(unimodular_trace, 0.0, 1.0 + 0.5 * norm, trial.trace() / 3.0, (norm, deviator.det()), ROOT)
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
