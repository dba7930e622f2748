"""Each hazard's test fails when its control is removed: ``python -m benchmarks.faults.mutations [H03 H09]``.

One control after the other is taken out of the program (patched, in a process of its own), and a test that
docs/safety.md names for the hazard is run: it has to fail. The table says which, and the exit status is 1 if one does
not notice.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

#: Which control is to be removed in this process; set for the process that runs the test.
VARIABLE = "REMOVED_CONTROL"
ENGINE, PARTS = "tests/acquire/engine/test_engine.py", "tests/acquire/engine/test_parts.py"
SAFETY, CONFORMANCE = "tests/acquire/session/test_safety.py", "tests/conformance/test_conformance.py"
RUN, RIGS = "tests/acquire/cli/test_run.py", "tests/drivers/test_rigs.py"


@dataclass(frozen=True)
class Removal:
    """``module:attribute`` of each control becomes something that controls nothing; ``test`` has to fail then."""

    control: str
    test: str
    patched: tuple[str, ...]
    does: Callable[..., Any] = lambda *args, **kwargs: None


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


WATCHDOG = "sim_devices.servers.firmware:Firmware.watch_host"
VALUES = "acquire.engine.checks:Values.look"
REMOVALS = {
    "H01": Removal(
        "limits are checked when arming",
        f"{ENGINE}::test_nothing_is_armed_without_sound_limits",
        ("protocols.limits:Limits.violations",),
        _empty,
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
    "H19": Removal("the instrument's watchdog", f"{SAFETY}::test_a_killed_host", (WATCHDOG,), _no),
    "H22": Removal("abort", f"{SAFETY}::test_abort", ("acquire.engine.engine:RunEngine.abort",)),
    "H29": Removal(
        "a real port needs the station's word",
        f"{RIGS}::test_a_real_port_is_refused_unless_the_station_vouches",
        ("drivers.cutometer:permit", "drivers.aspiration:permit", "drivers.microrobot:permit"),
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
}


def remove(hazard: str) -> None:
    """Take the control of a hazard out of this process. Raises AttributeError when it is not there any more."""
    for place in REMOVALS[hazard].patched:
        module, _, path = place.partition(":")
        owner: Any = importlib.import_module(module)
        *owners, name = path.split(".")
        for part in owners:
            owner = getattr(owner, part)
        getattr(owner, name)
        does = REMOVALS[hazard].does
        # A function of ours in a class becomes its method, as what it replaces was.
        setattr(owner, name, does)


def pytest_configure() -> None:
    """As a plugin of pytest: remove the control that the environment names."""
    if hazard := os.environ.get(VARIABLE):
        remove(hazard)


def main(arguments: list[str]) -> int:
    """Print the table; exit status."""
    unnoticed = 0
    print("| hazard | control removed | test | noticed |\n|---|---|---|---|")
    for hazard in arguments or REMOVALS:
        removal = REMOVALS[hazard]
        began = time.monotonic()
        plugins = ("-p", "benchmarks.faults.mutations", "-p", "no:cacheprovider", "--reruns", "0")
        command = [sys.executable, "-m", "pytest", "-x", "-q", *plugins, removal.test]
        environment = os.environ | {VARIABLE: hazard}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        failed = done.returncode == 1 and "FAILED" in done.stdout
        unnoticed += not failed
        verdict = "yes" if failed else f"NO (status {done.returncode}: {done.stdout.strip()[-200:]})"
        name = removal.test.rpartition("::")[2]
        print(f"| {hazard} | {removal.control} | `{name}` | {verdict}, {time.monotonic() - began:.0f} s |", flush=True)
    return int(unnoticed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
