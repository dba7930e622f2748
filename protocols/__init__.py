"""Measurement protocols: units, the YAML schema, and the compiler to timed set-points. Imports nothing of ours.

>>> protocol = load("protocols/library/demo-cutometer.yaml")            # doctest: +SKIP
>>> setpoints = compile_protocol(protocol, Limits.parse({"pressure": {"low": "-500 mbar", "high": "0 mbar"}}))
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from protocols.catalogue import find, library
    from protocols.compiler import compile_protocol, effective_limits
    from protocols.errors import Problem, ProtocolError
    from protocols.limits import Limits, Range
    from protocols.schema import Protocol
    from protocols.setpoints import Segment, Setpoints, Until
    from protocols.text import dump, json_schema, load

_HOMES = {
    "catalogue": ("find", "library"),
    "compiler": ("compile_protocol", "effective_limits"),
    "errors": ("Problem", "ProtocolError"),
    "limits": ("Limits", "Range"),
    "schema": ("Protocol",),
    "setpoints": ("Segment", "Setpoints", "Until"),
    "text": ("dump", "json_schema", "load"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "Limits",
    "Problem",
    "Protocol",
    "ProtocolError",
    "Range",
    "Segment",
    "Setpoints",
    "Until",
    "compile_protocol",
    "dump",
    "effective_limits",
    "find",
    "json_schema",
    "library",
    "load",
]


def __getattr__(name: str) -> Any:
    """Import on first use: pydantic and YAML take longer than ``acquire --help`` may."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
