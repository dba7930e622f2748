"""The main window: it puts the panels together and carries what a person wants to the worker and back."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import QSettings, Qt, QTimer
from PySide6.QtGui import QAction, QCloseEvent, QKeySequence
from PySide6.QtWidgets import (
    QApplication,
    QFileDialog,
    QHBoxLayout,
    QMainWindow,
    QMessageBox,
    QScrollArea,
    QStackedWidget,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from acquire.gui import settings, theme
from acquire.gui.client import Client
from acquire.gui.estop import EmergencyStop
from acquire.gui.messages import (
    LIVE,
    NEEDS_RESET,
    BenchSettings,
    Finished,
    Measurement,
    ProtocolEntry,
    Ready,
    Reply,
    View,
)
from acquire.gui.panels.banner import Banner
from acquire.gui.panels.controls import ControlBar
from acquire.gui.panels.health import Health
from acquire.gui.panels.instruments import InstrumentsPanel
from acquire.gui.panels.measure import MeasurePanel
from acquire.gui.panels.prepare import PreparePanel
from acquire.gui.panels.subject import SubjectPanel
from acquire.gui.recordings import Recordings

FRAME = 33  # ms between two turns of the one timer
SIDE = 396  # px, the column of instruments and subject


class MainWindow(QMainWindow):
    """The operator's window on one bench.

    ``store`` is where settings are kept (the user's own by default).
    """

    def __init__(self, bench: BenchSettings, store: QSettings | None = None) -> None:
        super().__init__()
        self.setWindowTitle("skinrig")
        self.store = store or QSettings(settings.ORGANISATION, settings.APPLICATION)
        self.kept = settings.load(self.store)
        self.bench = bench
        self.latched = False
        self.views: dict[str, View] = {}
        self._asked_to_run: set[str] = set()  # instruments between START and the first view of the run
        self._resetting: set[str] = set()
        self._entries: tuple[ProtocolEntry, ...] = ()
        self._drawn: dict[str, MeasurePanel] = {}
        self._build()
        self._menu()
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        self.estop = EmergencyStop(app, lambda: self.live)
        self.estop.fired.connect(self.emergency_stop)
        self.client: Client
        self._connect_bench()
        self.recordings.refresh()
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self.tick)
        self._timer.start(FRAME)

    # Building ---------------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        self.instruments, self.subject = InstrumentsPanel(), SubjectPanel()
        self.controls, self.health = ControlBar(), Health()
        self.alarm, self.prepare = Banner("alarm", "Reset"), PreparePanel()
        self.measure = QStackedWidget()
        self.recordings = Recordings(self.bench.out, self)
        kept = self.recordings
        self.tabs = QTabWidget()
        for widget, title in (
            (self.prepare, "Protocol"), (self.measure, "Measure"), (kept.result, "Result"),
            (kept.browser, "Recordings"), (kept.diagnosis, "Diagnosis"), (kept.fit, "Fit"),
        ):  # fmt: skip
            self.tabs.addTab(widget, title)
        side = QWidget()
        column = QVBoxLayout(side)
        column.setContentsMargins(0, 0, 6, 0)
        column.addWidget(self.instruments)
        column.addWidget(self.subject)
        column.addStretch(1)
        scroll = QScrollArea()
        scroll.setWidget(side)
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QScrollArea.Shape.NoFrame)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setFixedWidth(SIDE)
        row = QHBoxLayout()
        row.addWidget(scroll)
        row.addWidget(self.tabs, 1)
        central = QWidget()
        column = QVBoxLayout(central)
        column.addWidget(self.controls)
        column.addWidget(self.alarm)
        column.addWidget(kept.offer)
        column.addLayout(row, 1)
        self.setCentralWidget(central)
        self.statusBar().addPermanentWidget(self.health, 1)
        self.resize(1280, 860)
        self.restoreGeometry(self.kept.geometry)
        self.subject.operator.setText(self.kept.operator)
        self._wire()

    def _wire(self) -> None:
        self.instruments.chosen.connect(self._choose_instrument)
        self.instruments.wanted.connect(lambda action, name: self._ask(action, name))
        self.instruments.station_wanted.connect(self._change_station)
        self.subject.changed.connect(lambda: self._count())
        self.subject.settled.connect(self._preview)
        self.prepare.wanted.connect(lambda path: self._preview())
        self.prepare.open_wanted.connect(self._open_protocol)
        self.controls.start.connect(self.start)
        self.controls.pause.connect(lambda: self._ask("pause", self.current))
        self.controls.resume.connect(lambda: self._ask("resume", self.current))
        self.controls.halt.connect(lambda: self._ask("abort", self.current))
        self.controls.estop.connect(self.emergency_stop)
        self.alarm.accepted.connect(self.reset)
        self.recordings.browser.folder_wanted.connect(self._change_folder)
        self.recordings.read.connect(lambda: self._count())
        self.recordings.said.connect(self._say)
        self.recordings.page_wanted.connect(self.tabs.setCurrentWidget)
        self.recordings.result_ready.connect(lambda page: None if self.live else self.tabs.setCurrentWidget(page))

    def _menu(self) -> None:
        view = self.menuBar().addMenu("&View")
        for number in range(self.tabs.count()):
            action = QAction(self.tabs.tabText(number), self)
            action.setShortcut(QKeySequence(f"Ctrl+{number + 1}"))
            action.triggered.connect(partial(self.tabs.setCurrentIndex, number))
            view.addAction(action)
        view.addSeparator()
        dark = QAction("Light or &dark (from the next start)", self)
        dark.setShortcut("Ctrl+D")
        dark.triggered.connect(self._other_theme)
        view.addAction(dark)
        quit_action = QAction("&Quit", self)
        quit_action.setShortcut(QKeySequence.StandardKey.Quit)
        quit_action.triggered.connect(self.close)
        view.addAction(quit_action)

    # What goes on -----------------------------------------------------------------------------------------------------

    @property
    def current(self) -> str:
        """Name of the chosen instrument."""
        return self.instruments.current

    @property
    def live(self) -> bool:
        """Whether an instrument acts on a person, or may begin to at any moment."""
        return bool(self._asked_to_run) or any(view.state in LIVE for view in self.views.values())

    @property
    def ready(self) -> bool:
        """Whether START may be pressed, as far as the window knows."""
        preview, row = self.prepare.preview, self.instruments.rows.get(self.current)
        fits = preview is not None and row is not None and preview.instrument == row.info.kind
        return fits and not self.latched and self.subject.sound and self.recordings.listed

    def tick(self) -> None:
        """One turn of the timer: liveness, news, painting."""
        self.client.poll()
        self.recordings.tick()
        self.health.count_frame()

    def _show_views(self, views: tuple[View, ...]) -> None:
        for view in views:
            self.views[view.name] = view
            if view.state in LIVE:
                self._asked_to_run.discard(view.name)
            panel = self._drawn.get(view.name)
            if panel is not None:
                panel.show_view(view, self.measure.currentWidget() is panel and panel.isVisible())
        self.instruments.show_views(views)
        self._show_controls()
        self.health.show_view(self.views.get(self.current))
        for view in views:
            if view.state in NEEDS_RESET and view.name not in self._resetting and self.alarm.isHidden():
                self.latched = True
                self.alarm.say(
                    f"{view.state.upper()} – {view.trip or view.error or view.name}. Look first, then reset."
                )

    def _show_controls(self) -> None:
        self.controls.show_view(self.views.get(self.current), ready=self.ready)

    # The bench --------------------------------------------------------------------------------------------------------

    def _connect_bench(self) -> None:
        self.client = Client(self.bench, self)
        self.client.ready.connect(self._show_ready)
        self.client.views.connect(self._show_views)
        self.client.finished.connect(self._finished)
        self.client.lost.connect(self._lost)

    def _show_ready(self, ready: Ready) -> None:
        self.views.clear()
        self.instruments.show_bench(ready.station, ready.instruments)
        for old in self._drawn.values():
            self.measure.removeWidget(old)
            old.deleteLater()
        self._drawn = {info.name: MeasurePanel(info) for info in ready.instruments}
        for name, panel in self._drawn.items():
            self.measure.addWidget(panel)
            if panel.camera is not None:
                panel.camera.threshold.connect(lambda gvt, name=name: self._ask("threshold", name, gvt=gvt))
        self.client.ask("protocols", answer=self._show_protocols)

    def _show_protocols(self, reply: Reply) -> None:
        self._entries = reply.value or ()
        if self.instruments.rows:
            names = list(self.instruments.rows)
            self.instruments.choose(self.kept.instrument if self.kept.instrument in names else names[0])

    def _choose_instrument(self, name: str) -> None:
        kind = self.instruments.rows[name].info.kind
        self.kept.instrument = name
        self.measure.setCurrentWidget(self._drawn[name])
        self.prepare.show_entries(self._entries, kind, self.kept.protocols.get(kind, ""))
        self._show_controls()

    def _change_station(self, simulated: bool) -> None:
        """Another bench: another worker."""
        path = ""
        if not simulated:
            path = self._file("Station file", "Station (*.yaml *.yml)")
            if not path:
                return
        if self.live:
            self.statusBar().showMessage("Stop the run before changing the bench.", 8000)
            return
        self.kept.station = path
        self.bench = replace(self.bench, station=Path(path) if path else None)
        self.client.close()
        self._connect_bench()

    def _lost(self, why: str) -> None:
        self._asked_to_run.clear()
        self.latched = True
        self.alarm.say(f"{why[0].upper()}{why[1:]}.", "Start it again")

    # Runs -------------------------------------------------------------------------------------------------------------

    def _preview(self) -> None:
        path = self.prepare.chosen
        self._show_controls()
        if not path or not self.current:
            return
        kind = self.instruments.rows[self.current].info.kind
        self.kept.protocols[kind] = path

        def show(reply: Reply) -> None:
            if self.prepare.chosen != path:
                return  # another one was chosen meanwhile
            if reply.error:
                self.prepare.show_faults(Path(path), reply.error, reply.faults)
            else:
                self.prepare.show_preview(reply.value)
            self._count()

        self.client.ask("preview", self.current, show, path=path, subject=self.subject.who()["subject"])

    def _count(self, ended: Measurement | None = None) -> None:
        """Count the repeats of what would be measured now; ``ended`` is what was measured last."""
        if self.prepare.preview is not None:
            what = self.subject.what(self.prepare.preview.name)
            self.subject.count(what, self.recordings.next_repeat(what), anew=what == ended)
        self._show_controls()

    def start(self) -> None:
        """Arm and start the chosen protocol on the chosen instrument."""
        if not self.ready:
            return
        panel = self._drawn[self.current]
        panel.expect(self.prepare.preview)
        name = self.current
        self._asked_to_run.add(name)
        self.tabs.setCurrentWidget(self.measure)
        gvt = {"gvt": panel.camera.gvt} if panel.camera is not None else {}

        def started(reply: Reply) -> None:
            if reply.error:
                self._asked_to_run.discard(name)  # else not before a view: no moment without the emergency stop's key
            self._tell(reply)

        self.client.ask("run", name, started, protocol=self.prepare.chosen, **self.subject.who(), **gvt)

    def emergency_stop(self) -> None:
        """Vent everything, by a pipe that carries nothing else; latched until `reset`."""
        self.client.stop()
        self.latched = True
        self._resetting.clear()
        self.alarm.say("EMERGENCY STOP – everything vents. Look first, then reset.")
        self._show_controls()

    def reset(self) -> None:
        """A person looked: acknowledge what stopped the instruments and open their links anew."""
        self.latched = False
        self.alarm.hide()
        if not self.client.alive:
            self.client.close()
            self._connect_bench()
            return
        stopped = [name for name, view in self.views.items() if view.state in NEEDS_RESET]
        self._resetting = set(stopped)

        def done(name: str, reply: Reply) -> None:
            self._resetting.discard(name)
            self._tell(reply)

        for name in stopped:
            self.client.ask("reset", name, partial(done, name))

    def _finished(self, finished: Finished) -> None:
        self._asked_to_run.discard(finished.instrument)
        self.recordings.finish(finished)
        self._count(ended=finished.what)

    def _ask(self, action: str, name: str, **arguments: object) -> None:
        self.client.ask(action, name, self._tell, **arguments)

    def _tell(self, reply: Reply) -> None:
        if reply.error:
            self._say(reply.error)

    def _say(self, text: str) -> None:
        self.statusBar().showMessage(text, 20000)

    # Dialogs ----------------------------------------------------------------------------------------------------------

    def _file(self, title: str, kinds: str) -> str:
        # Qt's own dialog: a system's would not let the emergency stop's key and button in.
        option = QFileDialog.Option.DontUseNativeDialog
        return QFileDialog.getOpenFileName(self, title, "", kinds, options=option)[0]

    def _open_protocol(self) -> None:
        if path := self._file("Protocol", "Protocols (*.yaml *.yml)"):
            kind = self.instruments.rows[self.current].info.kind if self.current else ""
            self._entries = (*self._entries, ProtocolEntry(Path(path).stem, "from a file", kind, Path(path)))
            self.prepare.show_entries(self._entries, kind, path)

    def _change_folder(self) -> None:
        if self.live:
            return
        option = QFileDialog.Option.DontUseNativeDialog
        if path := QFileDialog.getExistingDirectory(self, "Folder for recordings", str(self.bench.out), option):
            self.kept.out = path
            self.bench = replace(self.bench, out=Path(path))
            self.client.close()
            self._connect_bench()
            self.recordings.open_folder(self.bench.out)

    def _other_theme(self) -> None:
        self.kept.theme = "light" if theme.current() is theme.DARK else "dark"
        self.statusBar().showMessage(f"{self.kept.theme.capitalize()} from the next start.", 8000)

    def closeEvent(self, event: QCloseEvent) -> None:
        """Qt's hook: a run that goes on is stopped and vented before the window closes, after asking."""
        if self.live:
            question = QMessageBox(self)
            question.setWindowTitle("A run is going on")
            question.setText("Stop the run, vent, and close the window?")
            question.setStandardButtons(QMessageBox.StandardButton.Close | QMessageBox.StandardButton.Cancel)
            if question.exec() != QMessageBox.StandardButton.Close:
                event.ignore()
                return
        self.shut()
        event.accept()

    def shut(self) -> None:
        """Vent, end every process, remember the settings. Idempotent."""
        self._timer.stop()
        self.estop.remove()
        self.client.close()
        self.recordings.close()
        self.kept.operator = self.subject.operator.text()
        self.kept.geometry = self.saveGeometry()
        settings.save(self.store, self.kept)
