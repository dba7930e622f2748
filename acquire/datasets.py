"""Public recordings of real machines and skin that tests, benchmarks and examples read. None is part of the project.

A folder per data set lies in the folder that the environment variable ``SKINRIG_DATA`` names; docs/data.md says where
each can be had. Every file is compared with its known SHA-256 before use: figures are quoted for these bytes.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

VARIABLE = "SKINRIG_DATA"


class DatasetMissing(FileNotFoundError):
    """The data set is not on this machine; the message says where it can be had."""


@dataclass(frozen=True)
class Dataset:
    """One data set: where it can be had, and the SHA-256 of each file by its name in the data set's folder."""

    source: str
    files: Mapping[str, str]


DATASETS: Mapping[str, Dataset] = {
    "emps": Dataset(
        "https://github.com/forgi86/sysid-neural-continuous, examples/EMPS/data",
        {
            "DATA_EMPS.mat": "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e",
            "DATA_EMPS_PULSES.mat": "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704",
        },
    ),
    "cascaded_tanks": Dataset(
        "https://github.com/forgi86/sysid-neural-continuous, examples/CTS",
        {"dataBenchmark.csv": "ef2388ed822f3aef4aa80d6b0f2b466dd80b361786b3eafc7a2957c31ea323a7"},
    ),
    "bubble_on_needle_cc0": Dataset(
        "https://github.com/sciunto/pendantdrop, data",
        {
            "gttab_20_70.tiff": "a28f1bf93f64a45c41d553477a5e983873f79871191e92a4a8ac07110776ed64",
            "gwater20_70.tiff": "a3dbc5d1c223f53dbe06ca97a46554037a817c8af9b95cb24c1330b91917f205",
            "uEye_Image_000827.png": "6e91fa7cdf2ab4066afe041fbab283e7928db63965ba84ee1f242bcdb43c129b",
        },
    ),
    "rubber_hyperelastic": Dataset(
        "https://github.com/Chongran-Zhao/Calibration-Hyperelasticity, data/data.h5",
        {"data.h5": "7235b877e83b0c16151e18ac08b7ad8c9b6f0e10bdc84f94455b29cc4c371018"},
    ),
    "skin_suction_ring": Dataset(
        "https://github.com/aflahelouneg/MARSAC, fitted as docs/data.md says",
        {"curve.csv": "cf56517ae8eff734538616656d766aac4a7605641a5d95cea267e0ac43c205ea"},
    ),
    "skin_extension": Dataset(
        "https://github.com/aflahelouneg/inverse_identification_soft_tissue",
        {
            "bimaterial.csv": "0697614c0ae96c0c8274225f1a1cad5c273e3c7e3025c41c1d03a69509113c9b",
            "monolithic.csv": "49eef72d4aa64b6d08e15f2bdd50800590b3744e840a080f2cf706c3aa295da9",
        },
    ),
}


def folder(name: str) -> Path:
    """The checked folder of the data set ``name``.

    Raises DatasetMissing if a file of it is not there, ValueError if one is not the published one or the name is
    unknown.
    """
    if name not in DATASETS:
        raise ValueError(f"unknown data set {name!r}; there is {', '.join(DATASETS)}")
    dataset = DATASETS[name]
    root = os.environ.get(VARIABLE, "")
    if not root:
        raise DatasetMissing(f"data set {name}: {VARIABLE} is not set; to be had from {dataset.source} (docs/data.md)")
    for file, expected in dataset.files.items():
        path = Path(root) / name / file
        if not path.is_file():
            raise DatasetMissing(f"data set {name}: {path} is missing; to be had from {dataset.source} (docs/data.md)")
        with path.open("rb") as stream:
            found = hashlib.file_digest(stream, "sha256").hexdigest()
        if found != expected:
            raise ValueError(f"data set {name}: {path} is not the published file: its SHA-256 is {found}")
    return Path(root) / name
