"""A term in the report, proposed where no known effect explains the gap."""

from __future__ import annotations

from typing import Any

from gap.data.quantities import quantity
from gap.diagnosis import Diagnosis
from gap.report.parameters import rounded
from gap.report.words import SPLITS
from gap.terms.propose import Proposal
from gap.terms.term import Term

FILE = "acquire gap diagnose RUN... --term FILE saves it as an effect to be tried with --effects FILE"
SKIN = "Between pressure and height it may as well be skin of another law."


def of_term(d: Diagnosis) -> dict[str, Any] | None:
    """The proposed term as plain JSON types; None where the verdict asks for none, or none can be made."""
    p = d.term
    if p is None:
        return None
    out: dict[str, Any] = {"helps": p.helps, "reason": p.reason, "text": text(p), "evidence": rounded(p.evidence)}
    if p.term is None:
        return out
    return out | {
        "name": p.term.name,
        "stage": p.term.place.stage,
        "anchor": p.term.place.anchor,
        "formula": formula(p.term),
        "unit": p.term.place.unit,
        "parts": _parts(p, p.term),
        "shrink": {k: None if s.value is None else rounded(s.value) for k, s in p.shrinks.items()},
        "gaps": {k: {"before": rounded(s.before), "after": rounded(s.after)} for k, s in p.shrinks.items()},
        "file": FILE,
    }


def _parts(p: Proposal, term: Term) -> list[dict[str, Any]]:
    return [
        {
            "text": part.text(term.place, quantity),
            "amount": rounded(amount),
            "se": rounded(se),
            "of": term.place.names[part.of],
            "function": part.function,
            "scale": rounded(part.scale),
            "rate": part.rate,
            "lag": rounded(part.tau),
        }
        for part, amount, se in zip(term.parts, term.amounts, p.errors, strict=True)
    ]


def formula(term: Term) -> str:
    """The addition, and the signal that it is added to."""
    return term.formula(quantity)


def text(p: Proposal) -> str:
    """The proposal in a sentence or two."""
    if not p.helps or p.term is None:
        return f"No term helps: {p.reason}."
    fitted = p.shrinks["fitted"].value or 0.0
    tried = [(on, p.shrinks[split].value) for split, on in SPLITS.items() if split in p.shrinks]
    on = [(name, value) for name, value in tried if value is not None]
    elsewhere = f", and by {100 * min(on[0][1], 1.0):.0f} % on {on[0][0]}" if on else ""
    where = f"{p.term.place.names['own']} ({p.term.place.stage})"
    said = f"A term added to {where} makes the gap there shrink by {100 * min(fitted, 1.0):.0f} %{elsewhere}: "
    return f"{said}{formula(p.term)}." + (f" {SKIN}" if p.term.place.stage == "tissue" else "")
