"""``acquire gap blind``: check the diagnosis on cases whose effect is withheld."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from acquire.cli.numbers import MOST_JOBS, whole

blind = typer.Typer(no_args_is_help=True, help="Check the diagnosis on cases whose effect is withheld.")


@blind.command("make")
def blind_make(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the cases.")],
    tier: Annotated[str, typer.Option(help="T0 … T6.")] = "T3",
    n: Annotated[int, typer.Option("--n", "-n", parser=whole(1), help="How many cases.")] = 20,
    seed: Annotated[int, typer.Option(parser=whole(), help="Seed of the set.")] = 1,
    instrument: Annotated[list[str] | None, typer.Option(help="Only these instruments (may be repeated).")] = None,
    passphrase: Annotated[str, typer.Option(help="Passphrase of the key.")] = "",
    style: Annotated[str, typer.Option(help="wide: laboratories as they differ; dense: the nominal one.")] = "wide",
    references: Annotated[
        str, typer.Option(help="Reference recordings: some (in two of five cases), none, or the standard set.")
    ] = "some",
) -> None:
    """Write cases whose names, metadata and order say nothing, and their key apart, encrypted."""
    from gap.blind import make
    from gap.blind.vocabulary import INSTRUMENTS

    chosen = instrument or INSTRUMENTS
    if tier == "T0":
        from gap.design.simulated_cases import make_own

        key = make_own(n, seed, output, passphrase, chosen)
    else:
        key = make(tier, n, seed, output, chosen, passphrase, style=style, references=references)
    print(f"{output}\n{key}")


@blind.command("answer")
def blind_answer(
    case: Annotated[Path, typer.Argument(help="A case of `blind make`; its key must be beside the set.")],
    experiment: Annotated[Path, typer.Argument(help="Folder of `gap next`.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="New folder for the recording (a bundle).")],
    passphrase: Annotated[str, typer.Option(help="Passphrase of the key.")] = "",
) -> None:
    """Do an experiment on the case's hidden rig. A protocol that the rig cannot do is refused."""
    from gap.blind import perform

    print(perform(case, experiment, output, passphrase))


@blind.command("loop")
def blind_loop(
    cases: Annotated[Path, typer.Argument(help="Folder made by `blind make`; its key must be beside it.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the reports after 0, 1, 2 … experiments.")],
    policy: Annotated[str, typer.Option(help="Who chooses: ours, random or fixed.")] = "ours",
    most: Annotated[int, typer.Option(parser=whole(1, 20), help="Experiments of a case at most.")] = 3,
    seed: Annotated[int, typer.Option(parser=whole(), help="Seed of all drawn numbers.")] = 1,
    passphrase: Annotated[str, typer.Option(help="Passphrase of the key.")] = "",
    jobs: Annotated[int, typer.Option(parser=whole(1, MOST_JOBS), help="Processes that share a case's fits.")] = 1,
    quick: Annotated[
        bool, typer.Option("--quick", help="Quick diagnoses: few effects are fitted, and no pairs.")
    ] = False,
) -> None:
    """Run the loop on every case's hidden rig; print how often the answer is right after 0, 1, 2 … experiments."""
    from gap.loop.blind import as_text, loop_cases

    print(as_text(loop_cases(cases, output, policy, most, seed, passphrase, jobs, quick)))


@blind.command("diagnose")
def blind_diagnose(
    cases: Annotated[Path, typer.Argument(help="Folder made by `blind make`.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the reports.")],
    jobs: Annotated[int, typer.Option(parser=whole(1, MOST_JOBS), help="Processes.")] = 1,
) -> None:
    """Diagnose every case of a set into one report each."""
    from gap.batch import diagnose_cases

    diagnose_cases(cases, output, jobs)


@blind.command("score")
def blind_score(
    reports: Annotated[Path, typer.Argument(help="Folder of reports.")],
    keys: Annotated[list[Path], typer.Argument(help="The key file, or those of several sets (tiers) together.")],
    passphrase: Annotated[str, typer.Option(help="Passphrase of the key.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Compare reports with the key: every figure beside its target."""
    from gap.blind import score

    card = score(reports, keys, passphrase)
    print(json.dumps(card.as_json(), indent=1) if as_json else card.as_text())
