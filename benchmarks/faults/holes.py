"""Each hole that an outside campaign found in revision 193e721 has a test that fails there:
``python -m benchmarks.faults.holes [REVISION]``.

Today's tests are run on the sources of that revision (a worktree of its own, which is removed afterwards). The exit
status is 1 if a hole's tests all pass there. docs/safety.md has the table.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
GUI, OWN = "tests/acquire/gui", "tests/test_holes.py"
#: Number -> the fault, and the tests that show it.
HOLES: dict[int, tuple[str, tuple[str, ...]]] = {
    1: ("a packet repeated for ever trips nothing", (f"{OWN}::test_hole_01_a_link_that_says_the_same_for_ever",)),
    2: ("recovery of a running run destroys it", (f"{OWN}::test_hole_02_a_running_run_is_recovered",)),
    3: (
        "completed without a recording",
        (
            f"{OWN}::test_hole_03_what_cannot_be_recorded_is_run",
            f"{OWN}::test_hole_03_a_run_whose_journal_is_gone_has_not_completed",
        ),
    ),
    4: ("a watchdog without an upper bound", (f"{OWN}::test_hole_04_a_station_without_a_watchdog",)),
    5: ("a real port that is called simulated", (f"{OWN}::test_hole_05_a_real_port_that_is_called_simulated",)),
    6: ("a stop between arm and start is an exception", (f"{OWN}::test_hole_06_a_stop_between_arm_and_start",)),
    7: ("blocks that come twice are recorded twice", (f"{OWN}::test_hole_07_blocks_that_come_twice",)),
    8: ("the run after a crash is refused", (f"{OWN}::test_hole_08_the_next_run_after_a_crash",)),
    9: (
        "a frozen gauge is not noticed, a spike trips",
        (f"{OWN}::test_hole_09_a_channel_that_is_frozen_in_a_hold", f"{OWN}::test_hole_09_a_single_spike_trips"),
    ),
    10: (
        "one instrument blocks others; a faulty station opens another bench",
        (
            f"{GUI}/test_bench.py::test_an_instrument_that_cannot_be_reached_keeps_no_other_waiting",
            f"{GUI}/test_bench.py::test_a_faulty_station_is_refused_and_nothing_opens_in_its_place",
        ),
    ),
    11: (
        "a threshold moved in a run is not the file's",
        (f"{GUI}/test_runs.py::test_the_threshold_that_is_shown_is_the_recording_s",),
    ),
    12: (
        "repeats are counted for the selected row",
        (
            f"{GUI}/test_record.py::test_the_finished_run_counts_not_the_selected_row",
            f"{GUI}/test_record.py::test_repeats_are_counted_from_the_folder",
        ),
    ),
    13: (
        "the browser's selection goes by row number",
        (f"{GUI}/test_record.py::test_the_chosen_files_stay_chosen_when_the_list_moves",),
    ),
    14: (
        "stopped and tripped runs count",
        (f"{GUI}/test_record.py::test_stopped_tripped_and_paused_runs_do_not_count_until_a_person_says_so",),
    ),
    15: (
        "one alarm for all; it survives its station; a dead worker looks alive",
        (
            f"{GUI}/test_bench.py::test_one_latch_for_each_instrument_whichever_button_resets_it",
            f"{GUI}/test_bench.py::test_an_alarm_does_not_survive_its_station",
            f"{GUI}/test_bench.py::test_after_the_worker_died_nothing_looks_alive",
        ),
    ),
    16: (
        "a falling edge is a saw-tooth; pseudonyms are paths",
        (
            f"{GUI}/test_thinning.py::test_a_falling_edge_falls_and_a_rising_one_rises",
            f"{GUI}/test_record.py::test_a_pseudonym_is_no_path_and_no_name",
        ),
    ),
}
#: Options of pytest that do not depend on what a revision's pyproject.toml says.
OPTIONS = (
    *("-q", "--tb=line", "--timeout", "90", "-p", "no:cacheprovider", "-p", "no:rerunfailures"),
    *("-o", "addopts=--import-mode=importlib", "-o", "markers=real_time\nslow\nflaky"),
)


def line(number: int) -> str:
    """One line of the table."""
    what, tests = HOLES[number]
    names = ", ".join("`" + test.rpartition("::")[2] + "`" for test in tests)
    return f"| {number} | {what} | {names} |"


def failing(revision: str) -> dict[str, list[str]]:
    """Test -> how it failed on the sources of a revision, one line for each of its cases."""
    with tempfile.TemporaryDirectory(prefix="holes-") as name:
        tree = Path(name) / "tree"
        git = ("git", "-C", str(ROOT), "worktree")
        subprocess.run([*git, "add", "--detach", str(tree), revision], check=True, capture_output=True)
        try:
            shutil.rmtree(tree / "tests")
            shutil.copytree(ROOT / "tests", tree / "tests")
            window = tree / GUI / "conftest.py"
            # Absent widgets do not come by waiting; windows of that revision ask before they close, and nobody answers.
            text = re.sub(r"PATIENCE = \d+_000", "PATIENCE = 40_000", window.read_text())
            window.write_text(text.replace("        window.close()\n", ""))
            tests = [test for _, tests in HOLES.values() for test in tests]
            environment = os.environ | {"COLUMNS": "400", "PYTHONPATH": f"{tree}{os.pathsep}{tree / 'solver/src'}"}
            command = [sys.executable, "-m", "pytest", *OPTIONS, "-rf", *tests]
            done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True, capture_output=True)
    if done.returncode not in (0, 1):
        raise RuntimeError(f"the tests did not run: {done.stdout[-2000:]}{done.stderr[-500:]}")
    found: dict[str, list[str]] = {}
    for test, _, why in re.findall(r"^FAILED ([^\s\[]+)(\[.*?\])?(?: - (.*))?$", done.stdout, re.MULTILINE):
        found.setdefault(test, []).append(why or "failed")
    return found


def main(arguments: list[str]) -> int:
    """Print which holes' tests fail on a revision, and how; exit status."""
    found = failing(arguments[0] if arguments else "193e721")
    unseen = 0
    for number, (what, tests) in HOLES.items():
        failed = [(test, why) for test in tests for why in found.get(test, [])]
        unseen += not failed
        print(f"{number:2} {what}: {'fails' if failed else 'PASSES'}")
        for test, why in failed:
            print(f"     {test.rpartition('::')[2]}: {why[:110]}")
    return int(unseen > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
