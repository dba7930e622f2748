"""What is strange about a bundle, though it can be imported: warnings that are kept among the recording's events.

Each is something that a person would have written otherwise, had he known how it is read: a specimen of nearly the name
of a reference, an uncertainty as large as its value, a rest that no start time tells.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

import numpy as np

from acquire.plugins import instrument
from acquire.recording.bundle_schema import SUCTION, Bundle
from acquire.recording.model import AXIS_LOOP, Event, Recording
from drivers.signals import REFERENCE
from protocols import specimens
from protocols.text import did_you_mean, resembling

HIGH = 1e3
"""Pa above the air's pressure that no line is at."""
FAST = 20e3
"""Hz that no channel of ours is sampled at: the fastest takes 1 kHz."""
FAINT = {"pressure": (500.0, 100.0, "mbar"), "apex_height": (2e-6, 1e-6, "µm")}
"""Of a channel on skin, the largest value [SI] that no measurement stops at, and the unit that it is told in."""
READ = ("serial_number", "opening", "contact_force", "hole_radius", "frame_scale", "gvt", "initial_height", *AXIS_LOOP)
"""Calibrations that something here reads; stations and qualifications, which name some of them, stand on recordings."""
MISSPELT = 0.85
"""How like one of these (`difflib`) a name must be to be no word of its own, as `loop_filter` and `frame_rate` are."""
COARSE, SPANNED = 10.0, 0.2
"""Times the usual step between samples, and share of a channel's span, beyond which a stated resolution is none."""
WIDE = 0.1
"""Of a stated value, its standard uncertainty from which on the unit of the uncertainty is asked about."""


def doubts(bundle: Bundle, recording: Recording) -> tuple[Event, ...]:
    """Warnings about a bundle and the recording that was read from it. A code that is among its events is not repeated.

    What the recorder has exported was asked about when it was recorded: of that only the channels are looked at.
    """
    told = {event.code for event in recording.events}
    asked = [
        *_channels(bundle, recording),
        *_sign(bundle, recording),
        *_rate(bundle, recording),
        *_faint(bundle, recording),
        *_resolution(recording),
    ]
    if bundle.run.id is None:
        asked += [*_setpoints(bundle, recording), *_specimen(bundle, recording), *_start(recording)]
        asked += _calibration(recording)
    return tuple(event for event in asked if event.code not in told)


def _warning(code: str, text: str, time: float = 0.0) -> Event:
    return Event(time, "warning", code, text)


def _channels(bundle: Bundle, recording: Recording) -> Iterator[Event]:
    """A channel that an instrument of ours does not have is kept, but nothing here would read it."""
    try:
        known = {channel.name for channel in instrument(bundle.instrument).channels}
    except ValueError:  # not one of ours
        return
    unknown = [name for name in recording.streams if name.removesuffix(REFERENCE) not in known]
    if unknown:
        text = f"not among the channels of the {bundle.instrument} ({', '.join(sorted(known))})"
        yield _warning("unknown_channel", f"{', '.join(unknown)}: kept, but {text}")


def _sign(bundle: Bundle, recording: Recording) -> Iterator[Event]:
    """Suction that goes up: a gauge shows a few mbar above the air's pressure at most."""
    if bundle.instrument not in SUCTION:
        return
    gauges = {name: s for name, s in recording.streams.items() if name.removesuffix(REFERENCE) == "pressure"}
    commands = {f"set-point of {name}": s for name, s in recording.setpoints.items() if name == "pressure"}
    for name, series in (gauges | commands).items():
        value = series.value[np.isfinite(series.value)]
        if value.size and value.max() > max(HIGH, -value.min()):
            above = f"the {name} goes up to {value.max() / 100:.0f} mbar above the air's"
            text = f"{above}; suction is negative in a bundle, so check its sign"
            yield _warning("pressure_sign", text, float(series.time[0]))
            return


def _rate(bundle: Bundle, recording: Recording) -> Iterator[Event]:
    """Samples that follow each other faster than any of our instruments takes them: ms that were seconds."""
    try:
        known = {channel.name for channel in instrument(bundle.instrument).channels}
    except ValueError:
        return
    for name, series in recording.streams.items():
        interval = float(np.median(np.diff(series.time))) if name in known and len(series.time) > 1 else np.inf
        if 0.0 < interval < 1.0 / FAST:
            lasting = f"{series.time[-1] - series.time[0]:.3g} s in all"
            text = f"channel {name} has {1.0 / interval:.3g} samples a second, {lasting}: a wrong unit of time?"
            yield _warning("fast_samples", text, float(series.time[0]))
            return


def _faint(bundle: Bundle, recording: Recording) -> Iterator[Event]:
    """Values on skin that are a thousandth of usual ones: mbar that were called Pa, mm that were called µm."""
    if bundle.instrument not in SUCTION or bundle.specimen != specimens.SKIN:
        return
    for name, (least, factor, unit) in FAINT.items():
        value = recording.streams[name].value if name in recording.streams else np.zeros(0)
        largest = float(np.abs(value[np.isfinite(value)]).max(initial=0.0))
        if 0.0 < largest < least:
            text = f"channel {name} reaches {largest / factor:.3g} {unit} only: is its unit right?"
            yield _warning("faint_values", text, float(recording.streams[name].time[0]))


def _resolution(recording: Recording) -> Iterator[Event]:
    """A resolution that the samples are finer than by far: one in the column's unit, as that of noise may be."""
    for name, series in recording.streams.items():
        value = series.value[np.isfinite(series.value)]
        steps = np.abs(np.diff(value))
        moved = steps[steps > 0.0]
        if not moved.size:
            continue
        usual = float(np.median(moved))
        if series.resolution > max(COARSE * usual, SPANNED * float(np.ptp(value))):
            stated, differ = f"{series.resolution:g} {series.unit}", f"{usual:.2g} {series.unit}"
            text = f"channel {name} states a resolution of {stated}, but its samples differ by {differ}"
            yield _warning("coarse_resolution", f"{text}: a resolution that is a number is in SI units")


def _setpoints(bundle: Bundle, recording: Recording) -> Iterator[Event]:
    try:
        known = instrument(bundle.instrument).quantities
    except ValueError:
        return
    unknown = [name for name in recording.setpoints if name not in known]
    missing = [name for name in known if name not in recording.setpoints]
    if unknown:
        text = f"{', '.join(unknown)}: kept, but the {bundle.instrument} is commanded by {', '.join(known)}"
        yield _warning("unknown_setpoint", text)
    elif missing and recording.setpoints:
        yield _warning("missing_setpoint", f"no set-points of {', '.join(missing)}, which a diagnosis needs")


def _specimen(bundle: Bundle, recording: Recording) -> Iterator[Event]:
    name, fitting = bundle.specimen, specimens.of(bundle.instrument)
    if fitting and name != specimens.SKIN and name not in specimens.SPECIMENS:
        text = f"specimen {name!r} is kept, but a diagnosis concludes nothing from it: it is no reference"
        yield _warning("unknown_specimen", text + did_you_mean(name, fitting))
    try:
        specimens.check_complete(name, bundle.instrument, recording.info.specimen_properties)
    except ValueError as error:
        yield _warning("incomplete_specimen", str(error))
    for key, stated in recording.info.specimen_properties.items():
        if len(stated.value) == 1 and stated.se > WIDE * abs(stated.scalar) > 0.0:
            text = f"{key} is {stated}: a ± without a unit has that of the value, so write the unit of both"
            yield _warning("wide_uncertainty", text)


def _calibration(recording: Recording) -> Iterator[Event]:
    """A calibration of nearly the name of one that is read; and a loop that a diagnosis would refuse."""
    known = recording.info.calibration
    for name in known:
        if name not in READ and (close := resembling(name, READ, MISSPELT)):
            yield _warning("unknown_calibration", f"{name} is kept, but nothing reads it: is it {close}?")
    given = [name for name in AXIS_LOOP if name in known]
    if missing := [name for name in AXIS_LOOP if name not in known] if given else []:
        yield _warning("incomplete_loop", f"a controller needs {', '.join(missing)} besides {', '.join(given)}")
    for name in given:
        if (unit := known[name].get("unit")) != AXIS_LOOP[name]:
            yield _warning("loop_unit", f"{name} is in {unit}; a diagnosis takes {AXIS_LOOP[name]} and nothing else")


def _start(recording: Recording) -> Iterator[Event]:
    text = recording.info.start_time
    try:
        datetime.fromisoformat(text or "2000-01-01")
    except ValueError:
        told = "the rest before this recording is assumed, as if no time were stated"
        yield _warning("start_time", f"start_time {text!r} is no time such as 2026-04-02T09:10:00+02:00: {told}")
