"""Turn the cascaded tanks benchmark into bundles: its table as it is, and a few lines that say what the columns are.

    python examples/cascaded_tanks/make_bundle.py -o out/tanks
    acquire import out/tanks/estimation -o out/tanks/estimation.h5

A rig that is not ours names its own channels. docs/data.md says where the table can be had.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import yaml

from acquire import datasets

TABLE = "dataBenchmark.csv"
PARTS = {"estimation": "Est", "validation": "Val"}


def make_bundle(name: str, folder: Path, data: Path | None = None) -> Path:
    """Write the bundle ``estimation`` or ``validation`` into ``folder`` and return it; ``data`` holds the table."""
    table = (data or datasets.folder("cascaded_tanks")) / TABLE
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(table, folder / TABLE)

    def column(letter: str) -> dict[str, object]:
        return {"file": TABLE, "column": f"{letter}{PARTS[name]}", "unit": "V", "time": {"rate": "0.25 Hz"}}

    about = {
        "schema": "recording-bundle/1",
        "instrument": "cascaded_tanks",
        "specimen": "water",
        "notes": "pump -> upper tank -> lower tank; Schoukens et al. 2016; nonlinearbenchmark.org",
        "channels": {
            "pump": {**column("u"), "stage": "command"},
            "level": {**column("y"), "stage": "sensor"},
        },
        "setpoints": {"pump": column("u")},
    }
    (folder / "recording.yaml").write_text(yaml.safe_dump(about, sort_keys=False), encoding="utf-8")
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/tanks"), help="folder for the bundles")
    parser.add_argument("--data", type=Path, help="folder of the table (default: in SKINRIG_DATA)")
    arguments = parser.parse_args()
    try:
        for name in PARTS:
            print(make_bundle(name, arguments.output / name, arguments.data))
    except (OSError, ValueError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


if __name__ == "__main__":
    main()
