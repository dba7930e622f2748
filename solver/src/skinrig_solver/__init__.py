"""Finite elements and identification for skin experiments: suction, sheet under a probe, fingertip."""

import os

# LLVM's third level takes a quarter longer to compile these kernels and makes none of them faster (bench_suction.py
# starts, own). Without effect where numba is there already or the variable is set.
os.environ.setdefault("NUMBA_OPT", "2")

from .api import Cost, Experiment, Field, Model, ModelInfo, Parameter, Result, SolverError
from .registry import models

__all__ = ["Cost", "Experiment", "Field", "Model", "ModelInfo", "Parameter", "Result", "SolverError", "models"]
__version__ = "0.1.0"
