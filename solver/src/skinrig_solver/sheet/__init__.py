"""Problem B: a sheet of skin under in-plane pre-stress, moved by the micro-robot's probe (paper M)."""

from ..laws import LAWS
from .model import SheetModel

MODELS: dict[str, SheetModel] = {f"sheet_{name}": SheetModel(law) for name, law in LAWS.items()}

__all__ = ["MODELS", "SheetModel"]
