"""The library of effects for our own instruments, with a user's additions."""

from gap.effects.load import library

__all__ = ["library"]
