"""Any rig: a user's forward model with named taps, and the generic effects that may act at them."""

from gap.rig.generic import GenericEffect
from gap.rig.model import ForwardModel, ModelError, load_model

__all__ = ["ForwardModel", "GenericEffect", "ModelError", "load_model"]
