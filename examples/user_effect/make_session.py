"""A simulated session with the effect of ``pump_warm_up.py`` hidden in it, as bundles to try the diagnosis on.

python examples/user_effect/make_session.py -o out/warm_up
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from acquire.recording import Recording, write_bundle
from gap.design import simulated as own
from gap.effects.load import library

EFFECT = Path(__file__).parent / "pump_warm_up.py"


def session(shortfall: float = 0.08, warming: float = 40.0, seed: int = 1) -> list[Recording]:
    """Two levels, one of them repeated, and a triangle, on a Cutometer whose pump was cold."""
    cold_pump = library("cutometer", [EFFECT])["pump_warm_up"]
    legs = [
        own.step_hold(-40e3, 10.0, 5.0),
        replace(own.step_hold(-40e3, 10.0, 5.0), repeat=2),
        own.step_hold(-20e3, 10.0, 5.0),
        own.triangle(-40e3, 8.0, 1, 5.0),
    ]
    values = {"shortfall": shortfall, "warming": warming}
    return own.suction_session("cutometer", np.random.default_rng(seed), [(cold_pump, values)], legs=legs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/warm_up"), help="folder for the bundles")
    output = parser.parse_args().output
    for k, recording in enumerate(session()):
        print(write_bundle(recording, output / f"r{k + 1:02d}"))


if __name__ == "__main__":
    main()
