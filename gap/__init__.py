"""The sim-to-real diagnosis: where simulation and measurement differ, the cause, how far the gap shrinks.

The public face; all else here may change. Names are loaded when first used: the blind generator, which is in this
package too, must run without any of them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gap.design.plan import Plan, plan
    from gap.diagnosis import Diagnosis, DiagnosisError, diagnose
    from gap.report.document import as_json
    from gap.report.html import write_page
    from gap.rig import ForwardModel, GenericEffect, ModelError, load_model
    from gap.terms.term import save_term

_HOMES = {
    "diagnose": "gap.diagnosis", "Diagnosis": "gap.diagnosis", "DiagnosisError": "gap.diagnosis",
    "plan": "gap.design.plan", "Plan": "gap.design.plan",
    "as_json": "gap.report.document", "write_page": "gap.report.html",
    "save_term": "gap.terms.term",
    "ForwardModel": "gap.rig", "GenericEffect": "gap.rig", "ModelError": "gap.rig", "load_model": "gap.rig",
}  # fmt: skip

__all__ = [
    "Diagnosis", "DiagnosisError", "ForwardModel", "GenericEffect", "ModelError", "Plan", "as_json", "diagnose",
    "load_model", "plan", "save_term", "write_page",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'gap' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
