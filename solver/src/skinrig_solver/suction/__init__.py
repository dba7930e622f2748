"""Problem A: suction through a probe's opening (Cutometer, aspiration device)."""

from ..api import Model
from .catalogue import RUBIN_BODNER_GAMMA_SUCTION, RUBIN_BODNER_SUCTION, YEOH_SUCTION
from .geometry import SuctionGeometry
from .models import SuctionModel

MODELS: dict[str, Model] = {m.info.name: m for m in (YEOH_SUCTION, RUBIN_BODNER_SUCTION, RUBIN_BODNER_GAMMA_SUCTION)}

__all__ = ["MODELS", "SuctionGeometry", "SuctionModel"]
