"""The finite elements' law of skin by the parameters that a fit moves: Yeoh's elasticity with relaxing moduli."""

from __future__ import annotations

import numpy as np

from sim_devices.chain import FloatArray

TIMES = (0.2, 2.5, 30.0)
"""Relaxation times to begin from, s (assumed)."""
SHARES = (0.3, 0.3, 0.4)
"""Relaxing moduli over the one that stays, to begin from (assumed)."""
BENDS = (0.5, 0.05)
"""c20/G and c30/G to begin from (assumed: stiffening as of skin)."""
FREE = ("G", "c20", "c30", "g1", "g2", "g3", "tau1", "tau2", "tau3")
"""Parameters of the model that are fitted, through `moduli`."""


def relaxing_shares(start: FloatArray, x: FloatArray) -> FloatArray:
    """Prony shares (k,), positive and below 1 together, at logs ``x`` (k,) of the relaxing moduli over ``start``."""
    relaxing = start * np.exp(np.clip(x, -6.0, 6.0))
    return np.asarray(relaxing / (1.0 + relaxing.sum()))


def moduli(x: FloatArray, base: float) -> dict[str, float]:
    """Parameters of the Yeoh law at ``x`` (9,): logs of scale, c20/G, c30/G, relaxing moduli and their times, each
    over its start.

    Every modulus is in proportion to the scale; relaxing shares are positive and below 1 together.
    """
    x = np.clip(x, -6.0, 6.0)
    modulus = base * float(np.exp(x[0]))
    shares = relaxing_shares(np.array(SHARES), x[3:6])
    times = np.array(TIMES) * np.exp(x[6:9])
    out = {
        "G": modulus,
        "c20": BENDS[0] * modulus * float(np.exp(x[1])),
        "c30": BENDS[1] * modulus * float(np.exp(x[2])),
    }
    for i, (g, tau) in enumerate(zip(shares, times, strict=True), start=1):
        out |= {f"g{i}": float(g), f"tau{i}": float(tau)}
    return out | {"friction": 0.0, "spring_force": 0.0}


def moduli_slopes(x: FloatArray, base: float, step: float = 1e-6) -> FloatArray:
    """Derivative of the `FREE` parameters by ``x``, (9, 9)."""
    out = np.empty((len(FREE), len(x)))
    for k in range(len(x)):
        up, down = x.copy(), x.copy()
        up[k] += step
        down[k] -= step
        high, low = moduli(up, base), moduli(down, base)
        out[:, k] = [(high[s] - low[s]) / (2 * step) for s in FREE]
    return out


def creep(shares: FloatArray, times: FloatArray) -> tuple[float, ...]:
    """The creep that undoes a relaxation 1 - sum g_i (1 - exp(-t / tau_i)), as parameters of ``kernels.prony``.

    With y_i the load s lagged by tau_i, p = s - sum g_i y_i; so s = p + g·y with y' = (1 p + (1 gᵀ - I) y) / tau,
    whose matrix is similar to a symmetric one: its modes are the creep's.
    """
    root = np.sqrt(shares / times)
    symmetric = np.outer(root, root) - np.diag(1.0 / times)
    values, vectors = np.linalg.eigh(symmetric)
    weights = np.square(vectors.T @ root) / -values
    return (1.0, *(float(v) for pair in zip(weights, -1.0 / values, strict=True) for v in pair))
