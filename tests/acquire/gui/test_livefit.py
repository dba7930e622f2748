"""The live fit's page and process: nothing of it may hold up the window, and it fits no other run than it knows."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import QObject
from pytestqt.qtbot import QtBot

from acquire.gui.livefit import Answer, Begin, Failed, Fitted, LiveFitter, Models, Samples, Train, Training
from acquire.gui.messages import Preview, View
from acquire.gui.panels.livefit import LiveFitPanel
from tests.acquire.gui.conftest import PATIENCE, MakeWindow, connected, state

TIME = np.array([0.0, 1.0, 1.0, 20.0])
SUCTION = {"pressure": np.array([0.0, 0.0, -2e4, -2e4])}
MODEL = '''
"""height = a s (1 - g exp(-t)), s the suction over 10 kPa; slow, so that a window that waited would show it."""
import time
import numpy as np
from skinrig_solver.api import Cost, ModelInfo, Parameter, Result

class Slow:
    info = ModelInfo("slow", "suction", (Parameter("a", "m", 1e-6, 1e-2, 1e-4, "", "", "log"),
        Parameter("g", "", 0.0, 1.0, 0.2, "", "")), ("apex_height",), "a test", "test")

    def simulate(self, experiment, parameters, sensitivities=()):
        time.sleep(0.05)
        p = self.info.complete(parameters)
        s, fading = -experiment.drive["pressure"] / 1e4, np.exp(-experiment.time)
        slopes = {"a": s * (1 - p["g"] * fading), "g": -p["a"] * s * fading}
        wanted = {"apex_height": np.stack([slopes[n] for n in sensitivities], axis=1)} if sensitivities else None
        height = {"apex_height": p["a"] * slopes["a"]}
        return Result(experiment.time, height, tuple(sensitivities), wanted, Cost())

SLOW = Slow()
'''


def preview(name: str = "hold", text: str = "") -> Preview:
    return Preview(name, "cutometer", text, "", (), 20.0, TIME, SUCTION, {}, ())


def view(run: int, state: str = "running", begin: float = 0.0, end: float = 2.0, **more: Any) -> View:
    """A second or two of a run that began at device time 100 s."""
    time = np.arange(begin, end, 0.05)
    points = {"apex_height": (100.0 + time, 1e-4 * time), "pressure": (100.0 + time, -2e4 * (time > 1.0))}
    return View("cutometer", state, run=run, origin=100.0, points=points, **more)


class Fake(QObject):
    """A process that answers at once."""

    def __init__(self) -> None:
        super().__init__()
        self.sent: list[Train | Begin | Samples] = []
        self.idle = True

    def train(self, order: Train) -> None:
        self.sent.append(order)

    def begin(self) -> None:
        self.sent.append(Begin())

    def send(self, streams: Any) -> None:
        self.sent.append(Samples(streams))

    def poll(self) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def panel(qtbot: QtBot) -> LiveFitPanel:
    """A page that is trained for `preview`."""
    page = LiveFitPanel()
    qtbot.addWidget(page)
    page.show()
    page.fitter = Fake()  # type: ignore[assignment]
    page._take(Models({"cutometer": ("slow",)}))
    page.offer("cutometer", "cutometer", preview())
    page.start.click()
    page._take(Training(1, 1, ("apex_height", "pressure")))
    return page


def sent(page: LiveFitPanel) -> list[Any]:
    assert isinstance(page.fitter, Fake)
    return page.fitter.sent


def test_samples_go_out_in_the_protocol_s_own_time(panel: LiveFitPanel) -> None:
    panel.show_view(view(1))
    panel.show_view(view(1, begin=2.0, end=3.0))
    panel.tick()
    order, begin, samples = sent(panel)
    assert isinstance(order, Train)
    assert isinstance(begin, Begin)
    time, height = samples.streams["apex_height"]
    assert time == pytest.approx(np.arange(0.0, 3.0, 0.05))
    assert height == pytest.approx(1e-4 * time)
    panel.tick()
    assert len(sent(panel)) == 3  # nothing new, nothing sent


def test_no_samples_pile_up_at_a_process_that_is_busy(panel: LiveFitPanel) -> None:
    assert isinstance(panel.fitter, Fake)
    panel.fitter.idle = False
    for k in range(5):
        panel.show_view(view(1, begin=k, end=k + 1.0))
        panel.tick()
    assert not any(isinstance(message, Samples) for message in sent(panel))
    panel.fitter.idle = True
    panel.tick()
    assert sent(panel)[-1].streams["pressure"][0].size == 100


@pytest.mark.parametrize("other", [preview("longer", "other: text"), preview()], ids=["protocol", "pause"])
def test_no_other_run_is_fitted(panel: LiveFitPanel, other: Preview) -> None:
    panel.offer("cutometer", "cutometer", other)
    panel.show_view(view(1))
    panel.show_view(view(1, "paused", begin=2.0, end=3.0))
    panel.show_view(view(1, begin=3.0, end=4.0))
    panel.tick()
    last = [m.streams["apex_height"][0].max() for m in sent(panel) if isinstance(m, Samples)]
    assert last == ([] if other.text else [pytest.approx(1.95)])
    assert ("Paused" in panel.status.text()) is not bool(other.text)


def test_the_page_shows_parameters_curve_and_doubts(panel: LiveFitPanel) -> None:
    panel.show_view(view(1))
    time = np.linspace(0.0, 20.0, 201)
    data = np.where(time < 2.0, 1e-4 * time, np.nan)
    row = (("a", "0.1 mm", "0.01 mm", "not known yet"),)
    curve = {"apex_height": 1e-4 * time}
    panel._take(Fitted(row, time, curve, {"apex_height": data}, 20, 0.9, 0.03, 12))
    assert [panel.table.item(0, k).text() for k in range(4)] == list(row[0])
    past, future, points = panel._curves["apex_height"]
    assert past.getData()[0].max() == pytest.approx(1.9)
    assert future.getData()[0].max() == pytest.approx(20.0)
    assert points.getData()[1].max() == pytest.approx(0.19)  # mm
    for words in ("20 samples up to 1.9 s", "10 % of the variance left", "does not follow", "3 %, still refining"):
        assert words in panel.status.text()
    panel.show_view(view(1, "ready"))
    assert panel.start.isEnabled()
    panel._take(Failed("the model could be run at 0 of 54 points only"))
    assert "0 of 54" in panel.status.text()


@pytest.mark.slow
def test_a_process_trains_fits_and_never_holds_up_the_window(qtbot: QtBot, tmp_path: Path) -> None:
    pytest.importorskip("skinrig_solver")
    (tmp_path / "slow.py").write_text(MODEL)
    answers: list[Answer] = []
    fitter = LiveFitter(("cutometer",))
    fitter.answered.connect(answers.append)
    longest = 0.0

    def turn() -> None:
        nonlocal longest
        began = time.process_time()
        fitter.poll()
        longest = max(longest, time.process_time() - began)

    def until(found: Any) -> Any:
        qtbot.waitUntil(lambda: (turn(), any(found(a) for a in answers))[1], timeout=PATIENCE)
        return [a for a in answers if found(a)][-1]

    try:
        assert "suction_yeoh_qlv" in until(lambda a: isinstance(a, Models)).names["cutometer"]
        fitter.train(Train(f"{tmp_path}/slow.py:SLOW", "cutometer", TIME, SUCTION, ""))
        trained = until(lambda a: isinstance(a, Training) and a.streams)
        assert set(trained.streams) == {"apex_height", "pressure"}
        fitter.begin()
        for end in (5.0, 10.0, 20.0):  # a is 0.15 mm, g is 0.4
            t = np.arange(end - 5.0, end, 0.05)
            s = 2.0 * (t > 1.0)
            qtbot.waitUntil(lambda: (turn(), fitter.idle)[1], timeout=PATIENCE)
            answers.clear()
            fitter.send({"apex_height": (t, 1.5e-4 * s * (1 - 0.4 * np.exp(-t))), "pressure": (t, -1e4 * s)})
            found = until(lambda a: isinstance(a, Fitted))
        (a, value, _, _), (g, share, _, _) = found.rows
        assert (a, g) == ("a", "g")
        assert float(value.split()[0]) == pytest.approx(0.15, rel=0.02)
        assert float(share) == pytest.approx(0.4, abs=0.02)
        assert longest < 0.2  # of the window's own processor time; unpickling a fit is all it does
        fitter.train(Train("no_such_model", "cutometer", TIME, SUCTION, ""))
        assert "no_such_model" in until(lambda a: isinstance(a, Failed)).fault
    finally:
        fitter.close()
    assert not fitter.process.is_alive()


@pytest.mark.slow
def test_a_run_goes_on_when_the_process_dies(qtbot: QtBot, make_window: MakeWindow) -> None:
    pytest.importorskip("skinrig_solver")
    window = make_window()
    connected(qtbot, window, "cutometer")
    page = window.live_fit
    window.tabs.setCurrentWidget(page)
    qtbot.waitUntil(lambda: page.start.isEnabled(), timeout=PATIENCE)
    assert page.fitter is not None
    assert page.model.count() > 3
    window.start()
    qtbot.waitUntil(lambda: state(window, "cutometer") == "running", timeout=PATIENCE)
    assert page.fitter.process.pid is not None
    os.kill(page.fitter.process.pid, signal.SIGKILL)
    qtbot.waitUntil(lambda: "has ended" in page.status.text(), timeout=PATIENCE)
    qtbot.waitUntil(lambda: window.recordings.result.result is not None, timeout=PATIENCE)
    assert window.recordings.result.result.path.exists()
