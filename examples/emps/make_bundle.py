"""Turn the EMPS benchmark (a servo drive) into bundles that `acquire import` reads.

    python examples/emps/make_bundle.py -o out/emps
    acquire import out/emps/record -o out/emps/record.h5
    acquire show out/emps/record.h5 --png out/emps/record.png

``record`` is the plain one, ``pulses`` the one with a known disturbance (docs/data.md says where to have it).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from acquire import datasets
from acquire.recording import Recording, RunInfo, Series, write_bundle

RECORDS = {"record": "DATA_EMPS.mat", "pulses": "DATA_EMPS_PULSES.mat"}


def recording(name: str, data: Path | None = None) -> Recording:
    """The record ``record`` or ``pulses`` of the folder ``data`` (that of SKINRIG_DATA where None), in SI.

    ``motor_force`` is the drive gain (N/V) times the motor voltage; ``disturbance`` is the voltage added to the
    controller's output, which the motor voltage contains.
    """
    raw = loadmat((data or datasets.folder("emps")) / RECORDS[name])
    time = raw["t"].ravel()
    gain = float(raw["gtau"].item())

    def series(values: np.ndarray, unit: str, stage: str) -> Series:
        return Series(np.asarray(values, float).ravel(), time, unit, stage=stage)

    streams = {
        "position": series(raw["qm"], "m", "sensor"),
        "reference_position": series(raw["qg"], "m", "command"),
        "motor_voltage": series(raw["vir"], "V", "command"),
        "motor_force": series(gain * raw["vir"], "N", "actuator"),
    }
    if "pulses_N" in raw:
        streams["disturbance"] = series(raw["pulses_N"], "V", "command")
    gains = {
        "drive_gain": (gain, "N/V"),
        "kp": (float(raw["kp"].item()), "1/s"),
        "kv": (float(raw["kv"].item()), "V*s/m"),
    }
    return Recording(
        info=RunInfo(
            id=f"emps-{name}",
            instrument="emps",
            start_time="",
            status="imported",
            specimen="carriage",
            notes="Electro-mechanical positioning system; Janot, Gautier, Brunot 2019; nonlinearbenchmark.org",
            calibration={k: {"value": v, "unit": unit, "provenance": "documented"} for k, (v, unit) in gains.items()},
        ),
        streams=streams,
        setpoints={"position": series(raw["qg"], "m", "command")},
        plot="position",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/emps"), help="folder for the bundles")
    parser.add_argument("--data", type=Path, help="folder of the .mat files (default: in SKINRIG_DATA)")
    arguments = parser.parse_args()
    try:
        for name in RECORDS:
            print(write_bundle(recording(name, arguments.data), arguments.output / name))
    except (OSError, ValueError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


if __name__ == "__main__":
    main()
