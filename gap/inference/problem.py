"""Data against a forward model, as every step of the diagnosis sees it.

A problem hides instrument and tissue behind whitened residuals: all inference is the same for a suction probe, the
micro-robot and any other rig.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Candidate, Evaluation, Lateness, Rows, Start
from sim_devices.chain import FloatArray


class Problem(Protocol):
    """One block of data with its forward model.

    ``measured`` (n,) and ``sigma`` (n,) are the data behind the rows in SI and their noise. A whitened residual is not
    always their difference over sigma: of noise that neighbours have in common it holds the innovations
    (`gap.inference.least_squares.predicted` goes back).
    ``prior_scales`` are prior widths (p,) over which the evidence is averaged, narrow ones first; ``prior_sd`` is
    the one used while fitting, ``sd_without_discrepancy`` that of the simulation by itself, without a discrepancy.
    ``sound`` (p,) is the nuisance of an instrument as it should be, where that is all there is to know; None where
    there is tissue. ``likelihood_powers``, one for each width, are exponents on the evidence, for model error that
    tempering does not see: low where a person's tissue is free. The first also weighs the widths against
    each other. ``law_parameters`` is how many of the nuisance's first parameters are of laws that widths exchange for
    each other, by freezing some: of a width that freezes parameters which a fit has moved, that fit tells nothing."""

    name: str
    rows: Rows
    measured: FloatArray
    prior_mean: FloatArray
    prior_sd: FloatArray
    prior_scales: Sequence[FloatArray]
    sound: FloatArray | None
    law_parameters: int

    @property
    def sigma(self) -> FloatArray:
        """Noise (n,) of the rows, SI."""
        ...

    @property
    def likelihood_powers(self) -> Sequence[float]:
        """How far the evidence is trusted under each of the prior's widths."""
        ...

    @property
    def resets(self) -> Sequence[float]:
        """Times (s) after the beginning of suction at which recordings jump; none of other rigs."""
        ...

    @property
    def sd_without_discrepancy(self) -> FloatArray:
        """Prior widths (p,) of the simulation by itself."""
        ...

    @property
    def open_law(self) -> bool:
        """Whether the residual may be skin of another law."""
        ...

    @property
    def input_block(self) -> str:
        """The block whose fit its simulation has as input, as axes have the forces; empty where there is none."""
        ...

    def under_simple_law(self, candidate: Candidate, unit: FloatArray) -> Fit | None:
        """A few steps of a fit with an effect, from ``unit`` (k,) on, under the best simple law and nothing beside it.
        None where such a law is at the noise without an effect, or where there is none."""
        ...

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        """The nominal model's own parameters at a nuisance vector (p,), by name: value and unit, SI."""
        ...

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        """Residual and Jacobian at nuisance parameters (p,) with the effects of ``active`` switched on."""
        ...

    def start(self) -> FloatArray:
        """A sensible nuisance vector (p,) to begin from."""
        ...

    def warm_start(self, hypothesis: Sequence[Candidate], unit: FloatArray) -> Start | None:
        """Where else a fit with effects about ``unit`` (k,) should begin. None where the prior is known."""
        ...

    def lateness(self, fitted: Fit) -> Lateness | None:
        """How much later than ``fitted`` each of the command's kinks shows; None where that is not known, or they all
        are in time."""
        ...

    def noise_scale(self, active: Active) -> FloatArray | None:
        """How many times wider (n,) the noise is under effects that happen by chance; None without such effects."""
        ...

    def unwhitened(self, residual: FloatArray, active: Active) -> FloatArray:
        """The difference (n,), SI, of measurement and prediction behind a whitened ``residual`` (n,); a reading that
        walks at random is predicted from the rows before."""
        ...

    def walk_log_bayes(self, fitted: Fit) -> float:
        """Nats by which readings that walk at random describe the rest of a fit better than slow noise and answers to
        motion do; infinite where none walks."""
        ...

    def belies(self, fitted: Fit) -> bool:
        """Whether a fit does not do what one of its effects is called for, as an overshoot beside a regulator so slow
        that nothing overshoots."""
        ...

    def chance_log_bayes(self, fitted: Fit) -> float:
        """Nats by which another law of chance than that of the ``fitted`` effects describes their rest better."""
        ...
