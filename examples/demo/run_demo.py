"""Three simulated instruments measure skin; a fault is hidden in one of them, and found; another takes one more
measurement.

    python examples/demo/run_demo.py -o out/demo

Nothing here but the commands a person would type: each is printed before it runs. The instruments are simulated and
run faster than real time, but the drivers speak real bytes to them. Ends with status 1 if a diagnosis does not name
the hidden effect.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
ACQUIRE = Path(sys.executable).with_name("acquire")
INSTRUMENTS = {"cutometer": 20, "aspiration": 5, "microrobot": 5}  # simulated seconds per second
SESSION = (("hold-150", 1), ("hold-300", 1), ("hold-450", 1), ("hold-450", 2), ("triangle", 1))
"""Protocols of the session that the effect hides in, and which repeat each is."""
FADING = "illumination_drift"
"""Light that fades, which on skin looks as if the muscle below grew tense."""


def acquire(*arguments: object) -> None:
    """Print and run one `acquire` command. Raises SystemExit with its status if it fails."""
    words = [str(a) for a in arguments]
    print(f"\n$ acquire {shlex.join(words)}", flush=True)
    status = subprocess.run([ACQUIRE, *words], check=False).returncode
    if status:
        raise SystemExit(status)


def fresh(path: Path) -> Path:
    """``path``, without the files of an earlier demo: a run never overwrites a recording."""
    path.unlink(missing_ok=True)
    return path


def measure(out: Path) -> Path:
    """Run the demo protocol of every instrument; one page of all recordings. Returns the page."""
    recordings = []
    for instrument, speed in INSTRUMENTS.items():
        recordings.append(fresh(out / f"{instrument}.h5"))
        person = ("--subject", "P01", "--site", "forearm")
        acquire("run", f"demo-{instrument}", "--sim", "--speed", speed, *person, "--seed", 1, "-o", recordings[-1])
    page = out / "summary.html"
    acquire("report", *recordings, "-o", page)
    return page


def hide_and_find(out: Path, effect: str) -> Path:
    """Record a session with ``effect`` switched on, then diagnose it. Returns the folder of the diagnosis."""
    session = out / "session"
    for k, (protocol, repeat) in enumerate(SESSION):
        what = ("run", HERE / f"{protocol}.yaml", "--sim", "--speed", 20, "--effect", effect)
        recording = fresh(session / f"{k + 1}-{protocol}.h5")
        acquire(*what, "--seed", k, "--repeat", repeat, "-o", recording)
    acquire("gap", "diagnose", session, "-o", out / "gap")
    return out / "gap"


def ask_and_split(out: Path) -> Path:
    """Hide an effect that skin alone cannot tell from one of the person's; let one experiment split them. Returns the
    page. Raises SystemExit where it does not."""
    folder = out / "loop"
    if folder.exists():
        shutil.rmtree(folder)
    hidden, at_hand = ("--effect", f"{FADING}:change=0.5"), ("--specimen", "gauge step", "--specimen", "rigid block")
    acquire("gap", "loop", "cutometer", *hidden, *at_hand, "--quick", "--most", 1, "-o", folder)
    before, after = (json.loads((folder / f"report-{k}.json").read_text())["causes"][0]["class"] for k in (0, 1))
    print(f"\nbefore the experiment: {' or '.join(before)}\nafter it:              {' or '.join(after)}")
    if not (len(before) > 1 and FADING in before and after == [FADING]):
        raise SystemExit("the experiment did not split the class")
    return folder / "loop.html"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/demo"), help="folder for everything")
    parser.add_argument("--effect", default="leak:shortfall=8 percent", help="effect to hide (acquire gap effects)")
    arguments = parser.parse_args()
    out: Path = arguments.output
    out.mkdir(parents=True, exist_ok=True)
    page = measure(out)
    gap = hide_and_find(out, arguments.effect)

    hidden = arguments.effect.partition(":")[0]
    causes = json.loads((gap / "gap.json").read_text())["causes"]
    named = causes[0]["class"] if causes else []
    print(f"\nhidden: {arguments.effect}\nfound:  {', '.join(named) or 'nothing'}")
    if hidden not in named:
        raise SystemExit(f"the diagnosis did not name {hidden}")
    loop = ask_and_split(out)
    print(f"\nrecordings  {out}/*.h5 and {out}/session/*.h5\nsummary     {page}\ndiagnosis   {gap / 'gap.html'}")
    print(f"loop        {loop}")


if __name__ == "__main__":
    main()
