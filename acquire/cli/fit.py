"""``acquire fit``: identify a model's parameters from recordings, by a solver plugin (``acquire.solvers``)."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core

from acquire.cli.fit_list import list_models
from acquire.cli.fit_plan import plan
from acquire.cli.numbers import MOST_JOBS, whole
from acquire.cli.review import ALL, counting
from acquire.cli.solver import solver_for
from acquire.cli.told import of_bundles


class _RunsOrPlan(typer.core.TyperGroup):
    """`acquire fit RUN...` beside `acquire fit plan`: words that name no command are the fit's own."""

    def parse_args(self, context: Any, arguments: list[str]) -> list[str]:
        return super().parse_args(context, arguments if arguments[:1] == ["plan"] else ["runs", *arguments])


app = typer.Typer(
    cls=_RunsOrPlan, help="Identify a model's parameters; `fit plan`: the measurement that narrows them most."
)
app.command("plan")(plan)

LINES = 5.0  # s between two lines of progress where there is no terminal


@app.command("runs")
def fit(
    runs: Annotated[
        list[Path] | None, typer.Argument(help="Recordings (.h5) or bundles' folders, fitted together.")
    ] = None,
    model: Annotated[str, typer.Option(help="Forward model, or file.py:NAME; with --list all are named.")] = "",
    spec: Annotated[
        Path | None, typer.Option(help="Free parameters, bounds, starts, weights, optimiser (YAML).")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for fit.json and fit.html.")] = None,
    jobs: Annotated[int, typer.Option(parser=whole(1, MOST_JOBS), help="Processes that share the work.")] = 1,
    cluster: Annotated[
        str, typer.Option(help="Scheduler of a dask.distributed cluster, such as tcp://host:8786.")
    ] = "",
    fields: Annotated[
        Path | None, typer.Option(help="Folder for displacement, stress, stretch and history (VTU, XDMF) of the fit.")
    ] = None,
    times: Annotated[
        str, typer.Option(help="When --fields are wanted, such as '0.5,5,60': seconds from the first sample.")
    ] = "",
    posterior: Annotated[
        bool,
        typer.Option("--posterior", help="Draw from the parameters' posterior, by the priors of --spec."),
    ] = False,
    compare: Annotated[
        str,
        typer.Option(help="Further models, with commas between: by evidence, the law that the recordings speak for."),
    ] = "",
    everything: Annotated[bool, typer.Option("--all", help=ALL)] = False,
    listed: Annotated[bool, typer.Option("--list", help="List the models and their parameters.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result on stdout.")] = False,
) -> None:
    """Identify a model's parameters from recordings, and say how well they are known."""
    solver = solver_for(model)
    if listed:
        list_models(solver, model, as_json)
        return
    if not runs:
        raise ValueError("a fit needs at least one recording")
    if not (model or spec):
        raise ValueError(f"a fit needs --model or --spec; models are {', '.join(solver.models())}")
    moments = _times(times)
    recordings = counting(_read(runs), everything=everything)
    if compare:
        if not model or spec:
            raise ValueError("--compare goes with --model, and without --spec")
        _compare(solver, recordings, [model, *(law.strip() for law in compare.split(","))], jobs, output, as_json)
        return
    try:
        with _Bar() as bar:
            options = {"posterior": True} if posterior else {}  # solvers that draw none need not know the word
            result = solver.fit(
                recordings, spec, model=model, jobs=jobs, cluster=cluster, progress=bar.update, **options
            )
            written = result.write_fields(fields, moments) if fields else []
    except ImportError as error:  # an extra of the solver: its message says which
        raise ValueError(str(error)) from error
    _tell(result, output or (None if as_json else Path("fit-report")), as_json)
    if written and not as_json:
        typer.echo(f"{fields}: {len(written)} files of fields, to be opened by their .pvd or .xdmf")


def _read(runs: list[Path]) -> list[Any]:
    """The recordings, with an import's remarks on bundles among them printed on standard error."""
    from acquire.recording import load

    recordings = [load(run) for run in runs]
    for line in of_bundles(runs, recordings):
        print(line, file=sys.stderr)
    return recordings


def _tell(result: Any, folder: Path | None, as_json: bool) -> None:
    """Print a fit's result, and write its JSON and page into the folder, where there is one."""
    from acquire.files import whole_file, write_text

    text = json.dumps(result.as_dict(), indent=1)
    if folder:
        write_text(folder / "fit.json", text + "\n")
        with whole_file(folder / "fit.html") as page:
            result.write_page(Path(page.name))
    typer.echo(text if as_json else f"{result.in_words()}\n\n{folder}/fit.html\n{folder}/fit.json")


def _compare(
    solver: Any, recordings: list[Any], laws: list[str], jobs: int, output: Path | None, as_json: bool
) -> None:
    """Fit and integrate every law; a table, and compare.json in the folder."""
    from acquire.files import write_text

    if unknown := [law for law in laws if law not in solver.models()]:
        raise ValueError(f"no model {unknown[0]!r}; there are {', '.join(solver.models())}")
    try:
        with _Bar() as bar:
            found = solver.compare(recordings, laws, jobs=jobs, progress=bar.update)
    except ImportError as error:
        raise ValueError(str(error)) from error
    text = json.dumps(found.as_dict(), indent=1)
    if output or not as_json:
        write_text((output or Path("fit-report")) / "compare.json", text + "\n")
    typer.echo(text if as_json else found.in_words())


def _times(text: str) -> tuple[float, ...]:
    """Seconds from a list with commas."""
    try:
        return tuple(float(part.strip().removesuffix("s")) for part in text.split(",") if part.strip())
    except ValueError:
        raise ValueError(f"--times {text!r}: expected seconds with commas between them, such as 0.5,5,60") from None


class _Bar:
    """Progress of a fit: a bar on a terminal, a line now and then elsewhere; on stderr."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._task: Any = None
        self._told = time.monotonic()

    def __enter__(self) -> _Bar:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

            columns = (TextColumn("fit {task.description}"), BarColumn(), TimeElapsedColumn())
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bar.start()
            self._task = self._bar.add_task("", total=None)
        return self

    def __exit__(self, *exc: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def update(self, progress: Any) -> None:
        """Show a solver's report: ``what``, ``evaluations``, ``forward_runs``, ``relative_objective``."""
        words = f"{progress.what}: {progress.evaluations} evaluations, {progress.forward_runs} runs of the model"
        if progress.relative_objective == progress.relative_objective:  # not nan
            words += f", misfit {100 * progress.relative_objective:.3g} % of the start's"
        if self._bar is not None:
            self._bar.update(self._task, description=words)
        elif time.monotonic() - self._told >= LINES:
            self._told = time.monotonic()
            print(f"fit {words}", file=sys.stderr, flush=True)
