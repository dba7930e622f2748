"""A qualification on paper: its file, one self-contained page with the control chart, and the instrument's history."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from acquire.files import write_text
from acquire.qualifications import Parameter, Qualification, dump, history, keep
from gap.qualify.judge import Judged
from gap.report.figures import overview

WIDTH, HEIGHT, MARGIN = 520.0, 90.0, 14.0
"""Of a control chart, px."""


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
    from jinja2 import Environment, PackageLoader

    environment = Environment(loader=PackageLoader("gap.qualify", "templates"), autoescape=True)
    q = judged.qualification
    charts = {name: chart([(k, k.parameters[name]) for k in known if name in k.parameters]) for name in q.parameters}
    picture = overview(judged.diagnosis, "with the effect" if q.findings else "")
    return environment.get_template("qualification.html").render(q=q, charts=charts, known=known, picture=picture)


def chart(points: Sequence[tuple[Qualification, Parameter]]) -> str:
    """A control chart as SVG: a parameter of each qualification with two standard errors, between its tolerances."""
    if not points:
        return ""
    p = points[-1][1]
    reach = p.tolerance or max((abs(x.value - p.nominal) + 2 * x.se for _, x in points), default=1.0) or 1.0
    reach = max(1.2 * reach, *(1.1 * (abs(x.value - p.nominal) + 2 * x.se) for _, x in points))

    def y(value: float) -> float:
        return HEIGHT / 2 - (value - p.nominal) / reach * (HEIGHT / 2 - 4)

    step = (WIDTH - 2 * MARGIN) / max(len(points) - 1, 1)
    parts = [f'<line x1="0" x2="{WIDTH:g}" y1="{y(p.nominal):.1f}" y2="{y(p.nominal):.1f}" stroke="#999"/>']
    for limit in (-1, 1) if p.tolerance else ():
        at = y(p.nominal + limit * (p.tolerance or 0.0))
        dashes = 'stroke="#b00" stroke-dasharray="5 4"'
        parts.append(f'<line x1="0" x2="{WIDTH:g}" y1="{at:.1f}" y2="{at:.1f}" {dashes}/>')
    for k, (q, x) in enumerate(points):
        at = MARGIN + k * step
        low, high = y(x.value - 2 * x.se), y(x.value + 2 * x.se)
        colour = "#b00" if x.passed is False else "#06c"
        parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{low:.1f}" y2="{high:.1f}" stroke="{colour}"/>')
        title = f"{q.date:%Y-%m-%d}: {x.value:.4g} ± {x.se:.2g} {x.unit}"
        parts.append(
            f'<circle cx="{at:.1f}" cy="{y(x.value):.1f}" r="4" fill="{colour}"><title>{title}</title></circle>'
        )
    return f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" width="{WIDTH:g}" role="img">{"".join(parts)}</svg>'
