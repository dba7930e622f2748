"""``acquire fit plan``: which protocol, opening or level narrows a parameter of a fit most per minute."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from protocols import Protocol, Segment

MOST_POINTS = 240  # of a candidate's time grid
DRIVES = ("pressure", "probe_x", "probe_y", "probe_z")  # that models know


def plan(
    fitted: Annotated[Path, typer.Argument(metavar="FIT.JSON", help="Result of `acquire fit`, best with --posterior.")],
    parameter: Annotated[str, typer.Option("--parameter", "-p", help="The parameter to narrow.")],
    protocol: Annotated[
        list[str] | None, typer.Option(help="Candidates, by file or name; else the library's of this instrument.")
    ] = None,
    levels: Annotated[str, typer.Option(help="Factors on a protocol's load, such as 0.5,1,1.5.")] = "1",
    openings: Annotated[str, typer.Option(help="Diameters of the opening to try, in mm, such as 2,4,8.")] = "",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="JSON file for the table.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON on stdout.")] = False,
) -> None:
    """Which further experiment narrows a parameter most per minute."""
    from acquire.cli.solver import solver_for

    data = _fit(fitted)
    solver = solver_for(str(data.get("model")))
    instrument = _instrument(data, fitted)
    factors = _numbers("--levels", levels)
    diameters = _numbers("--openings", openings) or (None,)
    fitted_with = _geometry(data)
    experiments: dict[str, tuple[Any, float]] = {}
    left_out: dict[str, str] = {}
    for name, one in _protocols(protocol, instrument).items():
        for factor in factors:
            for diameter in diameters:
                label = name + (f" x {factor:g}" if factor != 1.0 else "") + (f", {diameter:g} mm" if diameter else "")
                try:
                    experiments[label] = _experiment(solver, instrument, one, factor, diameter, label, fitted_with)
                except ValueError as error:  # beyond the instrument's limits, say: no candidate
                    left_out[label] = str(error).splitlines()[0]
    if not experiments:
        reason = next(iter(left_out.values()), "the library has none")
        raise ValueError(f"no protocol to choose from for a {instrument}: {reason}")
    gains = solver.plan(data, parameter, experiments)
    rows = [
        {
            "protocol": g.name, "minutes": g.minutes, "expected_deviation": g.deviation, "narrowing": g.narrowing,
            "per_minute": g.per_minute, "trouble": g.trouble,
        }
        for g in gains
    ]  # fmt: skip
    table = {"schema": "skinrig-plan/1", "parameter": parameter, "candidates": rows, "left_out": left_out}
    text = json.dumps(table, indent=1)
    if output:
        from acquire.files import write_text

        write_text(output, text + "\n")
    typer.echo(text if as_json else _table(parameter, gains, left_out))


def _fit(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path}: not JSON: {error}") from None
    if not isinstance(data, dict) or data.get("schema") != "skinrig-fit/1":
        raise ValueError(f"{path}: not the result of a fit (schema skinrig-fit/1)")
    return data


def _instrument(data: dict[str, Any], path: Path) -> str:
    kinds = sorted({str(r["instrument"]) for r in data.get("recordings", [])})
    if len(kinds) != 1:
        have = " and ".join(kinds) or "none"
        raise ValueError(f"{path}: a plan needs recordings of one instrument, this fit has {have}")
    return kinds[0]


def _geometry(data: dict[str, Any]) -> dict[str, float]:
    """The opening or the hole that the fit took: its first recording's."""
    recordings: list[dict[str, Any]] = data.get("recordings", [])
    own = recordings[0].get("geometry", {}) if recordings else {}
    return {name: float(own[name]) for name in ("opening_radius", "opening", "hole_radius") if name in own}


def _numbers(option: str, text: str) -> tuple[float, ...]:
    try:
        found = tuple(float(part) for part in text.split(",") if part.strip())
    except ValueError:
        found = (-1.0,)
    if not all(0.0 < x < 1e6 for x in found):
        raise ValueError(f"{option} {text!r}: expected positive numbers with commas between them")
    return found


def _protocols(names: list[str] | None, instrument: str) -> dict[str, Protocol]:
    from protocols import find, library, load

    paths = [find(name) for name in names] if names else list(library().values())
    loaded = {path.stem: load(path) for path in paths}
    return {name: one for name, one in loaded.items() if one.instrument == instrument}


def _experiment(
    solver: Any,
    instrument: str,
    protocol: Protocol,
    factor: float,
    diameter: float | None,
    label: str,
    geometry: dict[str, float],
) -> tuple[Any, float]:
    """A protocol's set-points, scaled, as the solver's experiment; with its minutes. ``geometry`` is the fit's own,
    for what neither the protocol nor the ``diameter`` to try says."""
    import numpy as np

    from acquire.cli.check import limits_of
    from protocols import Setpoints, compile_protocol, effective_limits

    limits = limits_of(instrument, None)
    plain = compile_protocol(protocol, limits)
    setpoints = Setpoints(tuple(_scaled(segment, factor) for segment in plain.segments))
    for violation in effective_limits(protocol, limits).violations(setpoints):
        raise ValueError(f"{label}: {violation.quantity} {violation.message}")
    time = np.linspace(0.0, setpoints.duration, MOST_POINTS)
    drive = {quantity: points for quantity, points in setpoints.at(time).items() if quantity in DRIVES}
    setup = getattr(protocol, "setup", None)
    opening = 1e-3 * diameter if diameter else getattr(setup, "opening", None)
    if opening and "pressure" in drive:
        option = "opening" if "opening" in geometry else "opening_radius"  # of a fingertip, of a suction model
        geometry = {**geometry, option: 0.5 * float(opening)}
    return solver.experiment(instrument, time, drive, geometry, label), setpoints.duration / 60.0


def _scaled(segment: Segment, factor: float) -> Segment:
    start, end = ({q: factor * v for q, v in ends.items()} for ends in (segment.start, segment.end))
    return replace(segment, start=start, end=end)


def _table(parameter: str, gains: list[Any], left_out: dict[str, str]) -> str:
    width = max(len(g.name) for g in gains)
    lines = [f"{parameter}: share of its present uncertainty that goes", f"{'':<{width}}  minutes  in all  per minute"]
    for g in gains:
        if g.trouble:
            lines.append(f"{g.name:<{width}}  cannot be judged: {g.trouble}")
        else:
            rate = 1.0 - math.exp(-g.per_minute)
            lines.append(f"{g.name:<{width}}  {g.minutes:7.1f}  {100 * g.narrowing:4.0f} %  {100 * rate:8.0f} %")
    lines += [f"left out: {reason}" for reason in left_out.values()]
    return "\n".join(lines)
