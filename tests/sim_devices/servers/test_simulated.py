"""Simulated instruments as a whole: the numbers on the wire are the chain's; cameras, clocks, the virtual bus."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np
import pytest
import usb.core
import usb.util

from drivers.aspiration.camera import FramedCamera
from drivers.device import Device, LinkLost
from drivers.signals import Block, Frame
from drivers.transports import open_transport
from protocols.limits import Range
from protocols.setpoints import Segment, Setpoints
from sim_devices.clock import ManualClock, ScaledClock
from sim_devices.servers import Server, serve
from sim_devices.stages import nominal
from sim_devices.stages.sampling import simulate


def run(device: Device, segments: list[Segment], limits: Mapping[str, Range]) -> tuple[list[Block], float]:
    """Run segments; the blocks and the device time at which the first segment began."""
    device.connect()
    device.start_stream()
    blocks: list[Block] = []

    def read() -> None:
        device.beat()
        blocks.extend(b for b in device.read(0.02) if isinstance(b, Block))

    while not blocks:
        read()
    device.arm(limits)
    blocks.clear()
    device.enqueue(segments)
    device.start()
    while device.status.executed < len(segments):
        read()
    began = device.status.began - Setpoints(tuple(segments)).duration
    device.make_safe()
    return blocks, began


def joined(blocks: list[Block], channel: str) -> np.ndarray:
    return np.concatenate([b.values[channel] for b in blocks])


@pytest.mark.parametrize("instrument", ["cutometer", "aspiration"])
@pytest.mark.parametrize("speed", [30.0, 300.0])
def test_a_suction_instrument_measures_what_the_chain_says(instrument: str, speed: float) -> None:
    chain = nominal(instrument, command_step=0.0)

    def at(value: float) -> dict[str, float]:
        return {"pressure": value}

    segments = [
        Segment(0.0, at(0.0), at(-3e4)),
        Segment(2.003, at(-3e4), at(-3e4)),
        Segment(0.0, at(-3e4), at(0.0)),
        Segment(1.0, at(0.0), at(0.0)),
        Segment(1.5, at(0.0), at(-2e4)),
        Segment(0.7, at(-2e4), at(0.0)),
    ]
    with serve(instrument, chain=chain, speed=speed, camera=False) as server:
        device = server.open_rig().device
        blocks, began = run(device, segments, {"pressure": Range(-5e4, 0.0)})
        device.close()
    stamps = np.concatenate([b.time for b in blocks])
    table, values = Setpoints(tuple(segments)).table()
    command = (np.append(0.0, table + began), np.append(0.0, values["pressure"]))
    channels = list(blocks[0].values)
    expected = simulate(chain, {"pressure": command}, dict.fromkeys(channels, stamps))
    for channel, tolerance in (("pressure", 0.05), ("apex_height", 2e-8)):
        if channel in channels:
            assert np.abs(joined(blocks, channel) - expected[channel]).max() < tolerance


def test_the_robot_measures_where_it_is_told_to_go() -> None:
    def at(x: float, z: float) -> dict[str, float]:
        return {"probe_x": x, "probe_y": 0.0, "probe_z": z}

    segments = [
        Segment(1.0, at(0, 0), at(1e-3, 0.3e-3)),
        Segment(1.0, at(1e-3, 0.3e-3), at(1e-3, 0.3e-3)),
        Segment(1.0, at(1e-3, 0.3e-3), at(0, 0)),
    ]
    with serve("microrobot", chain=nominal("microrobot"), speed=10.0) as server:
        device = server.open_rig().device
        blocks, began = run(device, segments, dict.fromkeys(device.quantities, Range(-3e-3, 3e-3)))
        device.close()
    stamps = np.concatenate([b.time for b in blocks]) - began
    hold = (stamps > 1.8) & (stamps < 2.0)
    assert joined(blocks, "probe_x")[hold].mean() == pytest.approx(1e-3, abs=2e-5)
    assert joined(blocks, "probe_z")[hold].mean() == pytest.approx(0.3e-3, abs=2e-5)
    assert joined(blocks, "force_x")[hold].mean() < -0.1  # the skin pulls back
    rest = stamps < 0
    assert np.abs(joined(blocks, "force_x")[rest]).max(initial=0.0) < 1e-3  # tared


def test_a_second_run_is_zeroed_anew() -> None:
    segments = [
        Segment(0.5, {"pressure": 0.0}, {"pressure": 0.0}),
        Segment(2.0, {"pressure": -4e4}, {"pressure": -4e4}),
        Segment(0.0, {"pressure": 0.0}, {"pressure": 0.0}),
    ]
    with serve("cutometer", chain=nominal("cutometer"), speed=50.0) as server:
        device = server.open_rig().device
        run(device, segments, {"pressure": Range(-5e4, 0.0)})
        residual = server.back_door.truth().signals["bulge"]
        blocks, began = run(device, segments, {"pressure": Range(-5e4, 0.0)})
        device.close()
    stamps = np.concatenate([b.time for b in blocks])
    assert residual > 5e-6
    assert abs(joined(blocks, "apex_height")[stamps <= began + 0.5][-1]) < residual / 5


@pytest.fixture
def suction() -> Callable[..., Server]:
    return lambda **options: serve("aspiration", speed=10.0, frame_size=(320, 240), **options)


def test_the_camera_sees_the_bubble(suction: Callable[..., Server]) -> None:
    chain = nominal("aspiration")
    with suction(chain=chain) as server:
        rig = server.open_rig()
        (camera,) = rig.sources
        assert isinstance(camera, FramedCamera)
        assert "simulated" in camera.connect().model
        camera.start_stream()
        rig.device.connect()
        rig.device.start_stream()
        rig.device.arm({"pressure": Range(-5e4, 0.0)})
        frames: list[Frame] = []
        heights: list[Block] = []

        def read(seconds: float) -> None:
            start = rig.device.status.time
            while rig.device.status.time < start + seconds:
                rig.device.beat()
                rig.device.read(0.01)
                for item in camera.read(0.01):
                    (frames if isinstance(item, Frame) else heights).append(item)  # type: ignore[arg-type]

        read(0.4)
        rig.device.enqueue([Segment(10.0, {"pressure": -3e4}, {"pressure": -3e4})])
        rig.device.start()
        read(2.0)
        began = rig.device.status.began
        rig.device.make_safe()
        rig.device.close()
        camera.close()
    assert frames[0].image.shape == (240, 320)
    seq = np.array([f.seq for f in frames])
    assert np.all(np.diff(seq) == 1)
    assert np.allclose([f.time for f in frames], seq / 25, atol=2e-6)
    table = (np.array([0.0, began, began]), np.array([0.0, 0.0, -3e4]))
    stamps = np.concatenate([b.time for b in heights])
    true = simulate(chain, {"pressure": table}, {"apex_height": stamps})["apex_height"]
    assert np.abs(joined(heights, "apex_height") - true).max() < 1e-5  # half a pixel
    assert true[-1] > 5e-4


def test_a_pulled_camera_cable_is_a_lost_link(suction: Callable[..., Server]) -> None:
    with suction() as server:
        (camera,) = server.open_rig().sources
        camera.connect()
        camera.start_stream()
        server.back_door.unplug()
        with pytest.raises(LinkLost):
            [camera.read(0.1) for _ in range(100)]
        camera.make_safe()
        camera.close()
        with pytest.raises(LinkLost, match="not connected"):
            camera.read(0.0)


def test_a_host_that_pauses_between_runs_finds_the_frames_going_on(suction: Callable[..., Server]) -> None:
    with suction(clock=ScaledClock(1000.0, idle=1000.0)) as server:
        (camera,) = server.open_rig().sources
        camera.connect()
        camera.start_stream()
        while not camera.read(0.1):
            pass
        time.sleep(1.2)  # the link is full, and has been for longer than a safe device waits
        newest, deadline = server.back_door.truth().time, time.monotonic() + 10.0
        while not any(isinstance(f, Frame) and f.time > newest for f in camera.read(0.1)):
            assert time.monotonic() < deadline, "no frame came after the pause"
        camera.close()


@pytest.mark.parametrize("instrument", ["cutometer", "aspiration", "microrobot"])
def test_time_between_runs_is_no_faster_than_real(instrument: str) -> None:
    with serve(instrument, speed=1000.0, frame_size=(64, 48)) as server:
        rig = server.open_rig()
        rig.device.connect()
        rig.device.start_stream()
        began, since = server.back_door.truth().time, time.monotonic()
        while time.monotonic() < since + 0.5:
            rig.device.read(0.05)
        assert server.back_door.truth().time - began < time.monotonic() - since + 0.5
        rig.device.close()


def test_a_clock_moved_by_hand() -> None:
    clock = ManualClock()
    with serve("cutometer", "tcp", clock=clock) as server:
        device = server.open_rig().device
        device.connect()
        device.start_stream()
        blocks: list[Block] = []
        clock.advance(0.5)
        while sum(map(len, blocks)) < 50:
            blocks += [b for b in device.read(0.1) if isinstance(b, Block)]
        time.sleep(0.05)
        assert sum(map(len, device.read(0.0))) <= 1
        device.close()


def test_clocks() -> None:
    with pytest.raises(ValueError, match="positive"):
        ScaledClock(0.0)
    clock = ScaledClock(1000.0)
    clock.slip(5.0)
    assert 5.0 <= clock.now() < 100.0
    assert clock.wall_until(clock.now() + 1000.0) == pytest.approx(1.0, abs=0.2)
    assert clock.wall_until(0.0) == 0.0
    clock.hurry(False)
    moment = clock.now()
    assert clock.speed == 1.0
    assert clock.wall_until(moment + 1.0) == pytest.approx(1.0, abs=0.1)
    clock.hurry(True)
    assert clock.speed == 1000.0
    assert moment <= clock.now() < moment + 100.0


def test_what_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match="no simulated instrument 'tonometer'"):
        serve("tonometer")
    with pytest.raises(ValueError, match="no link 'usb'; it has pty, tcp"):
        serve("cutometer", "usb")


def test_the_virtual_bus_looks_like_a_real_one_to_pyusb() -> None:
    with serve("microrobot", "usb") as server:
        backend = server.entry.usb_backend
        assert usb.core.find(idVendor=0x1234, backend=backend) is None
        device = usb.core.find(idVendor=0x1209, backend=backend)
        assert device is not None
        assert (device.bus, device.address, device.speed) == (1, 1, usb.util.SPEED_HIGH)
        device.set_configuration()
        interface = device.get_active_configuration()[(0, 0)]
        assert interface.bInterfaceClass == 0xFF
        assert [e.bEndpointAddress for e in interface] == [0x81, 0x01]
        assert not device.is_kernel_driver_active(0)
        usb.util.claim_interface(device, 0)
        with pytest.raises(usb.core.USBTimeoutError):
            device.read(0x81, 64, 10)
        with pytest.raises(LinkLost, match="busy"):
            server.open_rig().device.connect()
        server.back_door.unplug()
        with pytest.raises(usb.core.USBError) as lost:
            [device.read(0x81, 64, 100) for _ in range(20)]
        assert lost.value.errno == 19  # ENODEV
        usb.util.dispose_resources(device)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_simulation_that_fails_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    with serve("cutometer", "tcp") as server:
        monkeypatch.setattr(server._sim, "_turn", lambda wall: 1 / 0)
        with pytest.raises(RuntimeError, match="cutometer has failed"):
            [(server.back_door.truth(), time.sleep(0.01)) for _ in range(200)]


def test_at_high_speed_time_waits_for_the_host_to_feed_the_queue() -> None:
    def at(value: float) -> dict[str, float]:
        return {"pressure": value}

    with serve("cutometer", "tcp", chain=nominal("cutometer"), speed=1000.0) as server:
        device = server.open_rig().device
        device.connect()
        device.start_stream()
        device.arm({"pressure": Range(-5e4, 0.0)})
        device.enqueue([Segment(10.0, at(0.0), at(-1e4))])
        device.start()
        blocks: list[Block] = []
        began = np.nan
        for number in range(1, 6):
            while device.status.executed < number:
                device.beat()
                blocks += [b for b in device.read(0.02) if isinstance(b, Block)]
            began = device.status.began - 10.0 * number if number == 1 else began
            assert device.status.time <= began + 10.0 * number + 0.02
            time.sleep(0.01)  # 10 s of the instrument's time
            device.enqueue([Segment(10.0, at(-1e4), at(-1e4))])
        device.make_safe()
        device.close()


@pytest.mark.parametrize("instrument", ["cutometer", "aspiration", "microrobot"])
def test_rubbish_from_the_host_does_no_harm(instrument: str) -> None:
    random = np.random.default_rng(5)
    with serve(instrument, "tcp", camera=False) as server:
        rig = server.open_rig()
        port = open_transport(server.entry.address)
        for _ in range(20):
            port.write(random.bytes(5000))
        port.close()
        assert rig.device.connect().model
        rig.device.close()
        assert server.back_door.truth().state == "idle"
