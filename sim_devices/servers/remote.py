"""A simulated instrument in another process, to be used like one in this process."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from typing import Any

from drivers.device import Rig
from drivers.instrument import Entry
from sim_devices.servers.backdoor import Truth
from sim_devices.servers.bench import BENCHES
from sim_devices.servers.usb import VirtualDevice, VirtualUsb

_KINDS = {"TimeoutError": TimeoutError, "ValueError": ValueError}


class RemoteBackDoor:
    """`BackDoor` of an instrument in another process: the same methods, with keyword arguments."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self._lock = threading.Lock()

    def truth(self) -> Truth:
        """The true state, now."""
        return Truth(**self.call("truth"))

    def wait_vented(self, timeout: float = 3.0) -> Truth:
        """The first truth that is vented and still. Raises TimeoutError after ``timeout`` s of wall time."""
        return Truth(**self.call("wait_vented", timeout=timeout))

    def call(self, method: str, **args: Any) -> Any:
        """Call any method of `BackDoor`, for example ``call("stall", seconds=0.5)``.

        Raises the same error (RuntimeError for unusual kinds), and RuntimeError when the process is gone.
        """
        with self._lock:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            try:
                self._process.stdin.write(json.dumps({"call": method, "args": args}) + "\n")
                self._process.stdin.flush()
                answer = json.loads(self._process.stdout.readline())
            except (OSError, ValueError) as error:
                raise RuntimeError(f"the simulated instrument's process is gone: {error}") from error
        if "error" in answer:
            raise _KINDS.get(answer["kind"], RuntimeError)(answer["error"])
        return answer["result"]


class RemoteServer:
    """A simulated instrument in a process of its own, as `serve` starts one in this process.

    ``options`` are the command's: ``link``, ``speed``, ``seed``, ``port``, ``frame_size``, ``watchdog``, ``reference``.
    Raises RuntimeError when it does not start.
    """

    def __init__(self, instrument: str, **options: Any) -> None:
        command = [sys.executable, "-m", "sim_devices.servers", instrument]
        for name, value in options.items():
            values = value if isinstance(value, tuple) else (value,)
            command += [f"--{name.replace('_', '-')}", *map(str, values)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            _, complaint = self.process.communicate()
            raise RuntimeError(f"the simulated {instrument} did not start: {complaint.strip()}")
        where = json.loads(line)
        if where["usb"]:
            where["entry"]["usb_backend"] = VirtualUsb(*(VirtualDevice(*cable) for cable in where["usb"]))
        self.bench = BENCHES[instrument]
        self.entry = Entry(**where["entry"])
        self.back_door = RemoteBackDoor(self.process)

    def open_rig(self) -> Rig:
        """The instrument's rig on this server, not connected yet."""
        return self.bench.instrument.open_rig(self.entry)

    def close(self) -> None:
        """End the process. Idempotent."""
        self.process.communicate()

    def __enter__(self) -> RemoteServer:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
