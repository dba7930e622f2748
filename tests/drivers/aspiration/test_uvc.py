"""The UVC camera's source on a stand-in for OpenCV's capture; no real camera was ever tried."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from drivers.aspiration.camera import Measure, UvcCamera
from drivers.device import LinkLost
from drivers.signals import Block, Channel, Frame

APEX = Channel("apex_height", "m", "sensor")


class Capture:
    """Three frames: two in colour, one grey; then nothing."""

    def __init__(self, index: int) -> None:
        self.open = index == 0
        colour = np.zeros((4, 6, 3), np.uint8)
        colour[..., 1] = 100  # green
        self.images: list[Any] = [colour, colour, np.full((4, 6), 7, np.uint8)]

    def isOpened(self) -> bool:
        return self.open

    def read(self) -> tuple[bool, Any]:
        return (True, self.images.pop(0)) if self.images else (False, None)

    def release(self) -> None:
        self.open = False


class Mean(Measure):
    """Measures an image's mean, and knows no contour."""

    def __call__(self, image: Any, /) -> float:
        return float(image.mean())


@pytest.fixture(autouse=True)
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", Capture)


def test_frames_are_grey_numbered_and_measured() -> None:
    camera = UvcCamera("camera", "uvc:0", (APEX,), Mean())
    assert "UVC" in camera.connect().model
    camera.start_stream()
    items = [item for _ in range(3) for item in camera.read(0.0)]
    frames = [item for item in items if isinstance(item, Frame)]
    heights = [item.values["apex_height"][0] for item in items if isinstance(item, Block)]
    assert [f.seq for f in frames] == [0, 1, 2]
    assert all(f.image.shape == (4, 6) and f.image.dtype == np.uint8 for f in frames)
    assert heights == pytest.approx([59.0, 59.0, 7.0])  # green's share of luminance
    with pytest.raises(LinkLost, match="no more frames"):
        camera.read(0.0)
    camera.make_safe()
    camera.close()
    camera.close()
    with pytest.raises(LinkLost, match="not connected"):
        camera.read(0.0)


def test_no_camera_there() -> None:
    with pytest.raises(LinkLost, match="uvc:3"):
        UvcCamera("camera", "uvc:3", (), None).connect()
