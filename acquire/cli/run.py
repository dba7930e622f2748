"""``acquire run``: one protocol on one instrument, from connecting to the finished recording."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acquire.cli.app import ABORTED, DEVICE, DONE, TRIPPED
from acquire.cli.numbers import Speed, whole

if TYPE_CHECKING:
    from acquire.engine import Outcome
    from acquire.station import Station


def run(
    protocol: Annotated[str, typer.Argument(help="A protocol: a YAML file or a name of the library.")],
    sim: Annotated[bool, typer.Option("--sim", help="On simulated instruments.")] = False,
    station: Annotated[Path | None, typer.Option(help="Station file; with --sim all in it is simulated.")] = None,
    instrument: Annotated[str, typer.Option(help="The station's instrument, where it has several of a kind.")] = "",
    speed: Speed = 1.0,
    subject: Annotated[str, typer.Option(help="Pseudonym of the subject, such as P07.")] = "",
    site: Annotated[str, typer.Option(help="Where on the body, such as forehead.")] = "",
    specimen: Annotated[str, typer.Option(help="skin, or a reference such as 'rigid block', 'gauge step'.")] = "skin",
    specimen_property: Annotated[
        list[str] | None, typer.Option(help="Of a reference, such as 'height=1.000±0.002 mm'; may be repeated.")
    ] = None,
    repeat: Annotated[int, typer.Option(parser=whole(1), help="Which repeat of this measurement it is, from 1.")] = 1,
    operator: Annotated[str, typer.Option(help="Who measures.")] = "",
    notes: Annotated[str, typer.Option(help="Anything worth keeping; no names.")] = "",
    consent: Annotated[str, typer.Option(help="Which consent of the subject covers the recording, such as C12.")] = "",
    experiment: Annotated[str, typer.Option(help="Id of the experiment (`acquire gap next`) that it answers.")] = "",
    effect: Annotated[
        list[str] | None, typer.Option(help="Simulated non-ideality, such as regulator_lag:tau=0.3s; may be repeated.")
    ] = None,
    tissue: Annotated[str, typer.Option(help="Simulated tissue, such as forearm.")] = "",
    seed: Annotated[int | None, typer.Option(parser=whole(), help="Seed of simulated noise.")] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the recording, or its file name (.h5).")] = Path(
        "runs"
    ),
    notify: Annotated[
        list[str] | None,
        typer.Option(help="On end, trip and stall: a command line, a URL, or 'station' for its own; may be repeated."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Run a protocol and record it. Ctrl-C vents, keeps the recording and ends with status 5."""
    from acquire.cli.progress import Reporter, Stop

    with Stop() as stop:
        from acquire.notify import hooks
        from acquire.qualifications import due, serial_of
        from acquire.session import Request, Session
        from protocols.specimens import assignments, stated

        bench = bench_of(station, sim, tissue, tuple(effect or ()), seed)
        known = stated(specimen, assignments(specimen_property or []))
        request = Request(
            subject, site, operator, repeat, specimen, notes, consent, specimen_properties=known, experiment=experiment
        )
        with Session(bench, speed=speed, out=out, notify=hooks(notify or (), bench.notify)) as session:
            stop.ends(session)
            engine, plan = session.prepare(protocol, request, name=instrument, out=out)
            if engine.found:
                _say(f"acquire: {engine.found}", err=True)
            if warning := due(plan.info.instrument, serial_of(plan.info)):
                _say(f"acquire: {warning}", err=True)
            with Reporter(plan.info.protocol_name, plan.setpoints.duration) as reporter:
                outcome = session.carry_out(engine, plan, reporter.update)
                reporter.update(engine.progress)
        _tell(outcome, plan.info.id, plan.info.instrument, plan.setpoints.duration, as_json)
    raise typer.Exit(_status(outcome))


def bench_of(path: Path | None, sim: bool, tissue: str, effects: tuple[str, ...], seed: int | None) -> Station:
    """The bench to run on. Raises ValueError where the options do not say which, or contradict each other."""
    from acquire.station import Simulation, load_station, simulated_station

    asked: dict[str, Any] = {"effects": effects} if effects else {}
    asked |= {"tissue": tissue} if tissue else {}
    asked |= {"seed": seed} if seed is not None else {}
    if path is None:
        if not sim:
            raise ValueError("say --sim for simulated instruments, or --station FILE for those of a bench")
        return simulated_station(**asked)
    bench = load_station(path)
    if asked and not sim and not any(entry.here for entry in bench.instruments.values()):
        raise ValueError(f"{path}: no instrument is simulated; --{'/--'.join(asked)} need one")
    instruments = {}
    for name, entry in bench.instruments.items():
        if sim or entry.here:
            simulation = (entry.simulated or Simulation()).model_copy(update=asked)
            entry = entry.model_copy(update={"address": "", "sources": {}, "options": {}, "simulated": simulation})
        instruments[name] = entry
    return bench.model_copy(update={"instruments": instruments})


def _tell(outcome: Outcome, identity: str, instrument: str, duration: float, as_json: bool) -> None:
    if as_json:
        result = {
            "id": identity,
            "instrument": instrument,
            "status": str(outcome.status),
            "reason": outcome.reason,
            "recording": str(outcome.recording) if outcome.recording else None,
            "journal": str(outcome.journal) if outcome.journal else None,
            "duration": duration,
            "lost_samples": outcome.lost,
            "safe": outcome.safe,
        }
        _say(json.dumps(result, indent=2))
        return
    if outcome.recording is not None:
        _say(outcome.recording)
    if outcome.reason:
        told = outcome.reason.startswith(outcome.status)
        _say(outcome.reason if told else f"{outcome.status}: {outcome.reason}", err=True)
    if outcome.lost:
        _say(f"{outcome.lost} samples were lost", err=True)
    if outcome.recording is None and outcome.journal is not None:
        _say(f"no recording; try: acquire recover {outcome.journal}", err=True)
    elif outcome.recording is None:
        _say("no recording, and no journal: the data of this run are lost", err=True)


def _say(text: object, *, err: bool = False) -> None:
    """Say it, whether anybody reads it or not: the exit status is that of the run."""
    try:
        typer.echo(text, err=err)
    except OSError:
        if not err:  # a text that could not be written must not be tried again when the interpreter ends
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - stays until then


def _status(outcome: Outcome) -> int:
    from acquire.engine import State

    return {State.COMPLETED: DONE, State.ABORTED: ABORTED, State.TRIPPED: TRIPPED}.get(outcome.status, DEVICE)
