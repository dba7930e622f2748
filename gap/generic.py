"""The documented import path of a rig's own effects."""

from gap.rig.generic import GenericEffect

__all__ = ["GenericEffect"]
