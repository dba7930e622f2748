"""``acquire gap loop``: the closed loop on a simulated rig, to its end."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from acquire.cli.check import limits_of
from acquire.cli.numbers import MOST_JOBS, whole


def loop(
    instrument: Annotated[str, typer.Argument(help="cutometer, aspiration or microrobot.")] = "cutometer",
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for reports, experiments and the page.")
    ] = Path("gap-loop"),
    effect: Annotated[
        list[str] | None,
        typer.Option(help="Hidden effect, such as leak:shortfall=0.08; default: drawn. 'none': nothing."),
    ] = None,
    policy: Annotated[str, typer.Option(help="Who chooses: ours, random or fixed.")] = "ours",
    most: Annotated[int, typer.Option(parser=whole(1, 20), help="Experiments at most.")] = 3,
    station: Annotated[Path | None, typer.Option(help="Stay within this station's limits.")] = None,
    specimen: Annotated[list[str] | None, typer.Option(help="Only these specimens (may be repeated).")] = None,
    seed: Annotated[int, typer.Option(parser=whole(), help="Seed of person, noise and hidden effect.")] = 1,
    quick: Annotated[
        bool, typer.Option("--quick", help="Quick diagnoses: few effects are fitted, and no pairs.")
    ] = False,
    jobs: Annotated[
        int,
        typer.Option(parser=whole(1, MOST_JOBS), show_default="one a core", help="Processes that share the fits."),
    ] = os.cpu_count() or 1,
) -> None:
    """Diagnose a simulated rig with a hidden effect, let it answer the next experiment, and go on to the end."""
    from gap.loop.page import write_page
    from gap.loop.policies import policy_of
    from gap.loop.rigs import SimulatedRig, drawn, hidden_in_words, named
    from gap.loop.run import as_text, run

    limits = limits_of(instrument, station)
    chooser = policy_of(policy)
    acting = drawn(instrument, seed) if effect is None else named(effect, instrument)
    rig = SimulatedRig(instrument, acting, seed)
    words = hidden_in_words(acting)
    steps = run(
        rig, chooser(seed, specimen or ()), limits, output, most, quick, jobs, lambda text: print(text, file=sys.stderr)
    )
    page = write_page(steps, output / "loop.html", words)
    print(f"{as_text(steps)}\n\nhidden: {words}\n{page}")
