"""Opening rigs: what each driver offers, and what it refuses before touching a link."""

from __future__ import annotations

import subprocess
import sys

import pytest

from drivers import aspiration, cutometer, microrobot
from drivers.device import Device, Identity, LinkLost
from drivers.instrument import Entry, Instrument, NotAllowed
from sim_devices.servers import serve

INSTRUMENTS = [cutometer.INSTRUMENT, aspiration.INSTRUMENT, microrobot.INSTRUMENT]


def entry(instrument: str, **changes: object) -> Entry:
    return Entry(instrument, "socket://127.0.0.1:1", simulated=True, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("instrument", INSTRUMENTS, ids=lambda i: i.name)
def test_a_descriptor_agrees_with_its_rig(instrument: Instrument) -> None:
    sources = dict.fromkeys(instrument.sources, "socket://127.0.0.1:1")
    rig = instrument.open_rig(entry(instrument.name, sources=sources))
    assert isinstance(rig.device, Device)
    assert rig.instrument == instrument.name
    assert rig.device.quantities == instrument.quantities
    assert {c.name for s in (rig.device, *rig.sources) for c in s.channels} == {c.name for c in instrument.channels}
    assert all(instrument.limits[q].bounded for q in instrument.quantities)
    assert {c.unit for c in instrument.channels} <= {"Pa", "m", "N", "V"}
    with pytest.raises(LinkLost):
        rig.device.connect()


@pytest.mark.parametrize("instrument", INSTRUMENTS, ids=lambda i: i.name)
def test_an_unknown_option_is_a_fault(instrument: Instrument) -> None:
    with pytest.raises(ValueError, match="unknown option 'baud'"):
        instrument.open_rig(entry(instrument.name, options={"baud": 9600}))


REAL = ["/dev/ttyUSB0", "COM3", "/dev/ttyS0", "usb:1209:0001"]


@pytest.mark.parametrize("simulated", [False, True])
@pytest.mark.parametrize("address", REAL)
@pytest.mark.parametrize("instrument", INSTRUMENTS, ids=lambda i: i.name)
def test_a_real_port_is_refused_unless_the_station_vouches(
    instrument: Instrument, address: str, simulated: bool
) -> None:
    with pytest.raises(NotAllowed, match="i_have_verified_the_codec: true"):
        instrument.open_rig(Entry(instrument.name, address, simulated=simulated))
    assert instrument.open_rig(Entry(instrument.name, address, i_have_verified_the_codec=True))


@pytest.mark.parametrize("address", ["spy:///dev/x?file=y", "alt://x", "hwgrep://x", "rfc2217://h:1", "loop://", "x"])
def test_no_rig_takes_pyserial_s_urls(address: str) -> None:
    for instrument in INSTRUMENTS:
        with pytest.raises(ValueError, match="is no link"):
            instrument.open_rig(Entry(instrument.name, address, simulated=True))


def test_what_is_called_simulated_must_call_itself_so() -> None:
    """A real instrument behind a bridge on this computer's own TCP port answers: it is turned down."""
    with serve("cutometer", "tcp") as server:
        assert "simulat" in server.bench.identity.model
        server._sim.firmware.identity = Identity("Cutometer MPA 580", "A113", "5.1")
        device = server.open_rig().device
        with pytest.raises(NotAllowed, match="'Cutometer MPA 580' answers, which does not call itself a simulator"):
            device.connect()
        device.close()
        assert server.back_door.truth().state == "idle"


def test_an_unknown_source_is_a_fault() -> None:
    with pytest.raises(ValueError, match="unknown source 'microphone'"):
        aspiration.open_rig(entry("aspiration", sources={"microphone": "socket://127.0.0.1:1"}))
    with pytest.raises(ValueError, match="uvc:0"):
        aspiration.open_rig(entry("aspiration", sources={"camera": "uvc:front"}))


def test_importing_the_drivers_is_light_and_needs_no_simulator() -> None:
    program = (
        "import sys, drivers.cutometer, drivers.aspiration, drivers.microrobot;"
        "heavy = {'numba', 'cv2', 'scipy', 'serial', 'usb', 'sim_devices', 'pint'} & set(sys.modules);"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
