"""Opening rigs: what each driver offers, and what it refuses before touching a link."""

from __future__ import annotations

import subprocess
import sys

import pytest

from drivers import aspiration, cutometer, microrobot
from drivers.device import Device, LinkLost
from drivers.instrument import Entry, Instrument, NotAllowed

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


def test_a_real_cutometer_port_is_refused_unless_the_station_vouches() -> None:
    real = Entry("cutometer", "/dev/ttyUSB0")
    with pytest.raises(NotAllowed, match="i_have_verified_the_codec: true"):
        cutometer.open_rig(real)
    assert cutometer.open_rig(Entry("cutometer", "/dev/ttyUSB0", i_have_verified_the_codec=True))


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
