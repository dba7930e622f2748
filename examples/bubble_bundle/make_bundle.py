"""Turn side views of bubbles into aspiration bundles: images in, apex and profile out.

    python examples/bubble_bundle/make_bundle.py -o out/bubbles
    acquire import out/bubbles/calibrated -o out/bubbles/calibrated.h5
    acquire report out/bubbles/calibrated.h5 out/bubbles/gwater -o out/bubbles/page.html

The images (docs/data.md says where to have them) are made smaller: every third or fourth pixel is kept, noise and all,
so that a pixel is three or four times as large.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import cv2
import yaml

from acquire import datasets

# Image, every how many-th pixel is kept, scale of the original in mm/px, where the scale is from. It is known for one
# image only: 1.24 mm over 400 px.
BUNDLES = {
    "calibrated": ("uEye_Image_000827.png", 4, 1.24 / 400, "scale from the data set"),
    "gttab": ("gttab_20_70.tiff", 3, 0.003, "scale assumed"),
    "gwater": ("gwater20_70.tiff", 3, 0.003, "scale assumed"),
}


def smaller(image: Path, every: int) -> cv2.typing.MatLike:
    """Every ``every``-th pixel of a grey picture each way. Raises ValueError for a file that is no picture."""
    whole = cv2.imread(str(image), cv2.IMREAD_GRAYSCALE)
    if whole is None:
        raise ValueError(f"{image}: not a picture that can be read")
    return whole[::every, ::every]


def make_bundle(name: str, folder: Path, data: Path | None = None) -> Path:
    """Write the bundle ``name`` into ``folder`` (replaced if it exists) and return it; ``data`` holds the originals."""
    image, every, scale, note = BUNDLES[name]
    reduced = smaller((data or datasets.folder("bubble_on_needle_cc0")) / image, every)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    cv2.imwrite(str(folder / f"{Path(image).stem}.png"), reduced)
    about = {
        "schema": "recording-bundle/1",
        "instrument": "aspiration",
        "specimen": "bubble on a needle",
        "notes": note,
        "frames": {"files": "*.png", "scale": f"{every * scale:.6g} mm/px", "rate": "1 Hz"},
    }
    (folder / "recording.yaml").write_text(yaml.safe_dump(about, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/bubbles"), help="folder for the bundles")
    parser.add_argument("--data", type=Path, help="folder of the images (default: in SKINRIG_DATA)")
    arguments = parser.parse_args()
    try:
        for name in BUNDLES:
            print(make_bundle(name, arguments.output / name, arguments.data))
    except (OSError, ValueError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


if __name__ == "__main__":
    main()
