"""Linear least squares with priors: factors of normal matrices, and the residual of a nuisance refit.

Notation: r whitened residual (n,), J its nuisance Jacobian (n, p), Λ = diag(1/sd²). The generalised projector
P = I − J (JᵀJ + Λ)⁻¹ Jᵀ removes the nuisance's part within its prior; then χ² after a linear nuisance refit is
rᵀ P r.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla

from sim_devices.chain import FloatArray


class Projector:
    """The linear nuisance refit about one point, factorised once and used for every effect."""

    def __init__(self, jacobian: FloatArray, prior_sd: FloatArray, gram: FloatArray | None = None) -> None:
        self.jacobian = jacobian
        normal = jacobian.T @ jacobian if gram is None else gram.copy()
        self.precision = np.where(np.isfinite(prior_sd), 1.0 / np.square(prior_sd), 0.0)
        normal[np.diag_indices_from(normal)] += self.precision
        self._factor = factorise(normal)

    def apply(self, vectors: FloatArray) -> FloatArray:
        """P v for v (n,) or (n, k)."""
        if not self.jacobian.shape[1]:
            return vectors
        left: FloatArray = vectors - self.jacobian @ sla.cho_solve(self._factor, self.jacobian.T @ vectors)
        return left

    def squares(self, vectors: FloatArray, seen: FloatArray) -> FloatArray:
        """vᵀ P v for each column of v (n, k), (k,), given ``seen``, Jᵀ v."""
        whole = np.einsum("ij,ij->j", vectors, vectors)
        return np.asarray(
            whole - np.einsum("ij,ij->j", seen, sla.cho_solve(self._factor, seen)) if len(seen) else whole
        )

    def inner(self, seen: FloatArray) -> FloatArray:
        """vᵀ (1 − P) w for all pairs of vectors (n,), given ``seen``, Jᵀ v in columns (p, k); (k, k)."""
        return np.asarray(seen.T @ sla.cho_solve(self._factor, seen)) if len(seen) else np.zeros((seen.shape[1],) * 2)

    def chi2(self, residual: FloatArray) -> float:
        """rᵀ P r: χ² of a residual (n,) after the linear refit, prior included."""
        return float(residual @ self.apply(residual))


def factorise(normal: FloatArray) -> tuple[FloatArray, bool]:
    """Cholesky factor of a normal matrix, with the least ridge that makes it definite."""
    scale = np.maximum(np.diag(normal), 1e-300)
    for ridge in (1e-12, 1e-9, 1e-6, 1e-3):
        try:
            ridged = normal.copy()
            ridged[np.diag_indices_from(ridged)] += ridge * scale
            factor: tuple[FloatArray, bool] = sla.cho_factor(ridged, check_finite=False)
        except np.linalg.LinAlgError:
            continue
        return factor
    raise np.linalg.LinAlgError("normal matrix is not positive definite")


def bordered(gram: FloatArray, jacobian: FloatArray, more: FloatArray) -> FloatArray:
    """The normal matrix of a Jacobian whose own is ``gram`` and of ``more`` columns."""
    cross = jacobian.T @ more
    return np.block([[gram, cross], [cross.T, more.T @ more]])


def compressed(columns: FloatArray, weights: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """The ``size`` principal directions of a weighted basis (n, q): columns of unit rms and their weights.

    With c ~ N(0, diag(weights²)) both bases give nearly the same prior over functions; the new one is shorter.
    """
    scaled = columns * weights
    size = min(size, scaled.shape[1])
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    order = np.argsort(values)[::-1][:size]
    order = order[values[order] > 1e-10 * values[order[0]]] if len(order) and values[order[0]] > 0 else order[:0]
    basis = scaled @ vectors[:, order]
    rms = np.sqrt(np.mean(basis**2, axis=0))
    return basis / np.maximum(rms, 1e-300), rms
