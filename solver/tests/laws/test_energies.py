"""Every law's stress against its energy, written again here from the papers' formulas for complex numbers.

No formula is shared with the package: the stress follows by complex step, which is exact to rounding.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from skinrig_solver.laws import LAWS, Law
from skinrig_solver.laws.law import FUNCTION, SIGNATURE

Matrix = NDArray[np.complex128]


def inverse_langevin(y: complex) -> complex:
    """Newton from 1/(1 - y), in exponentials: L(x) = (1 + e)/(1 - e) - 1/x, e = exp(-2 x)."""
    x = 1.0 / (1.0 - y)
    for _ in range(60):
        e = np.exp(-2.0 * x)
        x -= ((1.0 + e) / (1.0 - e) - 1.0 / x - y) / (1.0 / x**2 - 4.0 * e / (1.0 - e) ** 2)
    return complex(x)


def ogden(C: Matrix, J: complex, p: tuple[float, ...]) -> complex:
    stretches = np.sqrt(np.linalg.eigvals(C)) / J ** (1 / 3)
    return complex(sum(mu / a * (np.sum(stretches**a) - 3.0) for mu, a in ((p[0], p[1]), (p[2], p[3]))))


def tong_fung(C: Matrix, J: complex, p: tuple[float, ...]) -> complex:
    c, A1, A2, a1, a2, a3 = p[:6]
    E = 0.5 * (C - np.eye(3))
    x, y = E[0, 0], E[1, 1]
    return complex(a1 * x**2 + a2 * y**2 + a3 * x * y + c * np.exp(A1 * x**2 + A2 * y**2))


def bischoff(C: Matrix, J: complex, p: tuple[float, ...]) -> complex:
    n, sides = p[0], np.array(p[1:4])
    P = 0.5 * np.sqrt(np.sum(sides**2))
    w: complex = 0.0
    for signs in ((1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)):
        v = 0.5 * sides * signs
        rho = np.sqrt(v @ C @ v)
        beta = inverse_langevin(rho / P**2)
        w += rho * beta + P**2 * (np.log(2.0 * beta) - beta - np.log(1.0 - np.exp(-2.0 * beta)))
    w -= inverse_langevin(1.0 / P) / P * np.sum(sides**2 * 0.5 * np.log(np.diag(C)))
    return complex(n * 1.38e-23 * 298.0 / 4.0 * w)


def fung(C: Matrix, J: complex, p: tuple[float, ...]) -> complex:
    c, l11, l22, mu1, mu2 = p[:5]
    E = 0.5 * (C / J ** (2 / 3) - np.eye(3))
    mu = (mu1, mu2, mu2)
    coupling = np.full((3, 3), l11)
    coupling[1, 1] = coupling[2, 2] = l22
    Q = sum(2.0 * mu[a] * (E @ E)[a, a] for a in range(3))
    Q += sum(coupling[a, b] * E[a, a] * E[b, b] for a in range(3) for b in range(3))
    return complex(0.5 * c * (np.exp(Q / c) - 1.0))


def gasser(C: Matrix, J: complex, p: tuple[float, ...]) -> complex:
    mu, k1, k2, theta = p[:4]
    C = C / J ** (2 / 3)
    n = np.array([np.cos(theta), np.sin(theta), 0.0])
    return complex(mu / 2.0 * (np.trace(C) - 3.0) + k1 / k2 * (np.exp(k2 * (n @ C @ n - 1.0) ** 2) - 1.0))


def yeoh(C: Matrix, J: complex, p: tuple[float, ...]) -> complex:
    x = np.trace(C) / J ** (2 / 3) - 3.0
    return complex(sum(p[i] * x ** (i + 1) for i in range(3)))


ENERGIES = {f.__name__: f for f in (ogden, tong_fung, bischoff, fung, gasser, yeoh)}


def nominal_stress(name: str, F: NDArray[np.float64], p: NDArray[np.float64]) -> NDArray[np.float64]:
    """P = dW/dF (3, 3), volumetric part included."""
    P = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            G = F.astype(complex)
            G[i, j] += 1e-30j
            J = np.linalg.det(G)
            w = ENERGIES[name](G.T @ G, J, tuple(p)) + 0.5 * p[-1] * np.log(J) ** 2
            P[i, j] = w.imag / 1e-30
    return P


@njit(SIGNATURE.return_type(FUNCTION, *SIGNATURE.args))
def _call(law, C, p, derivatives, S, D, dS):  # type: ignore[no-untyped-def]
    law(C, p, derivatives, S, D, dS)


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.name)
@settings(max_examples=20, deadline=None)
@given(entries=st.lists(st.integers(-1000, 1000).map(lambda k: k / 1000), min_size=9, max_size=9))
def test_stress_is_the_derivative_of_the_papers_energy(law: Law, entries: list[float]) -> None:
    size = 0.008 if law.name == "bischoff" else 0.12  # chains of the Bischoff defaults lock at 3 % stretch
    F = np.diag([1.0, 1.0 + 0.13 * size, 1.0 - 0.07 * size]) + size * np.reshape(entries, (3, 3))
    p = np.array([q.default for q in law.parameters])
    C = F.T @ F
    # The reference differentiates eigenvalues: neither equal ones nor entries near 1e-11 (hence thousandths) allow it.
    assume(law.name != "ogden" or np.diff(np.linalg.eigvalsh(C)).min() > 1e-4)
    expected = nominal_stress(law.name, F, p)
    six = np.array([C[0, 0], C[1, 1], C[2, 2], C[0, 1], C[1, 2], C[0, 2]])
    S = np.empty(6)
    _call(law.point, six, p, False, S, np.empty((6, 6)), np.empty((p.size, 6)))
    full = np.array([[S[0], S[3], S[5]], [S[3], S[1], S[4]], [S[5], S[4], S[2]]])
    assert_allclose(F @ full, expected, rtol=1e-9, atol=1e-9 * max(1.0, float(np.abs(expected).max())))
