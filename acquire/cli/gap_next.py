"""``acquire gap next``: the experiment that is worth most after a report."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from acquire.cli.check import limits_of
from acquire.cli.inputs import found, load_all
from acquire.cli.numbers import whole
from acquire.cli.review import ALL, counting


def next_experiment(
    report: Annotated[Path, typer.Argument(help="gap.json of `acquire gap diagnose`.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for experiment.yaml and its protocol.")],
    recordings: Annotated[
        list[Path] | None, typer.Option(help="The report's recordings, where they are not where it says.")
    ] = None,
    station: Annotated[Path | None, typer.Option(help="Stay within this station's limits.")] = None,
    specimen: Annotated[list[str] | None, typer.Option(help="Only these specimens (may be repeated).")] = None,
    effects: Annotated[list[Path] | None, typer.Option(help="Python file(s) with further effects.")] = None,
    seed: Annotated[int, typer.Option(parser=whole(), help="Seed of all drawn numbers.")] = 1,
    everything: Annotated[bool, typer.Option("--all", help=ALL)] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print experiment.yaml as JSON.")] = False,
) -> None:
    """Write the experiment that is expected to tell most of the cause in a minute, or say that none would."""
    import yaml

    from acquire.files import write_text
    from gap.design.answers import asked_for, believed
    from gap.design.choice import choose
    from gap.design.experiment import EXPERIMENT, write
    from gap.effects import library
    from protocols.specimens import SKIN, of
    from protocols.text import did_you_mean

    said = read_report(report)
    files = found(recordings or files_of(said, report))
    session, _ = believed(counting(load_all(files), everything=everything), asked_for((), files))
    instrument = session[0].info.instrument
    _check_same(said, session, report)
    at_hand = (SKIN, *of(instrument))
    if unknown := [s for s in specimen or () if s not in at_hand]:
        raise ValueError(f"specimen {unknown[0]!r} is none of a {instrument}{did_you_mean(unknown[0], at_hand)}")
    known = library(instrument, effects or ())
    choice = choose(said, session, limits_of(instrument, station), known, specimen or (), seed)
    if choice.experiment is not None:
        write(choice.experiment, output)
    write_text(output / EXPERIMENT, yaml.safe_dump(choice.as_dict(), sort_keys=False))
    print(json.dumps(choice.as_dict(), indent=1) if as_json else f"{choice.text}\n\n{output}/{EXPERIMENT}")


def _check_same(report: Mapping[str, Any], session: Sequence[Any], path: Path) -> None:
    """Raises ValueError for recordings of which the report knows none."""
    known, given = report.get("recordings", []), [r.info.id for r in session]
    if known and not set(known) & set(given):
        raise ValueError(f"{path}: is on {', '.join(map(str, known))}, and these recordings are {', '.join(given)}")


def read_report(path: Path) -> dict[str, Any]:
    """A ``gap-report/1``. Raises ValueError that names the file and its fault."""
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path}: is not JSON: {error}") from None
    if not isinstance(said, dict) or said.get("schema") != "gap-report/1":
        raise ValueError(f"{path}: is not of schema gap-report/1")
    if not isinstance(said.get("causes"), list):
        raise ValueError(f"{path}: has no list of causes")
    _check_probabilities(said, path)
    return said


def _check_probabilities(said: Mapping[str, Any], path: Path) -> None:
    """Raises ValueError that names the file and the entry of a report that is no probability."""
    entries = {key: said.get(key) for key in ("none_probability", "outside_probability")}
    for k, cause in enumerate(said["causes"]):
        if not isinstance(cause, dict):
            raise ValueError(f"{path}: causes[{k}]: must have keys and values")
        entries[f"causes[{k}].probability"] = cause.get("probability")
    for name, value in entries.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and not (number and 0.0 <= value <= 1.0):
            raise ValueError(f"{path}: {name}: must be a number from 0 to 1, not {value!r}")


def files_of(report: Mapping[str, Any], path: Path) -> list[Path]:
    """The recordings that a report names. Raises ValueError where it names none, or one is gone."""
    files = [Path(p) for p in report.get("recording_files", [])]
    if not files:
        raise ValueError(f"{path}: does not say where its recordings are: give them with --recordings")
    if gone := [p for p in files if not p.exists()]:
        raise ValueError(f"{path}: its recording {gone[0]} is not there: give them with --recordings")
    return files


def advice(report: Mapping[str, Any], recordings: Sequence[Any]) -> dict[str, Any]:
    """The report's entries on the next experiment."""
    from gap.design.choice import choose

    choice = choose(report, recordings, limits_of(recordings[0].info.instrument, None))
    return {"next_experiment": choice.as_dict() | {"text": choice.text}, "next_experiment_note": ""}
