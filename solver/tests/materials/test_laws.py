"""Closed forms, objectivity, consistency of tangent, state and parameter derivatives, and time integration."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from skinrig_solver.law import Law
from skinrig_solver.materials.rubin_bodner import RUBIN_BODNER, RUBIN_BODNER_GAMMA
from skinrig_solver.materials.yeoh_qlv import stable_to, yeoh_qlv

Array = NDArray[np.float64]
SKIN = {
    "mu0": 0.086e6, "q": 3.9, "m1": 1000.0, "m2": 0.027, "m5": 0.981, "Gamma1": 1.34, "Gamma2": 67.3, "n": 0.5,
    "r1": 20.0, "r2": 6.91, "r3": 1e-10, "r4": 1e-4,
}  # fmt: skip
YEOH = {
    "G": 2e4, "nu": 0.49, "c20": 1e4, "c30": 2e3, "c40": 1e2, "c50": 10.0,
    "g1": 0.2, "tau1": 0.3, "g2": 0.1, "tau2": 3.0, "g3": 0.15, "tau3": 40.0,
}  # fmt: skip
LAWS = [(RUBIN_BODNER, SKIN), (yeoh_qlv(3), YEOH), (RUBIN_BODNER_GAMMA, SKIN)]
MODES = {
    "uniaxial": lambda x: np.diag([x**-0.5, x, x**-0.5]),
    "biaxial": lambda x: np.diag([x, x**-2.0, x]),
    "simple shear": lambda x: np.array([[1.0, x - 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
}


def pack(F: Array, theta: float = 1.0) -> Array:
    """3 x 3 in the order r, z, t to the law's row."""
    return np.array([F[0, 0], F[0, 1], F[1, 0], F[1, 1], F[2, 2], theta])


def unpack(row: Array) -> Array:
    return np.array([[row[0], row[1], 0.0], [row[2], row[3], 0.0], [0.0, 0.0, row[4]]])


class Point:
    """One material point."""

    def __init__(self, law: Law, values: dict[str, float]) -> None:
        self.law, self.par = law, np.array([values[name] for name in law.parameters])
        self.state = np.array([list(law.rest.values())], dtype=float)

    def evaluate(self, kin: Array, dt: float) -> tuple[Array, Array]:
        out, new = np.zeros((1, 6)), np.zeros_like(self.state)
        code = self.law.kernels()
        code.stress(0, 1, kin[None], self.state, self.par, dt, np.full((1, code.ROOTS), np.nan), out, new)
        return out[0], new[0]

    def step(self, F: Array, dt: float) -> Array:
        """Kirchhoff stress after a step, without the constraint pressure."""
        out, new = self.evaluate(pack(F), dt)
        self.state = new[None]
        return unpack(out) @ F.T


def deviator(a: Array) -> Array:
    return a - np.eye(3) * np.trace(a) / 3.0


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("stretch", [0.8, 1.3])
def test_yeoh_matches_the_closed_form(mode: str, stretch: float) -> None:
    """dev τ = 2 W'(I1) dev B for isochoric F, instantaneous."""
    F = MODES[mode](stretch)
    B = F @ F.T
    x = np.trace(B) - 3.0
    slope = YEOH["G"] / 2 + sum(i * YEOH[f"c{i}0"] * x ** (i - 1) for i in range(2, 6))
    tau = Point(*LAWS[1]).step(F, 1e-12)
    assert np.allclose(deviator(tau), 2.0 * slope * deviator(B), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize(("c20", "c30"), [(-3e3, 0.0), (-3e3, 2e3), (5e3, -1e3), (5e3, 2e3)])
def test_yeoh_is_stable_while_shear_stress_rises_with_shear(c20: float, c30: float) -> None:
    reach = stable_to(np.array([2e4, 0.45, c20, c30, 0.0, 0.0]))
    shear = np.linspace(0.0, 4.0, 4001)
    x = shear**2
    stress = 2.0 * (1e4 + 2 * c20 * x + 3 * c30 * x**2) * shear
    falls = np.flatnonzero(np.diff(stress) <= 0.0)
    assert reach == pytest.approx(x[falls[0]] if falls.size else np.inf, rel=5e-3)


def test_yeoh_relaxes_as_its_prony_series() -> None:
    point, F = Point(*LAWS[1]), MODES["simple shear"](1.2)
    first = point.step(F, 1e-12)
    for t in (0.1, 0.9, 20.0):
        relaxed = point.step(F, t - getattr(point, "now", 0.0))
        point.now = t  # type: ignore[attr-defined]
        factor = 1.0 - sum(YEOH[f"g{i}"] * (1.0 - np.exp(-t / YEOH[f"tau{i}"])) for i in (1, 2, 3))
        assert np.allclose(relaxed, factor * first, rtol=1e-9)


@pytest.mark.parametrize("mode", MODES)
def test_rubin_bodner_without_flow_is_hyperelastic(mode: str) -> None:
    """dev τ = μ0 exp(q g) (m2 + m5) dev B, g = (m2 + m5)(tr B − 3)."""
    F, frozen = MODES[mode](1.15), {**SKIN, "Gamma1": 1e-12, "Gamma2": 1e-12}
    B = F @ F.T
    m = SKIN["m2"] + SKIN["m5"]
    expected = SKIN["mu0"] * np.exp(SKIN["q"] * m * (np.trace(B) - 3.0)) * m * deviator(B)
    assert np.allclose(Point(RUBIN_BODNER, frozen).step(F, 0.1), expected, rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("law", [RUBIN_BODNER, RUBIN_BODNER_GAMMA], ids=lambda law: law.name)
def test_rubin_bodner_integrates_its_rate_equations(law: Law) -> None:
    """Simple shear at a constant rate, then hold: against an adaptive integration of the equations as written.

    Observed orders: 1.84 to 1.87 (the overstress is singular at rest, where the first step starts), and 1.92 to 1.99
    with the factor γ; 0.6 and 0.7 % are left by eight steps, where the implicit rule of first order left 3.2 %.
    """
    rate, ramp, hold = 0.6, 0.5, 2.0
    p = {**SKIN, "r3": 1e-5}  # so that a held point, whose strain rate is rounding, is clearly on the slow branch

    def rates(t: float, y: Array) -> Array:
        b, beta = y[:9].reshape(3, 3), y[9]
        shear = rate if t < ramp else 0.0
        L = np.array([[0.0, shear, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        strain_rate = np.sqrt(2.0 / 3.0) * np.linalg.norm(0.5 * (L + L.T))
        gamma = np.sqrt(1.5) * np.linalg.norm(0.5 * deviator(b)) + 1e-12
        G = (p["Gamma1"] + p["Gamma2"] * strain_rate) * np.exp(-0.5 * (beta / gamma) ** (2.0 * p["n"]))
        flow = G * (b - 3.0 / np.trace(np.linalg.inv(b)) * np.eye(3))
        K = (p["r1"] * p["r3"] + p["r2"] * strain_rate) / (p["r3"] + strain_rate)
        K *= gamma if law is RUBIN_BODNER_GAMMA else 1.0
        return np.append((L @ b + b @ L.T - flow).ravel(), K * G - p["r4"] * beta)

    start = np.append(np.eye(3).ravel(), 0.0)
    first = solve_ivp(rates, (0.0, ramp), start, rtol=1e-9, atol=1e-12, method="LSODA")
    last = solve_ivp(rates, (ramp, ramp + hold), first.y[:, -1], rtol=1e-9, atol=1e-12, method="LSODA")

    def expected(y: Array, shear: float) -> float:
        b, F = y[:9].reshape(3, 3), np.array([[1.0, shear, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        total = F @ F.T
        g = p["m2"] * (np.trace(total) - 3.0) + p["m5"] * (np.trace(b) - 3.0)
        return float(p["mu0"] * np.exp(p["q"] * g) * (p["m2"] * total[0, 1] + p["m5"] * b[0, 1]))

    errors = []
    for steps in (8, 16, 32):
        point = Point(law, p)
        for i in range(1, steps + 1):
            tau = point.step(np.array([[1.0, rate * ramp * i / steps, 0.0], [0, 1, 0], [0, 0, 1.0]]), ramp / steps)
        loaded = tau[0, 1] / expected(first.y[:, -1], rate * ramp) - 1.0
        for _ in range(steps):
            tau = point.step(np.array([[1.0, rate * ramp, 0.0], [0, 1, 0], [0, 0, 1.0]]), hold / steps)
        relaxed = tau[0, 1] / expected(last.y[:, -1], rate * ramp) - 1.0
        errors.append((abs(loaded), abs(relaxed)))
    assert max(errors[0]) < 0.01
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 1.8) & (orders < 2.1))


def test_a_long_step_of_relaxation_ends_near_what_short_ones_reach() -> None:
    """The rate of flow falls by orders of magnitude within the step: a mean of rates would relax far too much."""
    values, F = {**SKIN, "r3": 1e-5, "Gamma1": 5.0}, MODES["simple shear"](1.3)

    def lost(steps: int) -> float:
        point = Point(RUBIN_BODNER, values)
        loaded = point.step(F, 1e-3)[0, 1]
        for _ in range(steps):
            tau = point.step(F, 100.0 / steps)
        return float(loaded - tau[0, 1])

    assert lost(1) == pytest.approx(lost(256), rel=0.1)


@pytest.mark.parametrize("change", [{"n": 5.0}, {"n": 0.05}, {"Gamma1": 1e4}, {"Gamma2": 1e5}, {"r1": 1e4, "r2": 1e4}])
@pytest.mark.parametrize("law", [RUBIN_BODNER, RUBIN_BODNER_GAMMA], ids=lambda law: law.name)
def test_rubin_bodner_is_finite_at_the_ends_of_its_bounds(law: Law, change: dict[str, float]) -> None:
    point = Point(law, {**SKIN, **change})
    for shear, dt in ((1e-9, 1e-3), (0.1, 0.01), (0.3, 0.1), (0.3, 60.0), (0.0, 0.1), (-0.2, 0.1), (-0.2, 1e4)):
        assert np.isfinite(point.step(MODES["simple shear"](1.0 + shear), dt)).all()
        assert np.isfinite(point.state).all()


@pytest.mark.parametrize(("law", "values"), LAWS)
def test_superposed_rotation_turns_the_stress_only(law: Law, values: dict[str, float]) -> None:
    angle = 0.7
    Q = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    path = [MODES["simple shear"](1.1), MODES["uniaxial"](1.2) @ MODES["simple shear"](1.1)]
    still, turned = Point(law, values), Point(law, values)
    for F in path:
        tau, tau_turned = still.step(F, 0.2), turned.step(Q @ F, 0.2)
        assert np.allclose(Q @ tau @ Q.T, tau_turned, rtol=1e-9, atol=1e-6)
        assert np.allclose(still.state, turned.state, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("law", "values"), LAWS)
def test_stress_free_at_rest(law: Law, values: dict[str, float]) -> None:
    out, _ = Point(law, values).evaluate(pack(np.eye(3)), 0.1)
    assert np.allclose(out, 0.0, atol=1e-6)


@pytest.mark.parametrize(("law", "values"), LAWS[:2])
def test_every_derivative_agrees_with_differences(law: Law, values: dict[str, float]) -> None:
    rng, code = np.random.default_rng(3), law.kernels()
    memory = np.full((1, code.ROOTS), np.nan)
    point = Point(law, values)
    point.step(np.eye(3) + 0.05 * np.diag(rng.normal(size=3)), 0.05)
    kin = pack(np.eye(3), 1.001)
    kin[:5] += 0.08 * rng.normal(size=5)
    states, pars = point.state.shape[1], len(point.par)

    def both(kin: Array, state: Array, par: Array) -> Array:
        out, new = np.zeros((1, 6)), np.zeros((1, states))
        code.stress(0, 1, kin[None], state[None], par, 0.07, memory, out, new)
        return np.concatenate([out[0], new[0]])

    base = [kin, point.state[0], point.par]
    columns, sizes = [], []
    for which, values_ in enumerate(base):
        for i in range(len(values_)):
            sizes.append(max(abs(values_[i]), 1e-12 if which == 2 else 1e-2))
            h = 1e-6 * sizes[-1]
            moved = [v.copy() for v in base]
            moved[which][i] += h
            up = both(*moved)
            moved[which][i] -= 2 * h
            columns.append((up - both(*moved)) / (2 * h))
    numeric = np.array(columns).T
    m = 6 + states + pars
    out, tangent = np.zeros((1, 6)), np.zeros((1, 6, 6))
    code.stress_tangent(0, 1, kin[None], point.state, point.par, 0.07, memory, out, tangent)
    which = np.concatenate([np.full(6 + states, -1), np.arange(pars)])
    dstate = np.zeros((1, states, m))
    dstate[0, :, 6 : 6 + states] = np.eye(states)
    dstress, dnew = np.zeros((1, 6, m)), np.zeros((1, states, m))
    by_kin = np.zeros((1, states, 6))
    again, new, same = np.empty((1, 6)), np.empty((1, states)), np.empty((1, 6, 6))
    inputs = (0, 1, kin[None], point.state, point.par, 0.07, memory, dstate, which)
    code.partials(*inputs, again, new, same, dstress, dnew, by_kin)
    np.testing.assert_allclose(np.concatenate([again[0], new[0]]), both(*base), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(same, tangent, rtol=1e-9, atol=1e-9 * np.abs(tangent).max())
    dstress[0, :, :6] += tangent[0]
    dnew[0, :, :6] += by_kin[0]
    exact = np.concatenate([dstress[0], dnew[0]])
    exact, numeric = exact * sizes, numeric * sizes  # per relative change of each input
    assert np.all(np.abs(exact - numeric) <= 1e-5 * np.abs(numeric).max(axis=1, keepdims=True) + 1e-8)
