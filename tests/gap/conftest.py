"""Small problems whose answers are known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from acquire.recording.model import Recording, RunInfo, Series
from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active, Candidate, Evaluation, Rows
from sim_devices.chain import Parameter

FloatArray = NDArray[np.float64]


@dataclass
class LinearProblem:
    """y = A c + Σ effects + noise of σ = 1; an effect is a function of its parameter values."""

    measured: FloatArray
    design: FloatArray
    effects: Mapping[str, Callable[[Mapping[str, float]], FloatArray]] = field(default_factory=dict)
    sd: FloatArray | None = None
    name: str = "linear"
    runs: int = 1
    likelihood_powers: Sequence[float] = (1.0,)
    law_parameters: int = 0

    def __post_init__(self) -> None:
        n, p = self.design.shape
        self.prior_sd = np.full(p, np.inf) if self.sd is None else self.sd
        self.prior_mean = np.zeros(p)
        self.prior_scales: Sequence[FloatArray] = (self.prior_sd,)
        self.sd_without_discrepancy = self.prior_sd
        self.sound: NDArray[np.float64] | None = None
        self.resets: tuple[float, ...] = ()
        self.open_law = False
        self.input_block = ""
        self.sigma = np.ones(n)
        labels = {k: (np.zeros(n, np.int64), ("-",)) for k in ("channel", "phase", "level", "direction", "repeat")}
        run = np.repeat(np.arange(self.runs), -(-n // self.runs))[:n].astype(np.int64)
        self.rows = Rows(np.arange(n, dtype=float), run, labels)

    def start(self) -> FloatArray:
        return np.zeros(self.design.shape[1])

    def warm_start(self, hypothesis: object, unit: FloatArray) -> None:
        return None

    def lateness(self, fitted: object) -> None:
        return None

    def unwhitened(self, residual: FloatArray, active: Active) -> FloatArray:
        wider = self.noise_scale(active)
        return residual * self.sigma * (1.0 if wider is None else wider)

    def noise_scale(self, active: Active) -> FloatArray | None:
        return None

    def walk_log_bayes(self, fitted: Fit) -> float:
        return np.inf

    def belies(self, fitted: Fit) -> bool:
        return False

    def chance_log_bayes(self, fitted: Fit) -> float:
        return 0.0

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        return {f"c{k}": (float(v), "1") for k, v in enumerate(nuisance)}

    def evaluate(self, nuisance: FloatArray, active: Active, want_jacobian: bool = True) -> Evaluation:
        predicted = self.design @ nuisance
        for candidate, values in active.items():
            predicted = predicted + self.effects[candidate.key](values)
        return Evaluation(self.measured - predicted, self.design if want_jacobian else np.zeros((0, 0)))


@pytest.fixture
def linear() -> type[LinearProblem]:
    return LinearProblem


def candidate(name: str, *parameters: Parameter, stage: str = "actuator", block: str = "linear") -> Candidate:
    return Candidate(
        name, name.split("[")[0], stage, parameters or (Parameter("a", "1", -10.0, 10.0),), (block,), name, ""
    )


@pytest.fixture(name="candidate")
def _candidate() -> Callable[..., Candidate]:
    return candidate


def recording(
    channels: Mapping[str, FloatArray],
    time: FloatArray,
    command: Mapping[str, tuple[Sequence[float], Sequence[float]]] | None = None,
    instrument: str = "cutometer",
    repeat: int = 1,
    specimen: str = "skin",
    name: str = "r1",
) -> Recording:
    """A recording in memory: channels on one time base, the command as corners."""
    units = {"pressure": "Pa", "pressure_reference": "Pa", "apex_height": "m"}
    streams = {k: Series(np.asarray(v, float), np.asarray(time, float), units.get(k, "V")) for k, v in channels.items()}
    setpoints = {
        k: Series(np.asarray(v, float), np.asarray(t, float), units.get(k, "V"))
        for k, (t, v) in (command or {}).items()
    }
    return Recording(RunInfo(name, instrument, "", repeat=repeat, specimen=specimen), streams, setpoints)


@pytest.fixture(name="recording", scope="session")
def _recording() -> Callable[..., Recording]:
    return recording
