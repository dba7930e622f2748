"""A simulated instrument in a process of its own."""

from __future__ import annotations

import pytest

from drivers.device import LinkLost
from sim_devices.servers.remote import RemoteServer


def test_serves_usb_across_processes_and_has_a_back_door() -> None:
    with RemoteServer("microrobot", link="usb", speed=10.0, watchdog=0.5) as server:
        device = server.open_rig().device
        assert "micro-robot" in device.connect().model
        device.start_stream()
        while not device.read(0.1):
            pass
        truth = server.back_door.truth()
        assert truth.state == "idle"
        assert truth.vented
        with pytest.raises(ValueError, match="no raw channel"):
            server.back_door.call("nan", channel="smell")
        with pytest.raises(RuntimeError, match="dance"):
            server.back_door.call("dance")
        server.back_door.call("unplug")
        with pytest.raises(LinkLost):
            [device.read(0.1) for _ in range(100)]
        device.close()
        assert server.back_door.wait_vented(timeout=2.0).vented
    server.close()
    with pytest.raises(RuntimeError, match="gone"):
        server.back_door.truth()


def test_says_why_it_does_not_start() -> None:
    with pytest.raises(RuntimeError, match="no link 'usb'"):
        RemoteServer("cutometer", link="usb")
