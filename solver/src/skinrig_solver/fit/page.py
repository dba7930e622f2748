"""One self-contained HTML page about a fit: no scripts, no links to anywhere."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from . import units
from .result import FitResult

OPTIMISERS = {
    "trust-region": "trust-region least squares with exact sensitivities",
    "slsqp": "sequential quadratic programming (SLSQP) with exact sensitivities",
    "nelder-mead": "Nelder-Mead simplex, without derivatives",
}


def write_page(result: FitResult, path: Path | str) -> Path:
    """Write the page. Raises ImportError naming what it needs; OSError."""
    path = Path(path)
    path.write_text(render(result), encoding="utf-8")
    return path


def render(result: FitResult) -> str:
    """The page's HTML. Raises ImportError that says what to install if there is no matplotlib or Jinja2."""
    try:
        import jinja2
        import matplotlib as mpl
    except ImportError as error:
        raise ImportError(f"a fit's page needs {error.name}: pip install 'skinrig-solver[report]'") from error
    from . import figures, sections

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("skinrig_solver.fit", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["shown"] = _shown
    environment.filters["percent"] = lambda x: f"{100 * x:.2f} %"
    profiled = [e for e in result.estimates if e.profile is not None]
    with mpl.rc_context(figures.STYLE):
        return environment.get_template("page.html.j2").render(
            result=result,
            summary=_summary(result),
            optimiser=OPTIMISERS[result.spec.optimiser],
            held=_held(result),
            correlations=figures.as_image(figures.correlations(result)) if len(result.estimates) > 1 else "",
            profiles=figures.as_image(figures.profile_plots(profiled)) if profiled else "",
            posterior=result.posterior,
            pairs=figures.as_image(figures.pairs(result.posterior)) if result.posterior else "",
            likelihoods=figures.as_image(figures.likelihoods(result.posterior)) if result.posterior else "",
            recordings=[
                {
                    "label": label,
                    "note": result.notes[label],
                    "setup": result.setups[label].in_words(),
                    "curves": figures.as_image(figures.curves(result, label)),
                    "meshes": [
                        {
                            "time": field.time,
                            "image": figures.as_image(sections.mesh(field)),
                            "quantities": figures.as_image(sections.quantities(field))
                            if sections.has_quantities(field)
                            else "",
                        }
                        for field in fields[:1]
                    ],
                }
                for label, fields in result.fields.items()
            ],
        )


def _summary(result: FitResult) -> str:
    known = sum(e.identifiable for e in result.estimates)
    count = len(result.fields)
    return (
        f"The model explains {100 * result.vaf:.2f} % of the variance of {count} recording{'s' * (count > 1)}. "
        f"{known} of {len(result.estimates)} parameters are identifiable from {'them' if count > 1 else 'it'}. "
        f"It took {result.effort.forward_runs} forward runs and {result.effort.seconds:.0f} s."
    )


def _held(result: FitResult) -> list[dict[str, str]]:
    free = {e.free.symbol for e in result.estimates}
    return [
        {
            "symbol": p.symbol,
            "value": units.show(result.parameters[p.symbol], p.unit),
            "meaning": p.meaning,
            "source": p.source,
        }
        for p in result.info.parameters
        if p.symbol not in free
    ]


def _shown(value: Any, unit: str = "", digits: int = 4) -> str:
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞" if value > 0 else "−∞"
    return units.show(float(value), unit, digits)
