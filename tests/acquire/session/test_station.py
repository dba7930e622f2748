"""Station files: what they may say, and that every fault is told with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from acquire.engine import Rules, Tracking
from acquire.provenance import calibration
from acquire.session import Session
from acquire.station import Station, load_station, simulated_station
from drivers.instrument import Entry
from protocols import ProtocolError, load

FULL = """\
schema: station/1
name: bench
instruments:
  cutometer:
    address: /dev/ttyUSB0
    i_have_verified_the_codec: true
    watchdog: 300 ms
    options: {baudrate: 9600}
    limits: {pressure: {low: -450 mbar, high: 0 mbar}}
    interlock:
      margin: 0.2
      stale: 2 s
      disk: 1000000
      tracking: {pressure: {error: 20 mbar, duration: 1 s}}
      agreement: {pressure: {error: 10 mbar, duration: 500 ms}}
      plausible: false
    calibration:
      contact_force: {value: 0.55 N, provenance: measured, note: weighed}
  bubble:
    instrument: aspiration
    simulated: {tissue: cheek, effects: [leak], seed: 3}
subjects:
  P07: {pressure: {low: -300 mbar}}
"""


def test_everything_a_station_may_say() -> None:
    station = load_station(FULL)
    cutometer, bubble = station.instruments["cutometer"], station.instruments["bubble"]
    entry = cutometer.entry("cutometer")
    assert (entry.address, entry.watchdog, entry.options) == ("/dev/ttyUSB0", 0.3, {"baudrate": 9600})
    assert entry.i_have_verified_the_codec
    assert not entry.simulated
    rules = cutometer.interlock.rules()
    assert (rules.margin, rules.stale, rules.disk) == (0.2, 2.0, 1000000)
    assert rules.tracking["pressure"] == Tracking(2000.0, 1.0)
    assert rules.agreement["pressure"] == Tracking(1000.0, 0.5)
    assert not rules.plausible
    assert "probe_x" in rules.tracking
    assert rules.rate_margin == bubble.interlock.rules().rate_margin
    assert station.find("aspiration") == "bubble"
    assert bubble.here
    assert not cutometer.here
    assert station.subject_limits("P07")["pressure"].low == -30e3
    assert not station.subject_limits("P08")


def test_a_station_survives_its_own_text() -> None:
    for station in (load_station(FULL), simulated_station("cheek", ("leak",), 4)):
        assert load_station(station.text()) == station


def test_limits_of_hardware_station_and_subject_are_intersected() -> None:
    with Session(load_station(FULL)) as session:
        assert session.limits("cutometer")["pressure"].low == -45e3
        assert session.limits("cutometer", "P07")["pressure"].low == -30e3
        assert session.limits("bubble")["pressure"].low == -70e3
        assert session.limits("cutometer", "P07").origin == "hardware ∩ station ∩ subject P07"


def test_calibrations_keep_their_provenance() -> None:
    protocol = load("schema: protocol/1\nname: a\ninstrument: cutometer\nsetup: {opening: 4 mm}\n"
                    "steps: [{type: wait, duration: 1 s}]\n")  # fmt: skip
    known = calibration(load_station(FULL).instruments["cutometer"], protocol)
    assert known["contact_force"] == {"value": 0.55, "unit": "N", "provenance": "measured", "note": "weighed"}
    assert (known["opening"]["value"], known["opening"]["provenance"]) == (4e-3, "documented")


def test_recordings_tell_seed_and_assumed_scale() -> None:
    with Session(simulated_station()) as session:
        for entry in session.station.instruments.values():
            assert entry.simulated is not None
            assert entry.simulated.seed is not None
        assert session.station.instruments["aspiration"].calibration["frame_scale"].provenance == "assumed"


@pytest.mark.parametrize(
    ("change", "where", "message"),
    [
        (("address: /dev/ttyUSB0", "adress: /dev/ttyUSB0"), ":5:", "did you mean 'address'"),
        (("schema: station/1", "schema: station/9"), ":1:", "station/9"),
        (("watchdog: 300 ms", "watchdog: 300"), ":7:", "unit is missing"),
        (("watchdog: 300 ms", "watchdog: -3 s"), ":7:", "must be positive"),
        (("low: -450 mbar", "low: -450 mm"), ":9:", "no unit of pressure"),
        (("low: -450 mbar, high: 0 mbar", "low: 0 mbar, high: -450 mbar"), ":9:", "empty"),
        (("low: -450 mbar", "lowest: -450 mbar"), ":9:", "lowest"),
        (("margin: 0.2", "margin: lots"), ":11:", "number"),
        (("error: 20 mbar", "error: 20 N"), ":14:", "no unit of pressure"),
        (("provenance: measured", "provenance: guessed"), ":18:", "guessed"),
        (("contact_force:", "colour:"), ":18:", "colour"),
        (("value: 0.55 N", "value: 0.55 mm"), ":18:", "no unit of force"),
        (("simulated: {tissue: cheek, effects: [leak], seed: 3}", "limits: {}"), ":20:", "needs an address"),
        (("seed: 3", "seed: many"), ":21:", "whole number"),
        (
            ("simulated: {tissue: cheek", "address: /dev/x\n    simulated: {tissue: cheek"),
            ":20:",
            "simulated elsewhere",
        ),
        (("/dev/ttyUSB0", "spy:///dev/ttyUSB0?file=/tmp/x"), ":5:", "is no link"),
        (("/dev/ttyUSB0", "alt://dev/ttyUSB0?class=x"), ":5:", "is no link"),
        (("/dev/ttyUSB0", "hwgrep://0403"), ":5:", "is no link"),
        (("/dev/ttyUSB0", "rfc2217://lab:7000"), ":5:", "is no link"),
        (("/dev/ttyUSB0", "loop://"), ":5:", "is no link"),
        (("/dev/ttyUSB0", "notes.txt"), ":5:", "is no link"),
        (("/dev/ttyUSB0", "socket://192.0.2.7:4001"), ":5:", "say 'host: 192.0.2.7' too"),
        (("options: {baud", "sources: {camera: 'spy://x'}\n    options: {baud"), ":8:", "is no link"),
        (("P07: {pressure: {low: -300 mbar}}", "P07: {pressure: -300 mbar}"), ":23:", "keys and values"),
        (("instruments:", "instrument:"), ":3:", "did you mean 'instruments'"),
    ],
)
def test_a_fault_is_told_with_its_place(tmp_path: Path, change: tuple[str, str], where: str, message: str) -> None:
    assert change[0] in FULL
    path = tmp_path / "station.yaml"
    path.write_text(FULL.replace(*change, 1))
    with pytest.raises(ProtocolError) as caught:
        load_station(path)
    text = str(caught.value)
    assert f"station.yaml{where}" in text
    assert message in text


@pytest.mark.parametrize(
    ("change", "where"),
    [
        *[
            (("watchdog: 300 ms", f"watchdog: {bad}"), ":7:")
            for bad in ("1000000 s", "1.01 s", "99 ms", "0 s", "1e999 s")
        ],
        *[(("stale: 2 s", f"stale: {bad}"), ":12:") for bad in ("1000000 s", "5.1 s", "0 s", "-1 s", ".inf", ".nan")],
        *[(("margin: 0.2", f"margin: {bad}"), ":11:") for bad in ("-0.1", "0.3", ".inf", ".nan", "1e400")],
        *[(("margin: 0.2", f"rate_margin: {bad}"), ":11:") for bad in ("-0.1", "2.1", ".inf", ".nan")],
        *[(("margin: 0.2", f"rate_window: {bad}"), ":11:") for bad in ("0 s", "1.1 s", "10 ms")],
        *[(("margin: 0.2", f"lag: {bad}"), ":11:") for bad in ("-0.1", "1", ".nan")],
        *[(("disk: 1000000", f"disk: {bad}"), ":13:") for bad in ("0", "-1", "999999", "1" + "0" * 30)],
        *[(("error: 20 mbar", f"error: {bad}"), ":14:") for bad in ("0 mbar", "-20 mbar", "201 mbar", "1e999 mbar")],
        *[(("duration: 1 s", f"duration: {bad}"), ":14:") for bad in ("0 s", "11 s", "-1 s")],
        *[(("high: 0 mbar", f"high: 0 mbar, dwell: {bad}"), ":9:") for bad in ("0 s", "-1 s", "3", "1 mbar")],
    ],
)
def test_a_safety_parameter_out_of_bounds_is_refused(tmp_path: Path, change: tuple[str, str], where: str) -> None:
    assert change[0] in FULL
    path = tmp_path / "station.yaml"
    path.write_text(FULL.replace(*change, 1))
    with pytest.raises(ProtocolError) as caught:
        load_station(path)
    assert f"station.yaml{where}" in str(caught.value)


def test_bounds_hold_in_python_too() -> None:
    for bad in (
        {"stale": 1e6},
        {"margin": -1.0},
        {"lag": float("nan")},
        {"tracking": {"pressure": Tracking(0.0, 1.0)}},
    ):
        with pytest.raises(ValueError, match=next(iter(bad))):
            Rules(**bad)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="watchdog of 2 s"):
        Entry("cutometer", "socket://127.0.0.1:1", watchdog=2.0)


def test_an_instrument_that_is_not_there() -> None:
    station = load_station(FULL)
    with pytest.raises(ValueError, match="has no microrobot; it has cutometer, bubble"):
        station.find("microrobot")
    with Session(station) as session, pytest.raises(ValueError, match="no instrument 'x'"):
        session.open("x")


def test_a_kind_without_driver() -> None:
    text = {"schema": "station/1", "instruments": {"toaster": {"address": "/dev/null"}}}
    with (
        Session(Station.model_validate(text)) as session,
        pytest.raises(ValueError, match="no driver for an instrument"),
    ):
        session.open("toaster")


def test_another_computer_is_reached_where_the_station_says_so_twice() -> None:
    far = FULL.replace("address: /dev/ttyUSB0", "address: socket://adapter.lab:4001\n    host: adapter.lab")
    assert load_station(far).instruments["cutometer"].host == "adapter.lab"
    assert load_station(FULL.replace("/dev/ttyUSB0", "'socket://[::1]:4001'"))
