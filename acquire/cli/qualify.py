"""``acquire qualify``: an instrument on reference specimens, and whether it may be believed."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acquire.cli.app import DONE, NOT_PASSED
from acquire.cli.numbers import MOST_JOBS, Speed, whole

if TYPE_CHECKING:
    from acquire.cli.progress import Stop
    from acquire.engine import Progress
    from acquire.recording import Recording
    from gap.qualify.steps import Step

LONGEST = 3650
"""Days for which a qualification may hold, as in `acquire.qualifications`, which is slow to import."""
COARSE = (320, 240)
"""Pictures of a simulated camera on a bench that a qualification switches on: enough for the apex."""


def qualify(
    instrument: Annotated[str, typer.Argument(help="cutometer, aspiration or microrobot; or its name in the station.")],
    sim: Annotated[bool, typer.Option("--sim", help="A simulated instrument.")] = False,
    station: Annotated[Path | None, typer.Option(help="Station file; with --sim all in it is simulated.")] = None,
    recordings: Annotated[
        list[Path] | None, typer.Option(help="Recordings, bundles or folders that exist; nothing is measured then.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The qualification (.yaml, the page beside it), or a folder.")
    ] = None,
    known: Annotated[
        list[str] | None,
        typer.Option("--property", help="Of your reference, such as 'step-high.height=1.503±0.002 mm'; may repeat."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not wait for Enter at each step.")] = False,
    speed: Speed = 1.0,
    effect: Annotated[list[str] | None, typer.Option(help="Simulated non-ideality; may be repeated.")] = None,
    seed: Annotated[int | None, typer.Option(parser=whole(), help="Seed of simulated noise.")] = None,
    serial: Annotated[str, typer.Option(help="Serial number, where the recordings do not tell it.")] = "",
    days: Annotated[int, typer.Option(parser=whole(1, LONGEST), help="For how many days it holds.")] = 180,
    history: Annotated[
        Path | None, typer.Option(help="Folder of the history; the user's own by default, none of simulated ones.")
    ] = None,
    operator: Annotated[str, typer.Option(help="Who measures.")] = "",
    full: Annotated[bool, typer.Option("--full", help="Try more effects, and pairs (slower).")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the qualification as JSON.")] = False,
    jobs: Annotated[
        int, typer.Option(parser=whole(1, MOST_JOBS), show_default="one a core", help="Processes that share the fits.")
    ] = os.cpu_count() or 1,
) -> None:
    """Measure the standard references (about five minutes of bench time) and say whether the instrument is sound.

    Exit status 0 where it passed, 6 where it did not. Recordings that the folder has already are not measured again.
    """
    from acquire.cli.stages import Stages
    from gap.qualify.judge import qualify as judge
    from gap.qualify.page import save

    folder, file = _places(output, instrument)
    if recordings:
        runs = _recorded(instrument, recordings)
    else:
        runs = _measured(instrument, sim, station, known or [], folder, yes, speed, effect or [], seed, operator)
    with Stages(sys.stderr) as stages:
        judged = judge(runs, serial=serial, valid_days=days, full=full, jobs=jobs, tell=stages)
    simulated = sim or not runs[0].info.device
    root = history if history is not None or not simulated else None
    page = save(judged, file, keep_in_history=root is not None or not (simulated or recordings), root=root)
    q = judged.qualification
    if as_json:
        typer.echo(q.model_dump_json(by_alias=True, indent=1))
    else:
        typer.echo("\n".join(q.sentences))
        typer.echo(f"\n{f'passed, {q.validity()}' if q.passed else 'NOT PASSED'}\n{page}\n{file}")
    raise typer.Exit(DONE if q.passed else NOT_PASSED)


def _places(output: Path | None, instrument: str) -> tuple[Path, Path]:
    """The folder of the recordings and the file of the qualification."""
    output = output or Path(f"qualification-{instrument}")
    if output.suffix in (".yaml", ".yml"):
        return output.with_name(f"{output.stem}-recordings"), output
    return output / "recordings", output / "qualification.yaml"


def _recorded(instrument: str, paths: list[Path]) -> list[Recording]:
    """Recordings that exist. Raises ValueError where they are not of ``instrument``."""
    from acquire.cli.inputs import load_all

    runs = load_all(paths)
    if others := {r.info.instrument for r in runs if instrument not in (r.info.instrument, r.info.device)}:
        raise ValueError(f"these are recordings of {' and '.join(sorted(others))}, not of {instrument}")
    return runs


def _measured(
    instrument: str,
    sim: bool,
    station: Path | None,
    known: list[str],
    folder: Path,
    yes: bool,
    speed: float,
    effects: list[str],
    seed: int | None,
    operator: str,
) -> list[Recording]:
    """Recordings of the standard set, made with a person at the bench."""
    from acquire.cli.progress import Reporter, Stop
    from acquire.cli.run import bench_of
    from acquire.engine import Aborted
    from acquire.session import Session
    from gap.qualify.bench import measure
    from gap.qualify.steps import steps_of

    with Stop() as stop:
        bench = bench_of(station, sim, "", tuple(effects), seed)
        name = instrument if instrument in bench.instruments else bench.find(instrument)
        reporters: dict[str, Reporter] = {}
        with Session(bench, speed=speed, out=folder, frame_size=COARSE) as session:
            stop.ends(session)
            steps = steps_of(session.kind(name), known)

            def ask(number: int, step: Step) -> None:
                stop.check()
                typer.echo(f"step {number} of {len(steps)}, {step.name}: {step.instruction}", err=True)
                if not yes and not _mounted(stop):
                    raise Aborted("stopped by a person; the same command goes on from here")

            def watch(step: Step, progress: Progress) -> None:
                if step.name not in reporters:
                    close()  # a terminal has one bar at a time
                    reporters[step.name] = Reporter(step.name, progress.duration).__enter__()
                reporters[step.name].update(progress)

            def close() -> None:
                for reporter in reporters.values():
                    reporter.__exit__()
                reporters.clear()

            try:
                made = measure(
                    session, name, steps, folder, ask, watch, operator, lambda text: typer.echo(text, err=True)
                )
            finally:
                close()
            stop.check()  # the last recording may have been on its way to the disk
            return made


def _mounted(stop: Stop) -> bool:
    """Whether a person says that the specimen is mounted: Enter or yes. Suction begins on nothing else."""
    while True:
        typer.echo("Enter when it is mounted; q to stop, and to go on later: ", err=True, nl=False)
        try:
            answer = stop.line().lower()
        except EOFError:
            return False
        if answer in ("", "y", "yes"):
            return True
        if answer in ("q", "quit", "n", "no", "stop", "exit"):
            return False
