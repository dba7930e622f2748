"""``acquire gap``: diagnose recordings, list effects, plan, and the blind check."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acquire.cli.gap_blind import blind
from acquire.cli.gap_loop import loop
from acquire.cli.gap_next import advice, next_experiment
from acquire.cli.gap_selfcheck import cited, selfcheck
from acquire.cli.inputs import found, load_all
from acquire.cli.numbers import MOST_JOBS, whole
from acquire.cli.review import ALL, counting

if TYPE_CHECKING:
    from acquire.recording import Recording
    from gap import Diagnosis
    from gap.design.answers import Answer
    from gap.rig.generic import GenericEffect
    from sim_devices.chain import Effect

app = typer.Typer(
    no_args_is_help=True, help="Why simulation and measurement differ: where, which effect, how far it shrinks."
)
app.add_typer(blind, name="blind")
app.command("next")(next_experiment)
app.command("loop")(loop)
app.command("selfcheck")(selfcheck)


@app.command()
def diagnose(
    runs: Annotated[list[Path], typer.Argument(help="Recordings, bundles, or folders of them (one session).")],
    model: Annotated[str, typer.Option(help="Forward model of any other rig, as file.py:Name.")] = "",
    effects: Annotated[list[Path] | None, typer.Option(help="Python file(s) with further effects.")] = None,
    solver: Annotated[str, typer.Option(help="Finite-element model of the solver plugin to use as tissue.")] = "",
    experiment: Annotated[
        list[Path] | None, typer.Option(help="Folder(s) of `gap next` whose answers are among the recordings.")
    ] = None,
    self_check: Annotated[
        Path | None,
        typer.Option("--selfcheck", help="JSON of `gap selfcheck` on this session, for the report to cite."),
    ] = None,
    earlier: Annotated[
        list[Path] | None,
        typer.Option(help="Earlier session(s) of the same subject and site (suction), as prior of the skin's law."),
    ] = None,
    term: Annotated[
        Path | None,
        typer.Option(help="Where no effect fits: save the proposed term here, as a file for --effects."),
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for gap.json and gap.html.")] = None,
    everything: Annotated[bool, typer.Option("--all", help=ALL)] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report on stdout.")] = False,
    advise: Annotated[bool, typer.Option("--advise", help="Also say which experiment is worth most.")] = False,
    qualification: Annotated[
        Path | None, typer.Option(help="Qualification of this instrument (acquire qualify), as a prior.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A first look: few effects are fitted, and no pairs.")] = False,
    nominal: Annotated[
        bool, typer.Option("--nominal", help="Fit the simulation alone, without effects: its parameters and its gap.")
    ] = False,
    jobs: Annotated[
        int,
        typer.Option(parser=whole(1, MOST_JOBS), show_default="one a core", help="Processes that share the fits."),
    ] = os.cpu_count() or 1,
) -> None:
    """Say where simulation and measurement differ, which effect causes it, and how far it shrinks with it."""
    from acquire.cli.stages import Stages
    from acquire.files import write_text
    from gap import diagnose as run
    from gap import load_model, write_page

    files, recordings, answers = _session(runs, experiment, everything)
    forward = load_model(model) if model else None
    print(f"diagnosing {len(recordings)} recordings of {recordings[0].info.instrument}", file=sys.stderr)
    with Stages(sys.stderr) as stages:
        diagnosis = run(
            recordings,
            forward,
            user_effects=effects or (),
            solver=solver,
            quick=quick,
            jobs=jobs,
            tell=stages,
            qualification=qualification,
            earlier=[load_all([session]) for session in earlier or ()],
            nominal=nominal,
        )
    report = _report(diagnosis, files, answers, self_check)
    if advise and forward is None:
        report |= advice(report, recordings)
    folder = output or (None if as_json else Path("gap-report"))
    if folder:
        write_text(folder / "gap.json", json.dumps(report, indent=1) + "\n")
        write_page(diagnosis, folder / "gap.html")
    if term:
        report["remarks"] += [_saved(diagnosis, term)]
    if as_json:
        print(json.dumps(report, indent=1))
    else:
        _print_report(report)
        print(f"\n{diagnosis.seconds:.0f} s\n{folder}/gap.html\n{folder}/gap.json")


def _session(
    runs: Sequence[Path], experiments: Sequence[Path] | None, everything: bool
) -> tuple[list[Path], list[Recording], list[Answer]]:
    """The files of a session, its recordings to diagnose, and the answers to experiments among them.

    Raises ValueError where nothing is left to diagnose.
    """
    from gap.design.answers import asked_for, believed

    files = found(runs)
    recordings, answers = believed(counting(load_all(runs), everything=everything), asked_for(experiments or (), files))
    if not recordings:
        raise ValueError(f"nothing is left to diagnose: {answers[0].text}")
    return files, recordings, answers


def _report(
    diagnosis: Diagnosis, files: Sequence[Path], answers: Sequence[Answer], self_check: Path | None
) -> dict[str, Any]:
    """The report of a diagnosis, with its files, its experiments, and a self-check where one is given."""
    from gap import as_json

    report = as_json(diagnosis) | {"recording_files": [str(p.resolve()) for p in files]}
    if self_check:
        report["selfcheck"] = cited(self_check, report["recordings"], report["causes"])
        report["sentences"] += [report["selfcheck"]["text"]]
    report["experiments"] = [a.as_dict() for a in answers]
    report["remarks"] += [a.text for a in answers if a.fault]
    return report


def _print_report(report: Mapping[str, Any]) -> None:
    """The sentences of a report on stdout, the simulation's parameters where there is nothing else; its remarks on
    stderr."""
    print(*report["sentences"], sep="\n")
    if not report["causes"]:
        _print_parameters(report["model"])
    notes = list(report["remarks"])
    if report["earlier"]:
        notes.append(f"earlier sessions: {report['earlier']['text']}")
    if report["next_experiment_note"]:
        notes.append(f"next experiment: {report['next_experiment_note']}")
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def _print_parameters(model: Mapping[str, Mapping[str, Any]]) -> None:
    """Print the fitted parameters of a simulation with their standard errors, as the page has them."""
    from rich import box
    from rich.console import Console
    from rich.table import Column, Table

    from gap.data.quantities import quantity

    table = Table("parameter", Column("value", justify="right"), box=box.SIMPLE)
    for name, entry in model.items():
        table.add_row(name.replace("_", " "), quantity(entry["value"], entry["unit"], entry["se"], name))
    Console().print(table)


def _saved(diagnosis: Diagnosis, path: Path) -> str:
    """Save the proposed term of a diagnosis as a user's effect, if there is one; the result tells it in words."""
    from gap.terms.term import save_term

    proposal = diagnosis.term
    if proposal is None:
        return f"no term to save in {path}: a term is looked for where the verdict is unknown, on suction and rigs"
    if proposal.term is None or not proposal.helps:
        return f"no term to save in {path}: {proposal.reason}"
    first = diagnosis.recordings[0].info
    save_term(proposal.term, path, first.instrument, f"Proposed for recordings {first.id} and those of its session.")
    return f"the proposed term is in {path}: try it with --effects {path}"


@app.command()
def effects(
    instrument: Annotated[
        str,
        typer.Argument(help="cutometer, aspiration, microrobot, or rig for a --model's; all instruments by default."),
    ] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """List the effects that the diagnosis knows."""
    if instrument == "rig":
        from gap.rig.catalogue import GENERIC

        columns = {"name": "effect", "form": "form", "needs": "needs at its tap", "meaning": "meaning"}
        _print_effects(GENERIC, ("name", "form", "needs", "meaning", "remedy"), columns, as_json)
    else:
        from sim_devices.effects import effects as library
        from sim_devices.stages import INSTRUMENTS

        if instrument and instrument not in INSTRUMENTS:
            raise ValueError(f"no instrument {instrument!r}; there are {', '.join(INSTRUMENTS)}, and rig")
        columns = {"name": "effect", "stage": "stage", "instruments": "instruments", "meaning": "meaning"}
        attributes = ("name", "stage", "instruments", "meaning", "remedy", "source")
        _print_effects(library(instrument or None).values(), attributes, columns, as_json)


def _print_effects(
    effects: Iterable[Effect | GenericEffect], attributes: Sequence[str], columns: Mapping[str, str], as_json: bool
) -> None:
    """Print attributes and parameters of effects as JSON, or some attributes (those of ``columns``: their headings)
    as a table."""
    if as_json:
        fields = ("name", "unit", "low", "high", "default")
        rows = [
            {name: getattr(e, name) for name in attributes}
            | {"parameters": [{field: getattr(p, field) for field in fields} for p in e.parameters]}
            for e in effects
        ]
        print(json.dumps(rows, indent=1))
        return
    from rich.console import Console
    from rich.table import Column, Table

    name, *others = columns.values()
    table = Table(Column(name, no_wrap=True), *others, "parameters")  # a name that is cut cannot be asked for
    for e in effects:
        cells = (v if isinstance(v, str) else ", ".join(v) for v in (getattr(e, name) for name in columns))
        table.add_row(*cells, "\n".join(f"{p.name} {p.low:.3g}…{p.high:.3g} {p.unit}" for p in e.parameters))
    Console().print(table)


@app.command()
def plan(
    protocols: Annotated[list[str], typer.Argument(help="Protocol files or library names, measured together.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Before measuring: which effects this protocol could never tell apart, and how weak an effect it would show."""
    from gap.design.plan import plan as make_plan

    result = make_plan(protocols)
    print(json.dumps(result.as_json(), indent=1) if as_json else result.as_text())
