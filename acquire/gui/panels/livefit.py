"""The live fit's page: train for the protocol, then watch parameters and curve while the run goes on."""

from __future__ import annotations

import math

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QProgressBar,
    QPushButton,
    QSplitter,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from acquire.gui.livefit import Answer, Failed, Fitted, LiveFitter, Models, Train, Training
from acquire.gui.messages import LIVE, Preview, View
from acquire.gui.plots import plot
from acquire.gui.theme import current
from acquire.words import pleasant, share, unit_of
from drivers.signals import FloatArray

HEAD = ("parameter", "value", "± s.e.", "")
POOR = 0.98  # share of the sum of squares below which the page says that the model does not follow
COARSE = 0.01  # error of the emulator from which the page says so


Chosen = tuple[str, str, Preview]  # instrument, its kind, protocol


class LiveFitPanel(QWidget):
    """One model fitted to the running measurement, about once a second."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.fitter: LiveFitter | None = None
        self._models: dict[str, tuple[str, ...]] = {}
        self._offer: Chosen | None = None
        self._trained: Chosen | None = None
        self._streams: tuple[str, ...] = ()  # channels of the trained fit; none while it is not trained
        self._run = -1  # of the trained instrument, while its samples are taken
        self._seen: dict[str, int] = {}  # runs of each instrument
        self._samples: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
        self.fitted = Fitted()
        heading = QLabel("Fit while measuring")
        heading.setProperty("role", "title")
        words = QLabel(
            "Trains a model for the chosen protocol beforehand; during a run of it the parameters are fitted about "
            "once a second, to the commanded set-points. The recording is fitted with everything measured under Fit."
        )
        words.setProperty("role", "faint")
        words.setWordWrap(True)
        self.model = QComboBox()
        self.start = QPushButton("Train for this protocol")
        self.start.clicked.connect(self.train)
        self.bar = QProgressBar()
        self.bar.setRange(0, 1)
        self.status = QLabel("Choose a protocol first.")
        self.status.setWordWrap(True)
        self.plot = plot("time", "s", "measured")
        self.table = QTableWidget(0, len(HEAD))
        self.table.setHorizontalHeaderLabels(list(HEAD))
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.table.horizontalHeader().setStretchLastSection(True)
        self.table.verticalHeader().hide()
        self.table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self._curves: dict[str, tuple[pg.PlotCurveItem, pg.PlotCurveItem, pg.ScatterPlotItem]] = {}
        row = QHBoxLayout()
        row.addWidget(self.model, 1)
        row.addWidget(self.start)
        row.addWidget(self.bar, 1)
        split = QSplitter(Qt.Orientation.Horizontal)
        split.addWidget(self.plot)
        split.addWidget(self.table)
        split.setSizes([560, 440])
        column = QVBoxLayout(self)
        column.addWidget(heading)
        column.addWidget(words)
        column.addLayout(row)
        column.addWidget(self.status)
        column.addWidget(split, 1)
        self._enable()

    # What a person and the window do ----------------------------------------------------------------------------------

    def offer(self, name: str, kind: str, preview: Preview | None) -> None:
        """The chosen instrument and protocol."""
        chosen = None if preview is None or preview.instrument != kind else (name, kind, preview)
        if chosen is None or self._offer is None or chosen[1] != self._offer[1]:
            self._list(kind if chosen else "")
        self._offer = chosen
        self._enable()

    def train(self) -> None:
        """Train for the offered protocol."""
        if self._offer is None or self.fitter is None or not self.model.currentText():
            return
        self._forget()
        self._trained, self._streams = self._offer, ()
        _, kind, preview = self._offer
        self.fitter.train(Train(self.model.currentText(), kind, preview.time, preview.values, preview.text))
        self.bar.setRange(0, 0)
        self.status.setText(f"Training {self.model.currentText()} for {preview.name} …")
        self._enable()

    def show_view(self, view: View) -> None:
        """New data of an instrument: taken while it runs the protocol that was trained for."""
        begun = view.run != self._seen.get(view.name, 0)
        self._seen[view.name] = view.run
        if self._trained is None or view.name != self._trained[0]:
            return
        if begun:
            self._run = -1
            if self._streams and self._offer is not None and _alike(self._offer, self._trained):
                self._begin(view.run)
        if self._run != view.run:
            return
        if view.state not in LIVE:
            self._run = -1  # it is over; the last samples are on their way
            self._enable()
            return
        if view.state == "paused":
            self._run = -1
            self.status.setText("Paused: from here on the run is not the protocol that was trained for.")
            return
        if view.state != "running" or math.isnan(view.origin):
            return
        for name in self._streams:
            if name in view.points:
                time, value = view.points[name]
                self._samples.setdefault(name, []).append((time - view.origin, value))

    def tick(self) -> None:
        """The window's timer: answers, and samples for the next fit. The process starts when the page is first seen."""
        if self.fitter is None:
            if self.isVisible() and self._offer is not None:
                self._launch()
            return
        self.fitter.poll()
        if self.fitter is not None and self._samples and self.fitter.idle:
            joined = {n: (np.concatenate([t for t, _ in p]), np.concatenate([v for _, v in p]))
                      for n, p in self._samples.items()}  # fmt: skip
            self._samples = {}
            self.fitter.send(joined)

    def close_tool(self) -> None:
        """End the process."""
        if self.fitter is not None:
            self.fitter.close()
            self.fitter = None

    # Answers ----------------------------------------------------------------------------------------------------------

    def _launch(self) -> None:
        self.fitter = LiveFitter(("cutometer", "aspiration", "microrobot"), self)
        self.fitter.answered.connect(self._take)
        self.fitter.lost.connect(self._lost)
        self.status.setText("Listing the models …")

    def _take(self, answer: Answer) -> None:
        if isinstance(answer, Models):
            self._models = dict(answer.names)
            self._list(self._offer[1] if self._offer else "")
            self.status.setText("Train, then start the run.")
        elif isinstance(answer, Failed):
            self._trained, self._streams = None, ()
            self.bar.setRange(0, 1)
            self.status.setText(answer.fault)
        elif isinstance(answer, Training):
            self.bar.setRange(0, answer.of)
            self.bar.setValue(answer.done)
            if answer.streams and self._trained is not None:
                self._streams = answer.streams
                self.status.setText(f"Trained for {self._trained[2].name}: start the run.")
        elif self._run >= 0 or answer.rows:
            self.fitted = answer
            self._draw(answer)
        self._enable()

    def _lost(self) -> None:
        self.fitter, self._trained, self._streams, self._models = None, None, (), {}
        self.model.clear()
        self.bar.setRange(0, 1)
        self.status.setText("The fit's process has ended; runs and recordings are not touched by that.")
        self._enable()

    def _begin(self, run: int) -> None:
        self._forget()
        self._run = run
        if self.fitter is not None:
            self.fitter.begin()
        self.status.setText("The run has begun …")

    def _forget(self) -> None:
        self._run, self._samples, self.fitted = -1, {}, Fitted()
        self.table.setRowCount(0)
        self.plot.clear()
        self._curves = {}

    def _list(self, kind: str) -> None:
        names = self._models.get(kind, ())
        if [self.model.itemText(k) for k in range(self.model.count())] != list(names):
            self.model.clear()
            self.model.addItems(names)

    def _draw(self, fitted: Fitted) -> None:
        if fitted.time is None:
            self.status.setText("Too few samples yet.")
            return
        self.table.setRowCount(len(fitted.rows))
        for k, row in enumerate(fitted.rows):
            for j, text in enumerate(row):
                self.table.setItem(k, j, QTableWidgetItem(text))
        low, high, last = 0.0, 0.0, 0.0
        for channel, curve in fitted.curves.items():
            factor, unit = pleasant(unit_of(channel))
            past, future, points = self._items(channel, unit)
            data = fitted.data[channel]
            there = np.isfinite(data)
            last = float(fitted.time[there].max()) if there.any() else 0.0
            split = int(np.searchsorted(fitted.time, last))
            past.setData(fitted.time[: split + 1], factor * curve[: split + 1])
            future.setData(fitted.time[split:], factor * curve[split:])
            points.setData(fitted.time[there], factor * data[there])
            low = min(low, factor * float(curve.min()), factor * float(data[there].min(initial=0.0)))
            high = max(high, factor * float(curve.max()), factor * float(data[there].max(initial=0.0)))
        room = 0.05 * max(high - low, 1e-12)
        self.plot.setXRange(0.0, float(fitted.time[-1]), padding=0.01)
        self.plot.setYRange(low - room, high + room, padding=0)
        self.status.setText(_words(fitted, last))

    def _items(self, channel: str, unit: str) -> tuple[pg.PlotCurveItem, pg.PlotCurveItem, pg.ScatterPlotItem]:
        if channel not in self._curves:
            theme = current()
            colour = theme.curves[len(self._curves) % len(theme.curves)]
            points = pg.ScatterPlotItem(pen=None, brush=pg.mkBrush(theme.faint), size=3)
            past = pg.PlotCurveItem(pen=pg.mkPen(colour, width=2))
            future = pg.PlotCurveItem(pen=pg.mkPen(colour, width=1, style=Qt.PenStyle.DashLine))
            for item in (points, past, future):
                self.plot.addItem(item)
            self.plot.getAxis("left").title(_titled(channel), unit)
            self._curves[channel] = (past, future, points)
        return self._curves[channel]

    def _enable(self) -> None:
        ready = self.fitter is not None and self._offer is not None and bool(self.model.count())
        self.start.setEnabled(ready and self._run < 0)


def _alike(one: Chosen, other: Chosen) -> bool:
    """Whether two choices are the same set-points on the same instrument."""
    mine, yours = one[2], other[2]
    same = one[:2] == other[:2] and mine.text == yours.text and np.array_equal(mine.time, yours.time)
    return same and all(
        name in yours.values and np.array_equal(values, yours.values[name]) for name, values in mine.values.items()
    )


def _titled(channel: str) -> str:
    """A channel's name on an axis: components of one quantity share it."""
    stem, _, last = channel.rpartition("_")
    return (stem if stem and last in "xyz" else channel).replace("_", " ")


def _words(fitted: Fitted, last: float) -> str:
    """One line on how far the fit goes and how far it may be trusted."""
    parts = [f"{fitted.samples} samples up to {last:.1f} s, {share(1.0 - fitted.explained)} of the variance left"]
    if fitted.explained < POOR:
        parts.append("the model does not follow the data: its parameters say little")
    if math.isnan(fitted.off):
        parts.append("not yet compared with the full model")
    else:
        refining = ", still refining" if fitted.off > COARSE else ""
        parts.append(f"error of the emulator {share(fitted.off)}{refining}")
    return "; ".join(parts)
