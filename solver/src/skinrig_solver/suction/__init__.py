"""Problem A: suction through a probe's opening (Cutometer, aspiration device)."""

from ..api import Model
from .catalogue import (
    FIBRE_SUCTION,
    MOONEY_SUCTION,
    NEO_HOOKE_SUCTION,
    RUBIN_BODNER_GAMMA_SUCTION,
    RUBIN_BODNER_SUCTION,
    YEOH_SUCTION,
    YEOH_THREE_LAYERS,
    YEOH_TWO_LAYERS,
    one_layer,
)
from .geometry import SuctionGeometry
from .models import SuctionModel

_ALL = (
    YEOH_SUCTION, YEOH_TWO_LAYERS, YEOH_THREE_LAYERS, NEO_HOOKE_SUCTION, MOONEY_SUCTION, FIBRE_SUCTION,
    RUBIN_BODNER_SUCTION, RUBIN_BODNER_GAMMA_SUCTION,
)  # fmt: skip
MODELS: dict[str, Model] = {model.info.name: model for model in _ALL}

__all__ = ["MODELS", "SuctionGeometry", "SuctionModel", "one_layer"]
