"""The main window: it carries a person's wishes to the worker and shows the answers on its panels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QSettings, Qt, QTimer
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QApplication

from acquire.gui import dialogs, settings, theme
from acquire.gui.client import Client
from acquire.gui.estop import EmergencyStop
from acquire.gui.latches import Latches
from acquire.gui.layout import Layout
from acquire.gui.messages import (
    FROM_FILE,
    LIVE,
    BenchSettings,
    Finished,
    Measurement,
    ProtocolEntry,
    Ready,
    Reply,
    View,
)
from acquire.gui.panels.controls import STARTABLE
from acquire.gui.panels.measure import MeasurePanel

FRAME = 33  # ms between two turns of the one timer
CLOSED = ("idle", "connecting")  # states in which an emergency stop may find nothing to stop


class MainWindow(Layout):
    """The operator's window on one bench.

    ``store`` is where settings are kept (the user's own by default).
    """

    def __init__(self, bench: BenchSettings, store: QSettings | None = None) -> None:
        super().__init__(bench)
        self.store = store or QSettings(settings.ORGANISATION, settings.APPLICATION)
        self.kept = settings.load(self.store)
        self.bench = bench
        self.latches = Latches()
        self.views: dict[str, View] = {}
        self._gone = ""  # why the worker is not there, if it is not
        self._asked_to_run: set[str] = set()  # instruments between START and the first view of the run
        self._acting = ""  # the instrument that the bar names: PAUSE, RESUME and STOP are for it
        self._entries: tuple[ProtocolEntry, ...] = ()
        self._drawn: dict[str, MeasurePanel] = {}
        self.restoreGeometry(self.kept.geometry)
        self.subject.operator.setText(self.kept.operator)
        self._wire()
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

    def _wire(self) -> None:
        self.instruments.chosen.connect(self._choose_instrument)
        self.instruments.wanted.connect(self._act)
        self.instruments.station_wanted.connect(self._change_station)
        self.subject.changed.connect(lambda: self._count())
        self.subject.settled.connect(self._preview)
        self.prepare.wanted.connect(lambda path: self._preview())
        self.prepare.open_wanted.connect(self._open_protocol)
        self.controls.start.connect(self.start)
        self.controls.pause.connect(lambda: self._ask("pause", self._acting))
        self.controls.resume.connect(lambda: self._ask("resume", self._acting))
        self.controls.halt.connect(lambda: self._ask("abort", self._acting))
        self.controls.estop.connect(self.emergency_stop)
        self.alarm.accepted.connect(self.reset)
        self.dark_action.triggered.connect(self._other_theme)
        self.recordings.browser.folder_wanted.connect(self._change_folder)
        self.recordings.read.connect(lambda: self._count())
        self.recordings.said.connect(self._say)
        self.recordings.page_wanted.connect(self.tabs.setCurrentWidget)
        self.recordings.result_ready.connect(lambda page: None if self.live else self.tabs.setCurrentWidget(page))

    # Progress --------------------------------------------------------------------------------------------------------

    @property
    def current(self) -> str:
        """Name of the chosen instrument."""
        return self.instruments.current

    @property
    def running(self) -> tuple[str, ...]:
        """Names of the instruments that act on a person, or may begin to at any moment."""
        live = {name for name, view in self.views.items() if view.state in LIVE} | self._asked_to_run
        return tuple(sorted(live))

    @property
    def live(self) -> bool:
        """Whether an instrument acts on a person, or may begin to at any moment, or nobody knows."""
        unknown = bool(self._gone) and self.client.process.is_alive()  # it hangs, and may go on
        return unknown or bool(self.running)

    @property
    def latched(self) -> bool:
        """Whether anything is stopped until a person resets it."""
        return bool(self._gone or self.latches.stopped)

    @property
    def ready(self) -> bool:
        """Whether START may be pressed, as far as the window knows."""
        return not self.missing

    @property
    def missing(self) -> str:
        """The next thing to do before START, in words; '' where there is none."""
        preview, row = self.prepare.preview, self.instruments.rows.get(self.current)
        if self._gone or row is None:
            return "connect an instrument"
        if self.latches.holds(self.current):
            return "reset the instrument"
        if self.current in self._asked_to_run:
            return "starting"
        if preview is None or preview.instrument != row.info.kind:
            return "choose a protocol"
        if not self.subject.sound:
            return "write a pseudonym"
        return "" if self.recordings.listed else "reading the folder …"

    def tick(self) -> None:
        """One turn of the timer: liveness, news, painting."""
        self.client.poll()
        for panel in self._drawn.values():
            panel.tick()
        self.recordings.tick()
        self.live_fit.tick()
        self.health.count_frame()

    def _show_views(self, views: tuple[View, ...]) -> None:
        for view in views:
            self.views[view.name] = view
            self.latches.see(view)
            if view.state in LIVE:
                self._asked_to_run.discard(view.name)
            panel = self._drawn.get(view.name)
            if panel is not None:
                panel.show_view(view, self.measure.currentWidget() is panel and panel.isVisible())
            self.live_fit.show_view(view)
        self.instruments.show_views(views)
        self._show_controls()
        self.health.show_view(self.views.get(self._acting))

    def _act_on(self) -> str:
        """The bar's instrument: one that runs, whichever is chosen; the chosen one where that runs, or none does."""
        running = self.running
        return next((name for name in (self.current, self._acting, *running) if name in running), self.current)

    def _show_controls(self) -> None:
        rows = self.instruments.rows
        row = rows.get(self.current)
        self._acting = self._act_on()
        view = self.views.get(self._acting)
        if view is not None and self._acting in self._asked_to_run:
            view = replace(view, state="armed")  # asked for, and not told yet
        shown = rows[self._acting].info.label if self._acting in rows else ""
        chosen = self.views.get(self.current)
        self.controls.show_view(
            view,
            shown,
            missing=self.missing,
            fault=self._gone,
            startable=chosen is not None and chosen.state in STARTABLE and not self.missing,
            beside=row.info.label if row is not None and self.current != self._acting else "",
            also=[rows[name].info.label for name in self.running if name != self._acting and name in rows],
        )
        self.live_fit.offer(self.current, row.info.kind if row is not None else "", self.prepare.preview)
        several = len(self.latches.stopped) > 1
        if self._gone:
            self.alarm.say(self._gone, "Start it again")
        elif self.latched:
            self.alarm.say(self.latches.words(), "Reset all" if several else "Reset")
        else:
            self.alarm.hide()

    # The bench --------------------------------------------------------------------------------------------------------

    def _connect_bench(self) -> None:
        """Start a worker on the bench as it is set now; nothing of another one is left."""
        self._gone = ""
        self._forget()
        self.instruments.show_bench("starting …", ())
        for panel in self._drawn.values():
            self.measure.removeWidget(panel)
            panel.deleteLater()
        self._drawn = {}
        self.client = Client(self.bench, self)
        self.client.ready.connect(self._show_ready)
        self.client.refused.connect(self._refused)
        self.client.views.connect(self._show_views)
        self.client.finished.connect(self._finished)
        self.client.lost.connect(self._lost)

    def _show_ready(self, ready: Ready) -> None:
        self.instruments.show_bench(ready.station, ready.instruments)
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
        if self.live:
            self._say("Stop the run before changing the bench.")
            return
        path = "" if simulated else dialogs.ask_file(self, "Station file", "Station (*.yaml *.yml)")
        if path or simulated:
            self.kept.station = path
            self.bench = self.qualify.bench = replace(self.bench, station=Path(path) if path else None)
            self.client.close()
            self._connect_bench()

    def _refused(self, fault: str) -> None:
        """The station file cannot be used; the window never opens another bench in its place by itself."""
        self.instruments.show_refusal(fault)
        dialogs.refuse(self, "This station cannot be used", f"{fault}\n\nNo instrument is open. Choose another bench.")

    def _forget(self) -> None:
        """Nothing is known of any instrument any more."""
        self.views.clear()
        self.latches.clear()
        self._asked_to_run.clear()
        self.health.show_view(None)

    def _lost(self, why: str) -> None:
        """The worker is gone: whatever is on the screen is of the past, and looks so."""
        self._gone = f"{why[0].upper()}{why[1:]}."
        self._forget()
        self.instruments.show_lost()
        self._show_controls()

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
        """Count the repeats of the chosen measurement; ``ended`` is the one that ended last."""
        if self.prepare.preview is not None:
            what = self.subject.what(self.prepare.preview.name)
            self.subject.count(what, self.recordings.next_repeat(what), anew=what == ended)
        self._show_controls()

    def start(self) -> None:
        """Arm and start the chosen protocol on the chosen instrument."""
        if not self.ready:
            return
        others = [self.instruments.rows[name].info.label for name in self.running if name != self.current]
        label = self.instruments.rows[self.current].info.label
        if others and not (dialogs.may_start_beside(self, label, others) and self.ready):
            return
        panel = self._drawn[self.current]
        panel.expect(self.prepare.preview)
        name = self.current
        self._asked_to_run.add(name)
        self._show_controls()
        self.tabs.setCurrentWidget(self.measure)
        gvt = {"gvt": panel.camera.gvt} if panel.camera is not None else {}

        def started(reply: Reply) -> None:
            if reply.error:
                self._asked_to_run.discard(name)  # else not before a view: no moment without the emergency stop's key
            self._tell(reply)

        self.client.ask("run", name, started, protocol=self.prepare.chosen, **self.subject.who(), **gvt)

    def emergency_stop(self) -> None:
        """Vent everything, by a pipe that carries nothing else; each instrument is latched until it is reset."""
        self.client.stop()
        opened = [name for name, view in self.views.items() if view.state not in CLOSED]
        self.latches.stop(opened)
        if not opened:
            self._say("Emergency stop: no instrument is connected.")
        self._show_controls()

    def reset(self) -> None:
        """A person looked: acknowledge every stop and open the links anew, or start another worker."""
        if self._gone:
            alive, self._gone = self.client.alive, ""
            if not alive:
                self.client.close()
                self._connect_bench()
        for name in self.latches.stopped:
            self._act("reset", name)
        self._show_controls()

    def _act(self, action: str, name: str) -> None:
        """The request of an instrument's own button; a reset is the same whichever button asks for it."""
        if action != "reset":
            self._ask(action, name)
            return

        def done(reply: Reply) -> None:
            self.latches.answered(name)
            self._tell(reply)

        self.latches.reset(name)
        self.client.ask("reset", name, done)
        self._show_controls()

    def _finished(self, finished: Finished) -> None:
        self._asked_to_run.discard(finished.instrument)
        self.recordings.finish(finished)
        self._count(ended=finished.what)

    def _ask(self, action: str, name: str, **arguments: object) -> None:
        self.client.ask(action, name, self._tell, **arguments)

    def _tell(self, reply: Reply) -> None:
        if reply.error:
            self._say(reply.error)

    # Small things -----------------------------------------------------------------------------------------------------

    def _open_protocol(self) -> None:
        if path := dialogs.ask_file(self, "Protocol", "Protocols (*.yaml *.yml)"):
            kind = self.instruments.rows[self.current].info.kind if self.current else ""
            others = tuple(entry for entry in self._entries if entry.path != Path(path))  # the same file once
            self._entries = (*others, ProtocolEntry(Path(path).stem, FROM_FILE, kind, Path(path)))
            self.prepare.show_entries(self._entries, kind, path)

    def _change_folder(self) -> None:
        if self.live:
            self._say("Stop the run before changing the folder.")
            return
        if path := dialogs.ask_folder(self, "Folder for recordings", self.bench.out):
            self.kept.out = path
            self.bench = self.qualify.bench = replace(self.bench, out=Path(path))
            self.client.close()
            self._connect_bench()
            self.recordings.open_folder(self.bench.out)

    def _other_theme(self) -> None:
        self.kept.theme = "light" if theme.current() is theme.DARK else "dark"
        self._say(f"{self.kept.theme.capitalize()} from the next start.", 8.0)

    def closeEvent(self, event: QCloseEvent) -> None:
        """Qt's hook: a run that goes on is stopped and vented before the window closes, after asking."""
        if self.live and not dialogs.may_close(self):
            event.ignore()
            return
        self.shut()
        event.accept()

    def shut(self) -> None:
        """Vent, end every process, remember the settings. Idempotent."""
        self._timer.stop()
        self.estop.remove()
        self.client.close()
        self._forget()  # nothing runs any more, and nobody is to be asked about it
        self.recordings.close()
        self.qualify.close_tool()
        self.live_fit.close_tool()
        self.kept.operator = self.subject.operator.text()
        self.kept.geometry = self.saveGeometry()
        settings.save(self.store, self.kept)
