"""Finite elements and identification for skin experiments: suction, sheet under a probe, fingertip."""

from .api import Cost, Experiment, Field, Model, ModelInfo, Parameter, Result, SolverError
from .registry import models

__all__ = ["Cost", "Experiment", "Field", "Model", "ModelInfo", "Parameter", "Result", "SolverError", "models"]
__version__ = "0.1.0"
