"""One self-contained HTML page of one or several recordings: no scripts, no links to anywhere."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from acquire.analysis.curves import DEFINITIONS, recording_parameters
from acquire.analysis.statistics import Spread, spread
from acquire.files import write_text
from acquire.recording.model import Recording
from acquire.recording.review import counted
from acquire.report.figures import as_image, comparison, frame_strip, overview
from acquire.report.summary import summarise
from acquire.words import share, shown


def write_page(recordings: Sequence[Recording], path: Path | str, title: str = "") -> Path:
    """Write a page about ``recordings`` to ``path``; several of one protocol are also drawn into one frame.

    Everything in a recording is shown as text, never as markup. Raises ValueError without recordings; CannotWrite.
    """
    return write_text(path, render(recordings, title))


def render(recordings: Sequence[Recording], title: str = "") -> str:
    """The page's HTML. Raises ValueError without recordings."""
    import jinja2

    if not recordings:
        raise ValueError("a report needs at least one recording")
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("acquire.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["shown"] = shown
    environment.filters["share"] = share
    environment.filters["fact"] = _fact
    count = f"{len(recordings)} recordings"
    return environment.get_template("page.html.j2").render(
        title=title or (recordings[0].info.id if len(recordings) == 1 else count),
        subtitle=_subtitle(recordings),
        runs=[_run(recording) for recording in recordings],
        comparisons=_comparisons(recordings),
        definitions=DEFINITIONS,
        version=_version(),
    )


def _run(recording: Recording) -> dict[str, Any]:
    strip = frame_strip(recording)
    return {
        "summary": summarise(recording),
        "overview": as_image(overview(recording)),
        "frames": as_image(strip) if strip is not None else "",
        "protocol": recording.info.protocol,
    }


def _comparisons(recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """A figure, and how parameters scatter, for each instrument and protocol that was recorded more than once.

    Runs that are left out are drawn faint and enter no mean, band or scatter; each is named with the reason.
    """
    groups: dict[tuple[str, str], list[Recording]] = defaultdict(list)
    for recording in recordings:
        if recording.default_plot and len(recording.streams[recording.default_plot].time) > 1:
            groups[recording.info.instrument, recording.info.protocol_name].append(recording)
    return [
        {
            "title": f"{instrument}: {name or 'all'}, {len(group)} recordings",
            "image": as_image(comparison(group)),
            "spreads": _spreads(counted(group)[0]),
            "left_out": counted(group)[1],
        }
        for (instrument, name), group in groups.items()
        if len(group) > 1
    ]


def _spreads(group: Sequence[Recording]) -> dict[str, Spread]:
    """Scatter of the curve parameters over ``group``, of those that two recordings have."""
    tables = [recording_parameters(recording) for recording in group]
    columns = {name: [table.get(name, math.nan) for table in tables] for name in DEFINITIONS}
    return {name: spread(values) for name, values in columns.items() if sum(map(math.isfinite, values)) >= 2}


def _subtitle(recordings: Sequence[Recording]) -> str:
    facts = [
        ", ".join(dict.fromkeys(recording.info.instrument for recording in recordings)),
        ", ".join(dict.fromkeys(r.info.subject for r in recordings if r.info.subject)),
        ", ".join(dict.fromkeys(r.info.site for r in recordings if r.info.site)),
    ]
    return " · ".join(fact for fact in facts if fact)


def _fact(value: Any) -> str:
    """A calibration value: a number to six digits, anything else as it is."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _version() -> str:
    try:
        return version("skinrig")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "(not installed)"
