"""Turn side views of bubbles into aspiration bundles: images in, apex and profile out.

    python examples/bubble_bundle/make_bundle.py -o out/bubbles
    acquire import out/bubbles/calibrated -o out/bubbles/calibrated.h5
    acquire report out/bubbles/calibrated.h5 out/bubbles/gwater -o out/bubbles/page.html

The images are small copies of real ones (see tests/data/README.md): every third or fourth pixel, so that a pixel is
three or four times as large.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import yaml

DATA = Path(__file__).parents[2] / "tests" / "data" / "bubble_on_needle_cc0"
# Image, scale in mm/px, where the scale is from. It is known for one image: 1.24 mm over 400 px of the original.
BUNDLES = {
    "calibrated": ("uEye_Image_000827_every_4.png", 4 * 1.24 / 400, "scale from the data set"),
    "gttab": ("gttab_20_70_every_3.png", 3 * 0.003, "scale assumed"),
    "gwater": ("gwater20_70_every_3.png", 3 * 0.003, "scale assumed"),
}


def make_bundle(name: str, folder: Path, data: Path = DATA) -> Path:
    """Write the bundle ``name`` into ``folder`` (replaced if it exists) and return it."""
    image, scale, note = BUNDLES[name]
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shutil.copyfile(data / image, folder / image)
    about = {
        "schema": "recording-bundle/1",
        "instrument": "aspiration",
        "specimen": "bubble on a needle",
        "notes": note,
        "frames": {"files": "*.png", "scale": f"{scale:.6g} mm/px", "rate": "1 Hz"},
    }
    (folder / "recording.yaml").write_text(yaml.safe_dump(about, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/bubbles"), help="folder for the bundles")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the images")
    arguments = parser.parse_args()
    for name in BUNDLES:
        print(make_bundle(name, arguments.output / name, arguments.data))


if __name__ == "__main__":
    main()
