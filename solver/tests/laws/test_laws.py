"""Every law against closed forms derived by hand, its tangent and parameter derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from skinrig_solver.laws import LAWS, Law
from skinrig_solver.laws.bischoff import BOLTZMANN, TEMPERATURE, inverse_langevin, langevin, langevin_slope
from skinrig_solver.laws.law import FUNCTION, SIGNATURE
from skinrig_solver.laws.tensors import eigen

Array = NDArray[np.float64]
SIX = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]
LAW = pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.name)


@njit(SIGNATURE.return_type(FUNCTION, *SIGNATURE.args))
def _call(law, C, p, derivatives, S, D, dS):  # type: ignore[no-untyped-def]
    law(C, p, derivatives, S, D, dS)


def values(law: Law) -> Array:
    return np.array([p.default for p in law.parameters])


def six(A: Array) -> Array:
    return np.array([A[i, j] for i, j in SIX])


def matrix(a: Array) -> Array:
    A = np.empty((3, 3))
    for value, (i, j) in zip(a, SIX, strict=True):
        A[i, j] = A[j, i] = value
    return A


def evaluate(law: Law, C: Array, p: Array) -> tuple[Array, Array, Array]:
    """S (6,), D (6, 6), dS/dp (m, 6) of C (6,)."""
    S, D, dS = np.empty(6), np.empty((6, 6)), np.empty((p.size, 6))
    _call(law.point, C, p, True, S, D, dS)
    return S, D, dS


@st.composite
def deformations(draw: st.DrawFn) -> Array:
    entries = draw(st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9))
    return np.reshape(entries, (3, 3))


def deformation(law: Law, entries: Array) -> Array:
    """A deformation gradient the law can bear: chains of the Bischoff defaults lock at 3 % stretch."""
    return np.eye(3) + (0.008 if law.name == "bischoff" else 0.12) * entries


@LAW
@settings(max_examples=15, deadline=None)
@given(entries=deformations())
def test_tangent_and_parameter_derivatives_are_those_of_the_stress(law: Law, entries: Array) -> None:
    F, p = deformation(law, entries), values(law)
    C = six(F.T @ F)
    _, D, dS = evaluate(law, C, p)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        rate = (evaluate(law, C + step, p)[0] - evaluate(law, C - step, p)[0]) / 2e-6
        assert_allclose(rate * (2.0 if k < 3 else 1.0), D[:, k], rtol=1e-5, atol=1e-6 * np.abs(D).max())
    assert_allclose(D, D.T, rtol=1e-10, atol=1e-10 * np.abs(D).max())
    for k in range(p.size):
        h = 1e-5 * p[k]
        up, down = p.copy(), p.copy()
        up[k] += h
        down[k] -= h
        rate = (evaluate(law, C, up)[0] - evaluate(law, C, down)[0]) / (up[k] - down[k])
        assert_allclose(rate, dS[k], rtol=1e-5, atol=1e-6 * np.abs(dS[k]).max() + 1e-11 * np.abs(D).max() / p[k])


@LAW
def test_energy_and_stress_vanish_at_rest(law: Law) -> None:
    p, rest = values(law), six(np.eye(3))
    S, D, dS = evaluate(law, rest, p)
    scale = np.abs(D).max()
    assert law.energy(rest, p) == pytest.approx(0.0, abs=1e-9 * scale)
    assert_allclose(S, 0.0, atol=1e-9 * scale)
    assert_allclose(dS, 0.0, atol=1e-9 * scale)


@LAW
def test_energy_agrees_with_the_stress(law: Law) -> None:
    F, p = deformation(law, np.linspace(-1.0, 1.0, 9).reshape(3, 3)), values(law)
    C = six(F.T @ F)
    S, _, _ = evaluate(law, C, p)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        slope = (law.energy(C + step, p) - law.energy(C - step, p)) / 2e-6
        assert slope * (2.0 if k < 3 else 1.0) == pytest.approx(S[k], rel=1e-6, abs=1e-7 * np.abs(S).max())


@pytest.mark.parametrize(
    ("name", "shear"),
    [
        ("ogden", lambda p: 0.5 * (p[0] * p[1] + p[2] * p[3])),
        ("tong_fung", lambda p: 0.0),
        ("fung", lambda p: 0.5 * (p[3] + p[4])),
        ("yeoh", lambda p: 2.0 * p[0]),
    ],
)
def test_small_strain_shear_modulus(name: str, shear) -> None:  # type: ignore[no-untyped-def]
    law = LAWS[name]
    p = values(law)
    _, D, _ = evaluate(law, six(np.eye(3)), p)
    assert D[3, 3] == pytest.approx(shear(p), rel=1e-12)


# ---------------------------------------------------------------------------------------------------- closed forms
# At J = 1 U(J) has no stress: what remains are differences of principal Kirchhoff stresses (or a shear stress) by hand.
def kirchhoff(law: Law, F: Array) -> Array:
    S, _, _ = evaluate(law, six(F.T @ F), values(law))
    return np.asarray(F @ matrix(S) @ F.T)


def uniaxial(x: float) -> Array:
    return np.diag([x, x**-0.5, x**-0.5])


def biaxial(x: float) -> Array:
    return np.diag([x, x, x**-2.0])


def simple_shear(g: float) -> Array:
    return np.array([[1.0, g, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


STATES = pytest.mark.parametrize(
    "F", [uniaxial(1.2), uniaxial(0.9), biaxial(1.1)], ids=["tension", "compression", "biaxial"]
)


@STATES
def test_ogden_principal_stresses(F: Array) -> None:
    mu1, a1, mu2, a2, _ = values(LAWS["ogden"])
    tau = kirchhoff(LAWS["ogden"], F)
    x, z = F[0, 0], F[2, 2]
    assert tau[0, 0] - tau[2, 2] == pytest.approx(mu1 * (x**a1 - z**a1) + mu2 * (x**a2 - z**a2), rel=1e-10)


def test_ogden_simple_shear() -> None:
    mu1, a1, mu2, a2, _ = values(LAWS["ogden"])
    g = 0.3
    x = 0.5 * g + np.sqrt(1.0 + 0.25 * g * g)  # the larger principal stretch, and 1/x the smaller
    expected = (mu1 * (x**a1 - x**-a1) + mu2 * (x**a2 - x**-a2)) / (x + 1.0 / x)
    assert kirchhoff(LAWS["ogden"], simple_shear(g))[0, 1] == pytest.approx(expected, rel=1e-10)


@STATES
def test_yeoh_principal_stresses(F: Array) -> None:
    c = values(LAWS["yeoh"])
    x = np.trace(F @ F) - 3.0
    slope = c[0] + 2.0 * c[1] * x + 3.0 * c[2] * x**2
    tau = kirchhoff(LAWS["yeoh"], F)
    assert tau[0, 0] - tau[2, 2] == pytest.approx(2.0 * slope * (F[0, 0] ** 2 - F[2, 2] ** 2), rel=1e-10)


def test_yeoh_simple_shear() -> None:
    c, g = values(LAWS["yeoh"]), 0.4
    slope = c[0] + 2.0 * c[1] * g**2 + 3.0 * c[2] * g**4
    assert kirchhoff(LAWS["yeoh"], simple_shear(g))[0, 1] == pytest.approx(2.0 * slope * g, rel=1e-10)


@STATES
def test_gasser_principal_stresses_along_the_fibres(F: Array) -> None:
    law = LAWS["gasser"]
    mu, k1, k2, _, bulk = values(law)
    S, _, _ = evaluate(law, six(F @ F), np.array([mu, k1, k2, 0.0, bulk]))
    tau = F @ matrix(S) @ F
    e = F[0, 0] ** 2 - 1.0
    fibre = 4.0 * k1 * e * np.exp(k2 * e**2) * F[0, 0] ** 2
    assert tau[0, 0] - tau[2, 2] == pytest.approx(mu * (F[0, 0] ** 2 - F[2, 2] ** 2) + fibre, rel=1e-10)


def test_gasser_simple_shear() -> None:
    law, g = LAWS["gasser"], 0.2
    mu, k1, k2, theta, _ = values(law)
    x, y = np.cos(theta) + g * np.sin(theta), np.sin(theta)  # the deformed fibre
    e = x * x + y * y - 1.0
    expected = mu * g + 4.0 * k1 * e * np.exp(k2 * e * e) * x * y
    assert kirchhoff(law, simple_shear(g))[0, 1] == pytest.approx(expected, rel=1e-10)


@STATES
def test_tong_fung_principal_stresses(F: Array) -> None:
    c, A1, A2, a1, _, a3, _ = values(LAWS["tong_fung"])
    tau = kirchhoff(LAWS["tong_fung"], F)
    ex, ey = 0.5 * (F[0, 0] ** 2 - 1.0), 0.5 * (F[1, 1] ** 2 - 1.0)
    growth = c * np.exp(A1 * ex**2 + A2 * ey**2)
    expected = F[0, 0] ** 2 * (2.0 * a1 * ex + a3 * ey + 2.0 * A1 * ex * growth)
    assert tau[0, 0] == pytest.approx(expected, rel=1e-10)
    assert tau[2, 2] == pytest.approx(0.0, abs=1e-8 * abs(expected))


def test_tong_fung_simple_shear() -> None:
    c, _, A2, _, a2, a3, _ = values(LAWS["tong_fung"])
    g = 0.3
    e = 0.5 * g * g  # E22; E11 = 0, and E12 does not enter
    tau = kirchhoff(LAWS["tong_fung"], simple_shear(g))
    S22 = 2.0 * a2 * e + 2.0 * c * A2 * e * np.exp(A2 * e**2)
    assert tau[0, 1] == pytest.approx(g * S22, rel=1e-9)
    assert tau[0, 0] == pytest.approx(a3 * e + g * g * S22, rel=1e-9)


@STATES
def test_fung_principal_stresses(F: Array) -> None:
    c, l11, l22, mu1, mu2, _ = values(LAWS["fung"])
    E = 0.5 * (np.diag(F) ** 2 - 1.0)
    T = np.array(
        [
            (2.0 * mu1 + l11) * E[0] + l11 * (E[1] + E[2]),
            (2.0 * mu2 + l22) * E[1] + l11 * (E[0] + E[2]),
            (2.0 * mu2 + l22) * E[2] + l11 * (E[0] + E[1]),
        ]
    )
    S = np.exp(T @ E / c) * T
    tau = kirchhoff(LAWS["fung"], F)
    assert tau[0, 0] - tau[2, 2] == pytest.approx(F[0, 0] ** 2 * S[0] - F[2, 2] ** 2 * S[2], rel=1e-10)


def test_fung_simple_shear() -> None:
    c, _, l22, mu1, mu2, _ = values(LAWS["fung"])
    g = 0.15
    E12, E22 = 0.5 * g, 0.5 * g * g
    cQ = (2.0 * mu2 + l22) * E22**2 + 2.0 * (mu1 + mu2) * E12**2
    shear, normal = (mu1 + mu2) * E12, (2.0 * mu2 + l22) * E22
    expected = np.exp(cQ / c) * (shear + g * normal)
    assert kirchhoff(LAWS["fung"], simple_shear(g))[0, 1] == pytest.approx(expected, rel=1e-10)


def _chains(F: Array, p: Array) -> tuple[Array, Array, Array]:
    """Chain vectors (4, 3), beta / rho (4,) and beta_P / P, with the inverse Langevin function by bisection."""
    sides = p[1:4]
    N = 0.25 * np.sum(sides**2)

    def inverse(y: float) -> float:
        low, high = 1e-9, 1e9
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if 1.0 / np.tanh(middle) - 1.0 / middle < y else (low, middle)
        return 0.5 * (low + high)

    vectors = 0.5 * sides * np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]])
    rho = np.linalg.norm(vectors @ F.T, axis=1)
    return vectors, np.array([inverse(r / N) / r for r in rho]), np.array(inverse(1.0 / np.sqrt(N)) / np.sqrt(N))


@pytest.mark.parametrize(
    "F",
    [uniaxial(1.05), uniaxial(0.95), biaxial(1.02), simple_shear(0.02)],
    ids=["tension", "compression", "biaxial", "shear"],
)
def test_bischoff_stress_of_its_chains(F: Array) -> None:
    law = LAWS["bischoff"]
    p = values(law)
    vectors, ratio, rest = _chains(F, p)
    turned = vectors @ F.T
    tau = sum(r * np.outer(v, v) for r, v in zip(ratio, turned, strict=True))
    axes = F / np.sqrt(np.sum(F**2, axis=0))  # directions of the deformed cell edges
    tau = tau - rest * sum(p[1 + k] ** 2 * np.outer(axes[:, k], axes[:, k]) for k in range(3))
    expected = 0.25 * p[0] * BOLTZMANN * TEMPERATURE * tau
    assert_allclose(kirchhoff(law, F), expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())


# --------------------------------------------------------------------------------------------------- ingredients
@given(st.floats(1e-6, 1.0 - 1e-9))
@settings(max_examples=50, deadline=None)
def test_inverse_langevin_inverts(y: float) -> None:
    x = inverse_langevin(y)
    assert 1.0 - langevin(x) == pytest.approx(1.0 - y, rel=1e-10)
    h = 1e-4 * x
    assert langevin_slope(x) == pytest.approx((langevin(x + h) - langevin(x - h)) / (2.0 * h), rel=1e-3)


def test_a_locked_chain_has_no_stress() -> None:
    assert np.isnan(inverse_langevin(1.0))
    law = LAWS["bischoff"]
    S, _, _ = evaluate(law, six(np.eye(3) * 1.3), values(law))
    assert np.isnan(S).any()
    assert law.energy(six(np.eye(3) * 1.3), values(law)) == np.inf


@given(deformations())
@settings(max_examples=30, deadline=None)
def test_eigen_rebuilds_the_tensor(entries: Array) -> None:
    A = entries + entries.T
    size, axes = np.empty(3), np.empty((3, 3))
    eigen(six(A), size, axes)
    assert_allclose(axes.T @ np.diag(size) @ axes, A, atol=1e-13)
    assert_allclose(axes @ axes.T, np.eye(3), atol=1e-13)


@pytest.mark.parametrize("gap", [0.0, 1e-9, 1e-7, 1e-5])
def test_ogden_tangent_is_continuous_at_equal_stretches(gap: float) -> None:
    law = LAWS["ogden"]
    p = values(law)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    C = turn @ np.diag([1.44, 1.44 * (1.0 + gap), 0.6]) @ turn.T
    reference = turn @ np.diag([1.44, 1.44, 0.6]) @ turn.T
    assert_allclose(evaluate(law, six(C), p)[1], evaluate(law, six(reference), p)[1], rtol=1e-3, atol=1e-3 * 1e5)
