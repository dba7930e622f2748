"""Blind check of the diagnosis: a case generator with physics of its own, and a scorer.

Nothing here imports the diagnosis, its effect library or the simulated instruments (an import contract
enforces it): they share only the public vocabulary of effect names, the bundle format and the report schema.
"""

from .cases import Hidden, Truth, make, write_key
from .rig import Refused, perform
from .scoring import Scorecard, score

__all__ = ["Hidden", "Refused", "Scorecard", "Truth", "make", "perform", "score", "write_key"]
