"""Each hazard's test fails when its control is removed: ``python -m benchmarks.faults.mutations [H03 H09] [--docs]``.

One control after the other is taken out of the program (patched, in a process of its own), and a test that
docs/safety.md names for the hazard is run: it has to fail. The table says which, and the exit status is 1 if one does
not notice. ``--docs`` puts the table, if it is of all hazards, into docs/safety.md.
"""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Which control is to be removed in this process; set for the process that runs the test.
VARIABLE = "REMOVED_CONTROL"
ENGINE, PARTS = "tests/acquire/engine/test_engine.py", "tests/acquire/engine/test_parts.py"
SAFETY, CONFORMANCE = "tests/acquire/session/test_safety.py", "tests/conformance/test_conformance.py"
RUN, RIGS = "tests/acquire/cli/test_run.py", "tests/drivers/test_rigs.py"
DOCS = Path(__file__).parents[2] / "docs/safety.md"


@dataclass(frozen=True)
class Removal:
    """``module:attribute`` of each control becomes something that controls nothing; ``test`` has to fail then.

    That is ``does``, or what ``instead`` makes of the control.
    """

    control: str
    test: str
    patched: tuple[str, ...]
    does: Callable[..., Any] = lambda *args, **kwargs: None
    instead: Callable[[Any], Any] | None = None


def _yes(*args: object, **kwargs: object) -> bool:
    return True


def _no(*args: object, **kwargs: object) -> bool:
    return False


def _nothing(*args: object, **kwargs: object) -> str:
    return ""


def _empty(*args: object, **kwargs: object) -> tuple[()]:
    return ()


def _float(text: str) -> float:
    return float(text)


def _beat(firmware: Any, count: int, wall: float) -> None:
    """Any beat is a sign of life."""
    firmware._last_beat = wall


def _start_after_a_trip(transitions: dict[str, Any]) -> dict[str, Any]:
    """A table of states in which a trip does not latch."""
    from acquire.engine import State

    return {**transitions, "start": {**transitions["start"], State.TRIPPED: State.RUNNING}}


def _one_by_one(opens: Callable[..., Any]) -> Callable[..., Any]:
    """An instrument is opened when the one before has answered."""
    turn = threading.Lock()

    def opened(*args: Any, **kwargs: Any) -> Any:
        with turn:
            return opens(*args, **kwargs)

    return opened


WATCHDOG = "sim_devices.servers.firmware:Firmware.watch_host"
VALUES = "acquire.engine.checks:Values.look"
REMOVALS = {
    "H01": Removal(
        "limits are checked when arming",
        f"{ENGINE}::test_nothing_is_armed_without_sound_limits",
        ("protocols.limits:Limits.violations",),
        _empty,
    ),
    "H02": Removal(
        "the instrument looks at what it is sent",
        f"{CONFORMANCE}::test_refuses_what_is_out_of_limits",
        ("sim_devices.servers.firmware:Firmware._check",),
    ),
    "H03": Removal("trip on a value", f"{ENGINE}::test_a_trip_vents_latches_and_needs_a_reset", (VALUES,)),
    "H04": Removal("trip on a rate", f"{ENGINE}::test_a_rate_trips", ("acquire.engine.checks:Rates.look",)),
    "H05": Removal("trip on NaN", f"{SAFETY}::test_a_tripped_limit", (VALUES,)),
    "H06": Removal(
        "trip on tracking",
        f"{ENGINE}::test_a_trip_vents_latches_and_needs_a_reset",
        ("acquire.engine.checks:Following.look",),
    ),
    "H07": Removal("the instrument's watchdog", f"{SAFETY}::test_a_pulled_cable", (WATCHDOG,), _no),
    "H08": Removal(
        "a lost link is opened anew",
        "tests/acquire/engine/test_absence.py::test_it_is_tried_again_until_it_is_back",
        ("acquire.engine.connection:Connection._look_for_links",),
    ),
    "H09": Removal("the instrument's watchdog", f"{SAFETY}::test_a_link_that_falls_silent", (WATCHDOG,), _no),
    "H10": Removal(
        "only new samples count",
        "tests/acquire/session/test_stale_and_dwell.py::test_a_device_that_repeats_itself_is_vented",
        ("acquire.engine.freshness:Freshness.fault",),
    ),
    "H11": Removal(
        "beats are counted",
        f"{CONFORMANCE}::test_a_beat_that_is_repeated_is_no_beat",
        ("sim_devices.servers.firmware:Firmware.beat",),
        _beat,
    ),
    "H12": Removal(
        "requests are numbered",
        f"{CONFORMANCE}::test_an_old_command_that_comes_again_is_not_obeyed",
        ("sim_devices.servers.ports:ControlPort.outdated",),
        _no,
    ),
    "H13": Removal(
        "time under load is bounded",
        f"{PARTS}::test_too_long_away_from_rest_trips",
        ("acquire.engine.checks:Dwells.look",),
    ),
    "H14": Removal(
        "an empty queue vents",
        f"{CONFORMANCE}::test_an_empty_queue_vents",
        ("sim_devices.servers.firmware:Firmware._watch_queue",),
    ),
    "H15": Removal(
        "bounds of safety parameters",
        "tests/acquire/session/test_station.py::test_a_safety_parameter_out_of_bounds_is_refused",
        (
            "acquire.engine.rules:Rules.__post_init__",
            "acquire.engine.rules:check_tracking",
            "drivers.instrument:Entry.__post_init__",
        ),
    ),
    "H16": Removal("the instrument's watchdog", f"{SAFETY}::test_a_frozen_engine", (WATCHDOG,), _no),
    "H17": Removal("the instrument's watchdog", f"{SAFETY}::test_a_window_that_no_longer_answers", (WATCHDOG,), _no),
    "H18": Removal(
        "the stop's filter on all keys",
        "tests/acquire/gui/test_safety.py::test_the_key_works_while_a_modal_dialog_is_open",
        ("acquire.gui.estop:EmergencyStop.eventFilter",),
        _no,
    ),
    "H19": Removal("the instrument's watchdog", f"{SAFETY}::test_a_killed_host", (WATCHDOG,), _no),
    "H20": Removal(
        "the engine looks for its supervisor, the instrument's watchdog",
        f"{SAFETY}::test_a_dead_supervisor",
        ("acquire.supervisor:Supervisor.alive", WATCHDOG),
        _yes,
    ),
    "H21": Removal(
        "an exception ends the run",
        f"{ENGINE}::test_an_exception_inside_the_engine_fails_safely",
        ("acquire.engine.engine:RunEngine._broken",),
    ),
    "H22": Removal("abort", f"{SAFETY}::test_abort", ("acquire.engine.engine:RunEngine.abort",)),
    "H23": Removal(
        "connecting makes safe, or refuses",
        "tests/acquire/engine/test_stops.py::test_what_a_crashed_host_left_is_made_safe_and_told",
        ("acquire.engine.link:LinkThread._settle",),
    ),
    "H24": Removal(
        "a stop voids what waits",
        f"{PARTS}::test_a_stop_overtakes_what_is_queued",
        ("acquire.engine.requests:Requests.void",),
    ),
    "H25": Removal(
        "a kept stop is looked for",
        f"{SAFETY}::test_an_emergency_stop_outlives_its_program_until_a_person_acknowledges_it",
        ("acquire.latches:check",),
    ),
    "H26": Removal(
        "instruments are opened independently",
        f"{SAFETY}::test_an_instrument_that_does_not_answer_keeps_no_other_waiting",
        ("acquire.session:Session.open",),
        instead=_one_by_one,
    ),
    "H27": Removal(
        "a trip latches",
        f"{ENGINE}::test_a_trip_vents_latches_and_needs_a_reset",
        ("acquire.engine.state:TRANSITIONS",),
        instead=_start_after_a_trip,
    ),
    "H28": Removal(
        "a pause vents",
        f"{ENGINE}::test_pause_vents_and_resume_repeats_the_segment",
        ("acquire.engine.active:ActiveRun.hold",),
    ),
    "H29": Removal(
        "a real port needs the station's word",
        f"{RIGS}::test_a_real_port_is_refused_unless_the_station_vouches",
        ("drivers.cutometer:permit", "drivers.aspiration:permit", "drivers.microrobot:permit"),
    ),
    "H30": Removal(
        "hooks hear of ends, trips and stalls",
        "tests/acquire/session/test_attendant.py::test_an_end_is_told_with_the_recording",
        ("acquire.attendant:Attendant._notice",),
    ),
    "H31": Removal(
        "links are claimed",
        f"{RUN}::test_an_instrument_that_another_program_drives_is_refused_by_name",
        ("drivers.claims:Claim.__init__", "drivers.claims:Claim.release"),
    ),
    "H32": Removal(
        "time between two turns",
        "tests/acquire/engine/test_stops.py::test_a_computer_that_was_suspended_trips",
        ("acquire.engine.host_clock:HostClock.fault",),
        _nothing,
    ),
    "H33": Removal(
        "an address is a plain one",
        f"{RIGS}::test_no_rig_takes_pyserial_s_urls",
        ("drivers.transports:_SERIAL",),
        instead=lambda pattern: re.compile(".+"),
    ),
    "H34": Removal(
        "free space is watched",
        f"{ENGINE}::test_a_full_disk_trips_and_then_forbids_arming",
        ("acquire.engine.interlock:Interlock.short_of_space",),
        _nothing,
    ),
    "H35": Removal(
        "the instrument's own word",
        f"{ENGINE}::test_a_trip_vents_latches_and_needs_a_reset",
        ("acquire.engine.interlock:Interlock._check_status",),
    ),
    "H36": Removal(
        "readings are asked to be plausible",
        "tests/acquire/engine/test_plausibility.py::test_a_gauge_that_fails_in_a_hold_trips",
        ("acquire.engine.plausibility:Frozen.look", "acquire.engine.plausibility:Jumps.look"),
    ),
    "H37": Removal(
        "journals are locked",
        "tests/acquire/recording/test_live_journal.py::test_a_running_run_is_not_recovered",
        ("acquire.recording.journal:lock",),
        _yes,
    ),
    "H38": Removal(
        "texts are checked before anybody is touched",
        "tests/acquire/engine/test_recorder.py::test_what_cannot_be_recorded_is_refused_before_anybody_is_touched",
        ("acquire.engine.plan:check_identity",),
    ),
    "H39": Removal(
        "one spelling of numbers",
        "tests/test_hostile_files.py::test_a_number_is_what_everybody_reads",
        ("acquire.recording.tables:number",),
        _float,
    ),
    "H40": Removal(
        "files are their owner's",
        "tests/acquire/recording/test_live_journal.py::test_subjects_are_private",
        ("acquire.recording.journal:PRIVATE",),
        instead=lambda mode: 0o644,
    ),
}


def remove(removal: Removal) -> None:
    """Take a control out of this process. Raises AttributeError when it is not there any more."""
    for place in removal.patched:
        module, _, path = place.partition(":")
        owner: Any = importlib.import_module(module)
        *owners, name = path.split(".")
        for part in owners:
            owner = getattr(owner, part)
        control = getattr(owner, name)
        # A function of ours in a class becomes its method, as what it replaces was.
        setattr(owner, name, removal.instead(control) if removal.instead else removal.does)


def pytest_configure() -> None:
    """As a plugin of pytest: remove the control that the environment names."""
    if hazard := os.environ.get(VARIABLE):
        remove(REMOVALS[hazard])


def noticed(hazard: str) -> str:
    """'yes' when the hazard's test fails without its control; else why not, in words."""
    plugins = ("-p", "benchmarks.faults.mutations", "-p", "no:cacheprovider", "--reruns", "0", "--timeout", "60")
    command = [sys.executable, "-m", "pytest", "-x", "-q", *plugins, REMOVALS[hazard].test]
    environment = os.environ | {VARIABLE: hazard}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode == 1 and "FAILED" in done.stdout:
        return "yes"
    return f"NO (status {done.returncode}: {done.stdout.strip()[-200:]})"


def line(hazard: str, verdict: str) -> str:
    """One line of the table."""
    removal = REMOVALS[hazard]
    return f"| {hazard} | {removal.control} | `{removal.test.rpartition('::')[2]}` | {verdict} |"


def main(arguments: list[str]) -> int:
    """Print the table; exit status."""
    hazards = [hazard for hazard in arguments if hazard != "--docs"] or list(REMOVALS)
    lines = ["| hazard | control removed | its test | fails without it |", "|---|---|---|---|"]
    print("\n".join(lines))
    for hazard in hazards:
        began = time.monotonic()
        lines.append(line(hazard, noticed(hazard)))
        print(lines[-1], f"{time.monotonic() - began:.0f} s", flush=True)
    if "--docs" in arguments and hazards == list(REMOVALS):
        text = DOCS.read_text(encoding="utf-8")
        table = re.compile(re.escape(lines[0]) + r"\n(\|.*\n)+")
        DOCS.write_text(table.sub(lambda match: "\n".join(lines) + "\n", text), encoding="utf-8")
    return int(any(not line.endswith("| yes |") for line in lines[2:]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
