"""``acquire show | export | report | import | recover | ls``: everything done with recordings after they were made."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acquire.cli.inputs import bundles, holds_others
from acquire.cli.told import strange

if TYPE_CHECKING:
    from acquire.catalogue import Entry
    from acquire.recording import Recording

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Run = Annotated[Path, typer.Argument(help="A recording (.h5), a bundle's folder, or a journal.")]
DEFAULT = Path("runs")
SUFFIXES = (".h5", ".hdf5", ".nxs")
Force = Annotated[bool, typer.Option("--force", help="Replace existing files.")]


def show(
    run: Run,
    png: Annotated[Path | None, typer.Option(help="Draw the recording into this file (.png, .svg, .pdf).")] = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Read every value and check it; 2 if any is damaged.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Describe a recording: channels, curve parameters, quality, events."""
    from acquire.recording import load
    from acquire.report.summary import in_words, summarise

    if verify:
        _verify(run, as_json)
        return
    recording = load(run)
    summary = summarise(recording)
    if png is not None:
        from acquire.report.figures import overview, save

        save(overview(recording), png)
        summary["png"] = str(png)
    typer.echo(json.dumps(summary, indent=2, ensure_ascii=False) if as_json else in_words(summary))


def _verify(run: Path, as_json: bool) -> None:
    from acquire.cli.app import BAD_INPUT
    from acquire.recording import faults

    found = faults(run)
    if as_json:
        typer.echo(json.dumps({"sound": not found, "faults": found}, indent=2, ensure_ascii=False))
    else:
        typer.echo("\n".join(found) or "sound: every value matches its checksum")
    if found:
        raise typer.Exit(BAD_INPUT)


def export(
    run: Run,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File (.csv, .mat) or folder (bundle).")] = None,
    form: Annotated[str, typer.Option("--format", "-f", help="csv, mat or bundle; else by the name of OUT.")] = "",
    as_json: Json = False,
) -> None:
    """Write a recording as CSV, as a MATLAB file, or as a bundle that `acquire import` takes back whole."""
    from acquire.recording import RecordingError, load, write_bundle
    from acquire.recording.export import write_csv, write_mat

    suffixes = {".csv": "csv", ".mat": "mat", "": "bundle"}
    if not form:
        form = "csv" if out is None else suffixes.get(out.suffix.lower(), "")
    if form not in suffixes.values():
        raise RecordingError(f"cannot export as {form or (out and out.suffix)!r}; there is csv, mat and bundle")
    recording = load(run)
    name = run.resolve().name.removesuffix(".h5")
    target = out or Path(f"{name}-bundle" if form == "bundle" else f"{name}.{form}")
    if form == "csv":
        files = write_csv(recording, target)
    else:
        files = [write_mat(recording, target) if form == "mat" else write_bundle(recording, target)]
    _say(files, as_json)


def report(
    runs: Annotated[list[Path], typer.Argument(help="Recordings (.h5) or bundles' folders.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="The page; default: the recording's name.")] = None,
    title: Annotated[str, typer.Option(help="The page's heading.")] = "",
    as_json: Json = False,
) -> None:
    """Write one self-contained HTML page with figures, parameters and quality of one or several recordings."""
    from acquire.recording import load
    from acquire.report.page import write_page

    recordings = [load(run) for run in runs]
    target = out or Path(f"{runs[0].resolve().name.removesuffix('.h5') if len(runs) == 1 else 'report'}.html")
    _say([write_page(recordings, target, title)], as_json)


def import_(
    source: Annotated[
        Path,
        typer.Argument(
            help="A bundle's folder or recording.yaml, or a folder of bundles; with --map an exported table."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the recording, or its file name.")] = DEFAULT,
    column_map: Annotated[
        Path | None, typer.Option("--map", help="Column map (YAML) for curves that other software exported.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make a recording of each bundle, or recordings of a table of exported curves. One that is wrong stops all."""
    from acquire.recording import RecordingError, read_bundle, write_recording

    if column_map is not None:
        from acquire.recording.curves_import import read_curves

        recordings = read_curves(source, column_map)
    else:
        several = bundles(source) if holds_others(source) else []
        recordings = [read_bundle(bundle) for bundle in several or [source]]
        if len(recordings) > 1 and out.suffix in SUFFIXES:
            raise RecordingError(f"{out}: one file cannot hold {len(recordings)} recordings; name a folder")
    paths = [_target(out, recording, len(recordings)) for recording in recordings]
    written = [write_recording(r, path, overwrite=force) for r, path in zip(recordings, paths, strict=True)]
    warnings = strange(recordings)
    for text in warnings:
        typer.echo(text, err=True)
    _say(written, as_json, warnings=warnings)


def recover(
    journal: Annotated[Path, typer.Argument(help="The journal that a crash left, or a damaged recording (.h5).")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="The recording; default: beside the journal.")] = None,
    as_json: Json = False,
) -> None:
    """Make a recording of the journal a crash left, or of the sound parts of a damaged one.

    No file is overwritten. The journal is removed when all of it is in the verified recording; one with damaged bytes
    stays as .journal.recovered.
    """
    from acquire.recording import salvage, settle, write_recording

    if not journal.is_file():
        raise FileNotFoundError(f"{journal}: no such file")
    if journal.suffix == ".journal":
        _say([settle(journal, out)], as_json)
    else:
        _say([write_recording(salvage(journal), out or journal.with_stem(f"{journal.stem}-salvaged"))], as_json)


def ls(
    words: Annotated[
        list[str] | None, typer.Argument(help="A folder to look in, then subject=P07, site=forehead … or any text.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--folder", "-d", help="Where recordings are looked for, if not in runs.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List recordings, and journals that wait for recovery."""
    from acquire.catalogue import catalogue

    if folder is None:
        folder, words = _folder_among(words or [])
    if folder is None and not DEFAULT.is_dir():
        typer.echo("[]" if as_json else f"no recordings yet: there is no folder {DEFAULT}")
        return
    entries = catalogue(folder or DEFAULT, words or [])
    if as_json:
        typer.echo(json.dumps([_plain_entry(e) for e in entries], indent=2, ensure_ascii=False))
        return
    rows = [("start", "instrument", "protocol", "subject", "site", "rep", "status", "file"), *map(_row, entries)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    for row in rows:
        cells = [f"{cell:<{width}}" for cell, width in zip(row, [*widths, 0], strict=True)]
        typer.echo("  ".join(cells).rstrip())


def _folder_among(words: list[str]) -> tuple[Path | None, list[str]]:
    """The folder that the first of ``words`` is, if it is one, and the other words. Raises ValueError for a path that
    leads nowhere."""
    first = Path(words[0]) if words else Path()
    if words and first.is_dir():
        return first, words[1:]
    if words and (first.is_absolute() or words[0].startswith(".")):
        raise ValueError(f"there is no folder {first}")
    return None, words


def _plain_entry(entry: Entry) -> dict[str, Any]:
    """An entry of the catalogue for JSON; of an unreadable file, its problem."""
    from acquire.catalogue import FIELDS

    about = {"path": str(entry.path), "problem": entry.problem, "left_out": entry.left_out}
    return about | ({f: getattr(entry.info, f) for f in FIELDS} if entry.info else {})


def _row(entry: Entry) -> tuple[str, ...]:
    """An entry of the catalogue as cells of the table."""
    i = entry.info
    if i is None:
        return ("", "", "", "", "", "", "!", f"{entry.path}  {entry.problem}")
    status = f"{i.status}, left out" if entry.left_out else i.status
    start = i.start_time[:19].replace("T", " ")
    return (start, i.instrument, i.protocol_name, i.subject, i.site, str(i.repeat), status, str(entry.path))


def _target(out: Path, recording: Recording, count: int) -> Path:
    """``out`` itself if it names a file (numbered by repeat if there are several), else a file in it."""
    if out.suffix not in SUFFIXES:
        # The name comes from whoever made the bundle: it must not lead out of the folder.
        name = re.sub(r"[^\w.-]", "_", recording.info.id).strip(".")
        return out / f"{name or 'recording'}.h5"
    return out if count == 1 else out.with_name(f"{out.stem}-{recording.info.repeat}{out.suffix}")


def _say(paths: list[Path], as_json: bool, **more: Any) -> None:
    """Print the ``paths`` written, one a line; or a JSON object of them, and of what there is ``more`` to say."""
    written = [str(path) for path in paths]
    typer.echo(json.dumps({"files": written, **more}) if as_json else "\n".join(written))
