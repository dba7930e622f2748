"""Recorded pressure -> apex height of skin whose law is known from elsewhere, within an uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gap.inference.evidence import Fit
from gap.inference.hypothesis import FROZEN, Active, Candidate, Evaluation
from gap.inference.least_squares import fit, under
from gap.null.skin_laws import SkinLaw, switched
from gap.null.suction_height import HeightBlock
from sim_devices.chain import FloatArray


class KnownSkin:
    """A block of apex heights under one ``law`` of skin, whose parameters ``names`` are normal with a ``mean`` (m,) and
    ``covariance`` (m, m).

    Nuisance: as of the block, but that in place of these parameters stand their coordinates, standard normal.
    """

    sound: FloatArray | None = None
    open_law = True
    input_block = ""
    law_parameters = 0

    def __init__(
        self, block: HeightBlock, law: SkinLaw, names: Sequence[str], mean: FloatArray, covariance: FloatArray
    ) -> None:
        block.start()
        self.block, self.law, self.names = block, law, tuple(names)
        self.name, self.rows, self.measured, self.sigma = block.name, block.rows, block.measured, block.sigma
        self.resets = block.resets
        parts = list(block.PARTS)
        self.places = [parts.index(name) for name in names]
        self._size, self.root = len(parts), np.linalg.cholesky(covariance)
        self._centre = switched(block.PARTS, block.prior_mean, law)
        self._centre[self.places] = mean
        self.prior_mean = self._centre.copy()
        self.prior_mean[self.places] = 0.0
        self.widths = block.widths_of(law)
        self.prior_scales: Sequence[FloatArray] = tuple(self._known(sd) for sd in self.widths)
        self._inner = under(block, block.prior_mean, self.prior_scales[-1])  # whose derivatives it asks for
        self.prior_sd = self.prior_scales[0]
        self.prior_sd = fit(self).best_prior(self.prior_scales)

    def _known(self, sd: FloatArray) -> FloatArray:
        """Prior widths (p,) with the skin's parameters in their coordinates."""
        out = sd.copy()
        out[: self._size] = FROZEN
        out[self.places] = 1.0
        return out

    def parameters(self, nuisance: FloatArray) -> FloatArray:
        """The block's own nuisance vector (p,)."""
        out = nuisance.copy()
        out[: self._size] = self._centre[: self._size]
        out[self.places] += self.root @ nuisance[self.places]
        return out

    @property
    def likelihood_powers(self) -> Sequence[float]:
        simple = len(self.prior_scales) - len(self.block.DISCREPANCY_SCALES)
        return (*[self.block.trust_simple] * simple, *[self.block.trust] * len(self.block.DISCREPANCY_SCALES))

    @property
    def sd_without_discrepancy(self) -> FloatArray:
        """Prior widths (p,) of the simulation by itself."""
        return self._known(self.block.sd_without_discrepancy)

    def start(self) -> FloatArray:
        return self.prior_mean.copy()

    def under_simple_law(self, candidate: Candidate, unit: FloatArray) -> Fit | None:
        return None

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> None:
        return None

    def lateness(self, fitted: Fit) -> None:
        return None

    def noise_scale(self, active: Active) -> FloatArray | None:
        return self.block.noise_scale(active)

    def unwhitened(self, residual: FloatArray, active: Active) -> FloatArray:
        return self.block.unwhitened(residual, active)

    def walk_log_bayes(self, fitted: Fit) -> float:
        return self.block.walk_log_bayes(fitted)

    def belies(self, fitted: Fit) -> bool:
        return self.block.belies(fitted)

    def chance_log_bayes(self, fitted: Fit) -> float:
        return self.block.chance_log_bayes(fitted)

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        return self.block.quantities(self.parameters(nuisance))

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        made = self._inner.evaluate(self.parameters(nuisance), active, want_jacobian)
        if not want_jacobian:
            return made
        jacobian = made.jacobian.copy()
        jacobian[:, self.places] = jacobian[:, self.places] @ self.root
        return Evaluation(made.residual, jacobian)
