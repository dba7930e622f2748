"""Problem C: the cross-section of a fingertip under suction."""

from ..api import Model
from .model import FINGER_SECTION
from .section import FingerGeometry

MODELS: dict[str, Model] = {FINGER_SECTION.info.name: FINGER_SECTION}

__all__ = ["MODELS", "FingerGeometry"]
