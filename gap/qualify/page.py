"""A qualification on paper: its file, one self-contained page with the control chart, and the instrument's history."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from acquire.files import write_text
from acquire.qualifications import Parameter, Qualification, dump, history, keep
from gap.data.quantities import quantity
from gap.qualify.judge import Judged
from gap.report.figures import overview
from gap.report.pages import render

WIDTH, HEIGHT, MARGIN = 340.0, 56.0, 12.0
"""Of a control chart, px."""
GOOD, BAD = "#0b6e99", "#c0392b"
"""Colours of a value within its tolerance, and beyond."""


def save(judged: Judged, file: Path, *, keep_in_history: bool = False, root: Path | None = None) -> Path:
    """Write the qualification to ``file`` and its page beside it; the page's path. Raises CannotWrite."""
    q = judged.qualification
    if keep_in_history:
        keep(q, root)
    write_text(file, dump(q))
    earlier = history(q.instrument, q.serial, root) if keep_in_history else []
    return write_text(file.with_suffix(".html"), page(judged, earlier or [q]))


def page(judged: Judged, known: Sequence[Qualification]) -> str:
    """The page as text; ``known`` are all qualifications of this instrument, oldest first, this one the last."""
    q = judged.qualification
    charts = {name: chart([(k, k.parameters[name]) for k in known if name in k.parameters]) for name in q.parameters}
    picture = overview(judged.diagnosis, "with the effect" if q.findings else "")
    return render("gap.qualify", "qualification.html", q=q, charts=charts, known=known, picture=picture)


def chart(points: Sequence[tuple[Qualification, Parameter]]) -> str:
    """A control chart as SVG markup: a parameter of each qualification, oldest first, with two standard errors, between
    its tolerances."""
    from markupsafe import Markup, escape

    if not points:
        return Markup()
    p = points[-1][1]
    widest = max(abs(x.value - p.nominal) + 2 * x.se for _, x in points)
    reach = max(1.2 * (p.tolerance or 0.0), 1.1 * widest) or 1.0

    def y(value: float) -> str:
        return f"{HEIGHT / 2 - (value - p.nominal) / reach * (HEIGHT / 2 - 4):.1f}"

    def level(value: float, look: str) -> str:
        return f'<line x1="0" x2="{WIDTH:g}" y1="{y(value)}" y2="{y(value)}" stroke="{look}/>'

    parts = [level(p.nominal, '#a8b4c0"')]
    if p.tolerance:
        parts += [level(p.nominal + side * p.tolerance, f'{BAD}" stroke-dasharray="5 4"') for side in (-1, 1)]
    step = (WIDTH - 2 * MARGIN) / max(len(points) - 1, 1)
    for k, (q, x) in enumerate(points):
        at, colour = f"{MARGIN + k * step:.1f}", BAD if x.passed is False else GOOD
        ends = f'y1="{y(x.value - 2 * x.se)}" y2="{y(x.value + 2 * x.se)}"'
        told = escape(f"{q.date:%Y-%m-%d}: {quantity(x.value, x.unit, x.se)}")
        parts.append(f'<line x1="{at}" x2="{at}" {ends} stroke="{colour}"/>')
        parts.append(f'<circle cx="{at}" cy="{y(x.value)}" r="4" fill="{colour}"><title>{told}</title></circle>')
    return Markup(f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" width="{WIDTH:g}" role="img">{"".join(parts)}</svg>')
