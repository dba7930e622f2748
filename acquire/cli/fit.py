"""``acquire fit``: identify a model's parameters from recordings, by a solver plugin (``acquire.solvers``)."""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core

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

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MULTIPLES = {
    "Pa": (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3), ("Pa", 1.0)),
    "m": (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)),
    "s": (("s", 1.0), ("ms", 1e-3)),
    "N": (("N", 1.0), ("mN", 1e-3)),
}
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
    list_models: Annotated[bool, typer.Option("--list", help="List the models and their parameters.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result on stdout.")] = False,
) -> None:
    """Identify a model's parameters from recordings, and say how well they are known."""
    solver = solver_for(model)
    if list_models:
        _list(solver, model, as_json)
        return
    from acquire.files import whole_file, write_text
    from acquire.recording import load

    if not runs:
        raise ValueError("a fit needs at least one recording")
    if not (model or spec):
        raise ValueError(f"a fit needs --model or --spec; models are {', '.join(solver.models())}")
    moments = _times(times)
    read = [load(run) for run in runs]
    for line in of_bundles(runs, read):
        print(line, file=sys.stderr)
    recordings = counting(read, everything=everything)
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
    folder = output or (None if as_json else Path("fit-report"))
    data = result.as_dict()
    if folder:
        write_text(folder / "fit.json", json.dumps(data, indent=1) + "\n")
        with whole_file(folder / "fit.html") as page:
            result.write_page(Path(page.name))
    if as_json:
        typer.echo(json.dumps(data, indent=1))
    else:
        typer.echo(f"{result.in_words()}\n\n{folder}/fit.html\n{folder}/fit.json")
        if written:
            typer.echo(f"{fields}: {len(written)} files of fields, to be opened by their .pvd or .xdmf")


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


def _list(solver: Any, model: str, as_json: bool) -> None:
    models = solver.models()
    if model and model not in models:
        raise ValueError(f"no model {model!r}; there are {', '.join(models)}")
    chosen = {}
    for name in [model] if model else models:
        try:
            chosen[name] = models[name].info
        except ValueError as error:  # one that somebody brought: the others are listed all the same
            if model:
                raise
            print(f"acquire fit: {error}", file=sys.stderr)
    if as_json:
        rows = [
            {
                "name": info.name, "problem": info.problem, "description": info.description, "source": info.source,
                "channels": list(info.channels), "parameters": [p.__dict__ for p in info.parameters],
            }
            for info in chosen.values()
        ]  # fmt: skip
        typer.echo(json.dumps(rows, indent=1))
        return
    for info in chosen.values():
        typer.echo(f"{info.name}: {info.description}")
        if model:
            for line in _table([_row(p) for p in info.parameters]):
                typer.echo(line)


def _row(parameter: Any) -> tuple[str, ...]:
    """Symbol, default, bounds of a fit and meaning; the least of all where a fit stops above it."""
    unit = parameter.unit
    stops = getattr(parameter, "fit_lower", None)
    lowest = f"; down to {_number(parameter.lower, unit)} if asked" if stops is not None else ""
    lower = _number(parameter.lower if stops is None else stops, unit)
    bounds = f"{lower} … {_number(parameter.upper, unit)}"
    return parameter.symbol, _number(parameter.default, unit), bounds, f"{parameter.meaning}{lowest}"


def _number(value: float, unit: str) -> str:
    """A value with its unit, as fits show it: 20 kPa, 2 mm, 10⁻⁸ Hz."""
    if value == 0.0:
        return f"0 {unit}".rstrip()
    for name, factor in MULTIPLES.get(unit, ()):
        if factor <= abs(value) < 99999.5 * factor:
            return f"{value / factor:.5g} {name}"
    if 1e-3 <= abs(value) < 99999.5:
        return f"{value:.5g} {unit}".rstrip()
    power = math.floor(math.log10(abs(value)))
    digits = f"{value / 10.0**power:.5g}"
    if digits in ("10", "-10"):
        digits, power = digits[:-1], power + 1
    ten = f"10{str(power).translate(RAISED)}"
    mantissa = {"1": "", "-1": "-"}.get(digits, f"{digits}·")
    return f"{mantissa}{ten} {unit}".rstrip()


def _table(rows: list[tuple[str, ...]]) -> list[str]:
    """Rows in columns: the second to the right, the last as it is."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]) - 1)]
    return [
        f"  {symbol:<{widths[0]}}  {default:>{widths[1]}}  {bounds:<{widths[2]}}  {meaning}".rstrip()
        for symbol, default, bounds, meaning in rows
    ]


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
