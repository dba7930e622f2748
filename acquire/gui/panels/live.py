"""The running measurement: every channel with its set-point and its limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from acquire.gui.fresh import Reading
from acquire.gui.messages import ChannelInfo, Preview, View
from acquire.gui.panels.elided import Elided
from acquire.gui.plots import limit_line, plot
from acquire.gui.theme import current
from acquire.gui.thinning import Trace
from acquire.words import pleasant
from drivers.signals import FloatArray

RECENT = 20.0  # s shown while nothing runs, or if asked for
WHOLE, LAST = "whole run", f"last {RECENT:.0f} s"
FIRST_RANGE = {"Pa": (-5_000.0, 500.0), "m": (-0.05e-3, 0.5e-3), "N": (-0.1, 0.1)}
HIDDEN = ("axis_position", "transducer_force")  # raw channels: recorded, but not for an operator to watch
MOST_PLOTS = 4
EDGE = 0.04  # of the range: a curve that comes so near to its end widens it


def groups(channels: Iterable[ChannelInfo]) -> list[tuple[str, list[ChannelInfo]]]:
    """Channels by plot: components of one quantity share one."""
    found: dict[str, list[ChannelInfo]] = {}
    for channel in channels:
        stem, _, last = channel.name.rpartition("_")
        name = stem if stem and last in "xyz123abc" else channel.name
        if name not in HIDDEN:
            found.setdefault(name, []).append(channel)
    return list(found.items())[:MOST_PLOTS]


class ChannelPlot(QWidget):
    """One plot: the curves of one quantity, its set-point, limits, and the newest values in numbers."""

    def __init__(self, title: str, channels: list[ChannelInfo]) -> None:
        super().__init__()
        self.title = title.replace("_", " ")
        self.channels = channels
        self.factor, self.unit = pleasant(channels[0].unit)
        self.digits = 1 if self.unit == "mbar" else 3
        self._told = ""
        self.plot = plot("", "", self.title, self.unit)
        self.numbers = QLabel("")
        self.numbers.setStyleSheet("font-size: 13pt; font-weight: 600")
        self.numbers.setMinimumWidth(1)
        self.numbers.setTextFormat(Qt.TextFormat.RichText)
        theme = current()
        self.traces = {c.name: Trace() for c in channels}
        self.readings = {c.name: Reading() for c in channels}
        self.commanded = {c.name: self._curve(theme.faint, Qt.PenStyle.DotLine) for c in channels}
        self.curves = {c.name: self._curve(theme.curves[k]) for k, c in enumerate(channels)}
        self._lines: list[pg.InfiniteLine] = []
        self._range = FIRST_RANGE.get(channels[0].unit, (-1.0, 1.0))
        self._plan: tuple[FloatArray, Mapping[str, FloatArray]] = (np.empty(0), {})
        self._plan_drawn = math.nan
        self._set_range()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.numbers)
        column.addWidget(self.plot, 1)

    def begin(self, preview: Preview | None) -> None:
        """A run of the previewed protocol begins: its limits are drawn, and room is made for its set-points."""
        for trace in self.traces.values():
            trace.clear()
        for line in self._lines:
            self.plot.removeItem(line)
        self._lines = []
        self._range = FIRST_RANGE.get(self.channels[0].unit, (-1.0, 1.0))
        self.plan(np.empty(0), {})
        if preview is not None:
            values = {c.name: preview.values[c.name] for c in self.channels if c.name in preview.values}
            reached = np.concatenate([np.zeros(1), *values.values()])
            self._cover(float(reached.min()), float(reached.max()))
            span = max(float(np.ptp(reached)), 1e-12)
            bounds = {b for c in self.channels for b in preview.limits.get(c.name, ()) if math.isfinite(b)}
            for bound in bounds:
                self._lines.append(limit_line(self.factor * bound, current()))
                self.plot.addItem(self._lines[-1])
                if reached.min() - span <= bound <= reached.max() + span:
                    self._cover(bound, bound)
        self._set_range()

    def plan(self, time: FloatArray, values: Mapping[str, FloatArray]) -> None:
        """The set-points in device time (s), as the engine knows them now: done, and to come."""
        self._plan = (time, {name: values[name] for name in self.commanded if name in values})
        self._plan_drawn = math.nan
        for curve in self.commanded.values():
            curve.clear()

    def draw(self, begin: float, end: float, offset: float) -> None:
        """The curves between two device times (s), drawn at ``time - offset``."""
        low, high = math.inf, -math.inf
        for name, trace in self.traces.items():
            time, value = trace.between(begin, end)
            self.curves[name].setData(time - offset, self.factor * value)
            seen = value[np.isfinite(value)]
            if len(seen):
                low, high = min(low, float(seen.min())), max(high, float(seen.max()))
        edge = EDGE * (self._range[1] - self._range[0])
        if low < self._range[0] + edge or high > self._range[1] - edge:
            self._cover(low - edge, high + edge)
            self._set_range()
        if offset != self._plan_drawn:
            self._plan_drawn = offset
            time, values = self._plan
            for name, value in values.items():
                self.commanded[name].setData(time - offset, self.factor * value)

    def tell(self) -> None:
        """The newest values in numbers; grey and with their age where they are past."""
        theme = current()
        cells, ages = [], set()
        for colour, (name, reading) in zip(theme.curves, self.readings.items(), strict=False):
            ages.add(reading.age)
            label = name.rpartition("_")[2] if len(self.readings) > 1 else self.title
            value = f"{self.factor * reading.value:z.{self.digits}f}".replace("-", "−") if reading.known else "–"
            past = reading.age or not reading.known
            cells.append(f'<span style="color:{theme.faint if past else colour}">{label} {value}</span>')
        age = f'<span style="color:{theme.faint}"> · {max(ages)}</span>' if max(ages) else ""
        text = f"&nbsp; {'&nbsp; '.join(cells)} {self.unit}{age}"
        if text != self._told:
            self._told = text
            self.numbers.setText(text)

    def _curve(self, colour: str, style: Qt.PenStyle = Qt.PenStyle.SolidLine) -> pg.PlotCurveItem:
        curve = pg.PlotCurveItem(pen=pg.mkPen(colour, width=1, style=style), connect="finite")
        self.plot.addItem(curve)
        return curve

    def _cover(self, low: float, high: float) -> None:
        """Widen the range in one step that leaves room, so that it rarely changes."""
        room = 0.15 * max(high - low, self._range[1] - self._range[0])
        self._range = (
            self._range[0] if low >= self._range[0] else low - room,
            self._range[1] if high <= self._range[1] else high + room,
        )

    def _set_range(self) -> None:
        self.plot.setYRange(self.factor * self._range[0], self.factor * self._range[1], padding=0)


class LivePanel(QWidget):
    """The plots of one instrument, one above the other, on one time axis."""

    def __init__(self, channels: Iterable[ChannelInfo], label: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.label = label
        self.head = Elided("")
        self.plots = [ChannelPlot(name, group) for name, group in groups(channels)]
        self.span = QComboBox()
        self.span.addItems([WHOLE, LAST])
        self.span.setToolTip("How much time is shown")
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        row = QHBoxLayout()
        row.addWidget(self.head, 1)
        row.addWidget(QLabel("Time"))
        row.addWidget(self.span)
        column.addLayout(row)
        for item in self.plots:
            column.addWidget(item, 1)
        self._preview: Preview | None = None
        self._shown = (math.nan, math.nan)
        self._run = 0
        self._now = math.nan
        self._ends = -math.inf  # device time at which the set-points end

    def expect(self, preview: Preview | None) -> None:
        """The protocol that the next run will be of."""
        self._preview = preview

    def show_view(self, view: View, drawn: bool) -> None:
        """Take in new data, and draw them if the panel is to be seen."""
        if view.run != self._run:
            self._run = view.run
            self._ends = -math.inf
            for item in self.plots:
                item.begin(self._preview)
        if view.plan is not None:
            time, values = view.plan
            self._ends = float(time[-1]) if len(time) else -math.inf
            for item in self.plots:
                item.plan(time, values)
        for item in self.plots:
            for name, trace in item.traces.items():
                if name in view.points:
                    trace.add(*view.points[name])
            for name in item.readings.keys() & view.latest.keys():
                item.readings[name].take(view.latest[name])
        self._now = max((t.last[0] for item in self.plots for t in item.traces.values() if len(t)), default=math.nan)
        if drawn and not math.isnan(self._now):
            self._draw(view)

    def tell(self) -> None:
        """The newest values in numbers, and whose they are."""
        head = f"{self.label} – nothing measured yet: Connect it at the left" if math.isnan(self._now) else self.label
        if self.head.text() != head:
            self.head.setText(head)
        for item in self.plots:
            item.tell()

    def _draw(self, view: View) -> None:
        whole = self.span.currentText() == WHOLE and math.isfinite(view.origin) and view.run > 0
        if whole:
            begin = view.origin - 0.02 * view.duration
            length = max(1.04 * view.duration, self._ends + 0.02 * view.duration - begin)  # pauses made it longer
            while begin + length < self._now:
                length *= 1.25  # one that goes on
            self._axis(begin - view.origin, begin + length - view.origin, "time")
            offset, end = view.origin, begin + length
        else:
            begin, end, offset = self._now - RECENT, self._now, self._now
            self._axis(-RECENT, 0.0, "time before now")
        for item in self.plots:
            item.draw(begin, end, offset)

    def _axis(self, begin: float, end: float, label: str) -> None:
        if self._shown != (begin, end):
            self._shown = (begin, end)
            for item in self.plots:
                item.plot.setXRange(begin, end, padding=0)
            self.plots[-1].plot.getAxis("bottom").title(label, "s")
