"""Identification: parameters of a forward model from one or several recordings, and how well they are known."""

from .cases import RecordingError
from .executors import workers
from .optimisers import FitError
from .result import FitResult
from .run import Progress, fit
from .spec import Spec, SpecError, load_spec, read_spec

__all__ = [
    "FitError",
    "FitResult",
    "Progress",
    "RecordingError",
    "Spec",
    "SpecError",
    "fit",
    "load_spec",
    "read_spec",
    "workers",
]
