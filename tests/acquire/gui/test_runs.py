"""A protocol on each instrument, from the click to the recording, through every panel."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QSettings, Qt
from pytestqt.qtbot import QtBot

from acquire.gui import settings
from acquire.gui.panels.camera import CameraPanel
from acquire.gui.panels.measure import MeasurePanel
from acquire.qualifications import SCHEMA, Qualification, keep
from acquire.recording import Recording, open_recording
from tests.acquire.gui.conftest import PATIENCE, MakeWindow, connected, state

CHANNELS = {"cutometer": "apex_height", "aspiration": "apex_height", "microrobot": "force_z"}


@pytest.mark.parametrize("name", list(CHANNELS))
def test_from_click_to_recording(qtbot: QtBot, make_window: MakeWindow, store: QSettings, name: str) -> None:
    window = make_window()
    connected(qtbot, window, name)
    preview = window.prepare.preview
    assert preview is not None
    assert preview.name == f"demo-{name}"
    window.subject.subject.setText("P07")
    panel = window.measure.currentWidget()
    if panel.camera is not None:
        window.tabs.setCurrentWidget(window.measure)
        qtbot.waitUntil(lambda: "mm" in panel.camera.apex.text(), timeout=PATIENCE)
        proposed = set_by_hand(qtbot, panel.camera) - 10
    qtbot.mouseClick(window.controls.start_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: state(window, name) == "running", timeout=PATIENCE)
    assert window.tabs.currentWidget() is window.measure
    qtbot.waitUntil(lambda: window.views[name].elapsed > 0.3 * preview.duration, timeout=PATIENCE)
    curves_are_drawn(panel, preview.duration)
    if panel.camera is not None:
        threshold_is_fixed(qtbot, panel.camera, proposed + 10)
    if panel.robot is not None:
        assert "N" in panel.robot.numbers.text()
    assert window.controls.countdown.text()
    away = "away from rest" if name == "microrobot" else "under suction"  # beside what is allowed
    assert re.search(rf"{away} \d+:\d\d of \d+:00", window.controls.detail.text())
    least = window.minimumSizeHint()  # the emergency stop stays on a small laptop's screen, whatever the labels say
    assert least.width() <= 960
    assert least.height() <= 540
    qtbot.waitUntil(lambda: window.recordings.result.result is not None, timeout=PATIENCE)
    result = window.recordings.result.result
    assert result is not None
    recording = open_recording(result.path)
    assert recording.info.status == "completed"
    assert recording.info.subject == "P07"
    assert CHANNELS[name] in recording.streams
    if panel.camera is not None:  # a threshold set by hand is the recording's too
        assert recording.info.calibration["gvt"]["value"] == proposed + 10
        one_apex(recording)
        window.tabs.setCurrentWidget(window.measure)
        no_contour_no_height(qtbot, panel)
    assert window.recordings.result.flags
    assert window.recordings.result.picture.shown
    assert window.recordings.result.table.rowCount() > 0
    assert window.subject.repeat.value() == 2
    qtbot.waitUntil(lambda: window.recordings.browser.table.rowCount() == 1, timeout=PATIENCE)
    window.shut()
    kept = settings.load(store)
    assert kept.instrument == name
    assert kept.protocols[name].endswith(f"demo-{name}.yaml")


def curves_are_drawn(panel: MeasurePanel, duration: float) -> None:
    """Every channel has a curve, thinned, on the protocol's own clock."""
    for plot in panel.live.plots:
        for channel, curve in plot.curves.items():
            time, _ = curve.getData()
            assert len(time), channel
            assert len(time) <= 900
            assert duration * 1.05 > time[-1] > 0


def threshold_is_fixed(qtbot: QtBot, camera: CameraPanel, threshold: int) -> None:
    """A picture with its contour; the threshold is the plan's: in a run neither mouse nor key moves it."""
    assert camera.image.image is not None
    assert len(camera.outline.getData()[0]) > 20
    assert "mm" in camera.apex.text()
    assert f"grey {threshold}" in camera.quality.text()
    assert not camera.slider.isEnabled()
    assert not camera.proposed.isEnabled()
    qtbot.keyClick(camera.slider, Qt.Key.Key_Right)
    qtbot.mouseClick(camera.proposed, Qt.MouseButton.LeftButton)
    assert camera.gvt == threshold


def no_contour_no_height(qtbot: QtBot, panel: MeasurePanel) -> None:
    """Where no contour is found, no height stands there."""
    camera = panel.camera
    assert camera is not None
    qtbot.waitUntil(camera.slider.isEnabled, timeout=PATIENCE)
    camera.slider.setFocus()
    qtbot.keyClick(camera.slider, Qt.Key.Key_Home)
    qtbot.waitUntil(lambda: "no contour" in camera.apex.text(), timeout=PATIENCE)
    assert "mm" not in camera.apex.text()
    height = next(plot for plot in panel.live.plots if "apex_height" in plot.readings)
    qtbot.waitUntil(lambda: "height –" in height.numbers.text(), timeout=PATIENCE)


def set_by_hand(qtbot: QtBot, camera: CameraPanel) -> int:
    """Set the threshold ten above the proposed one, by mouse and keys."""
    where = QPoint(8, camera.proposed.height() // 2)
    qtbot.mouseClick(camera.proposed, Qt.MouseButton.LeftButton, pos=where)
    camera.slider.setFocus()
    for _ in range(10):
        qtbot.keyClick(camera.slider, Qt.Key.Key_Right)
    return camera.slider.value()


def one_apex(recording: Recording) -> None:
    """The recorded apex height is what the frames show at the recorded threshold, and counts from the same rest."""
    height, low, high = recording.streams["apex_height"], recording.derived["apex_low"], recording.derived["apex_high"]
    told = np.interp(low.time, height.time, height.value)
    inside = (told >= low.value - 2e-5) & (told <= high.value + 2e-5)  # one pixel: each has its own zero
    assert np.mean(inside[np.isfinite(low.value)]) > 0.9


def test_the_threshold_that_is_shown_is_the_recording_s(qtbot: QtBot, make_window: MakeWindow) -> None:
    window = make_window()
    connected(qtbot, window, "aspiration")
    camera = window.measure.currentWidget().camera
    assert camera is not None
    window.tabs.setCurrentWidget(window.measure)
    qtbot.waitUntil(lambda: "mm" in camera.apex.text(), timeout=PATIENCE)
    camera.proposed.setChecked(False)
    camera.slider.setValue(camera.slider.value() + 10)
    qtbot.mouseClick(window.controls.start_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: state(window, "aspiration") == "running", timeout=PATIENCE)
    for _ in range(5):
        qtbot.keyClick(camera.slider, Qt.Key.Key_Right)
    qtbot.waitUntil(lambda: window.recordings.result.result is not None, timeout=PATIENCE)
    result = window.recordings.result.result
    assert result is not None
    assert open_recording(result.path).info.calibration["gvt"]["value"] == camera.slider.value()


def test_a_run_after_the_qualification_expired_is_warned_of(
    qtbot: QtBot, make_window: MakeWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    window = make_window(speed=5.0)
    connected(qtbot, window, "cutometer")
    row = window.instruments.rows["cutometer"]
    assert not row.error.text()
    old = datetime(2020, 1, 1, tzinfo=UTC)
    said = {"instrument": "cutometer", "serial": "SIM-C1", "date": old, "passed": True, "verdict": "none"}
    keep(Qualification(**{"schema": SCHEMA, **said}))
    window.controls.start_button.click()
    qtbot.waitUntil(lambda: "expired on 2020-06-29" in row.error.text(), timeout=PATIENCE)
    assert state(window, "cutometer") in ("armed", "running")
    window.controls.stop_button.click()
    qtbot.waitUntil(lambda: window.recordings.result.result is not None, timeout=PATIENCE)


def test_pause_resume_stop(qtbot: QtBot, make_window: MakeWindow) -> None:
    window = make_window(speed=5.0)
    connected(qtbot, window, "cutometer")
    window.controls.start_button.click()
    plot = window.measure.currentWidget().live.plots[0]
    qtbot.waitUntil(lambda: window.views["cutometer"].elapsed > 3.0, timeout=PATIENCE)  # in the hold, from 1 s to 9 s
    planned = plot.commanded["pressure"].getData()[0][-1]
    assert planned == pytest.approx(window.views["cutometer"].duration)
    window.controls.pause_button.click()
    qtbot.waitUntil(lambda: state(window, "cutometer") == "paused", timeout=PATIENCE)
    # Nobody knows when it goes on: nothing is drawn ahead.
    qtbot.waitUntil(lambda: plot.commanded["pressure"].getData()[0][-1] < planned - 15.0, timeout=PATIENCE)
    qtbot.waitUntil(lambda: window.controls.pause_button.text() == "RESUME", timeout=PATIENCE)
    window.controls.pause_button.click()
    qtbot.waitUntil(lambda: state(window, "cutometer") == "running", timeout=PATIENCE)
    # The set-points are where the data are: the hold is repeated, and everything behind it comes later.
    qtbot.waitUntil(lambda: plot.readings["pressure"].value < -29e3, timeout=PATIENCE)
    begun = plot.curves["pressure"].getData()[0][-1] + 1.0
    qtbot.waitUntil(lambda: plot.curves["pressure"].getData()[0][-1] > begun + 3.0, timeout=PATIENCE)
    time, measured = plot.curves["pressure"].getData()
    late = (time > begun) & (time < begun + 3.0)
    assert np.allclose(measured[late], np.interp(time[late], *plot.commanded["pressure"].getData()), atol=15.0)  # mbar
    assert plot.commanded["pressure"].getData()[0][-1] > planned + 2.0
    assert plot.plot.viewRange()[0][1] > plot.commanded["pressure"].getData()[0][-1]
    window.controls.stop_button.click()
    qtbot.waitUntil(lambda: window.recordings.result.result is not None, timeout=PATIENCE)
    assert window.recordings.result.result is not None
    assert window.recordings.result.result.summary["status"] == "aborted"
    assert window.subject.repeat.value() == 1
