"""The disk of the recording is really unmounted during a run: a tmpfs, in a mount namespace of the test's own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from acquire.cli.app import TRIPPED
from acquire.recording import open_recording

pytestmark = pytest.mark.real_time

ALONE = ("unshare", "--user", "--map-root-user", "--mount")
#: Runs a protocol on a disk of its own, and takes the disk away once the run is well under way.
SCRIPT = """
mount -t tmpfs none "$DISK" || exit 99
"$PYTHON" -c 'from acquire.cli import main; main()' run demo-aspiration --sim --speed 4 -o "$DISK/runs" &
run=$!
for _ in $(seq 600); do
    size=$(cat "$DISK"/runs/*.journal 2>/dev/null | wc -c)
    [ "$size" -gt 2000000 ] && break
    sleep 0.1
done
umount -l "$DISK"
wait $run
status=$?
[ -z "$(ls -A "$DISK")" ] || exit 98  # nothing is written where the disk was
exit $status
"""


@pytest.fixture
def disk(tmp_path: Path) -> Path:
    """Where a disk can be mounted; skips where nobody may."""
    place = tmp_path / "disk"
    place.mkdir()
    if shutil.which("unshare") is None:
        pytest.skip("no unshare here: a disk cannot be unmounted")
    tried = subprocess.run([*ALONE, "mount", "-t", "tmpfs", "none", str(place)], capture_output=True, check=False)
    if tried.returncode:
        pytest.skip(f"no mount namespaces here: {tried.stderr.decode().strip()}")
    return place


def test_the_run_trips_and_is_saved_elsewhere(tmp_path: Path, disk: Path) -> None:
    home = tmp_path / "home"
    environment = os.environ | {"DISK": str(disk), "PYTHON": sys.executable, "XDG_DATA_HOME": str(home)}
    done = subprocess.run(
        [*ALONE, "sh", "-c", SCRIPT], env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == TRIPPED, done.stderr
    assert "journal is gone" in done.stderr
    (path,) = (home / "skinrig" / "rescued").glob("*.h5")
    assert str(path) in done.stdout  # where it went is said
    recording = open_recording(path)
    assert recording.info.status == "tripped"
    assert recording.frames is not None
    assert len(list(recording.frames.data)) > 20
