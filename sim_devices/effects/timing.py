"""Effects of time: when commands act, when samples are taken, which ones arrive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from sim_devices.chain import Chain
from sim_devices.effects.build import (
    ALL,
    MOMENT,
    PHASE,
    ROBOT,
    SUCTION,
    Values,
    choice,
    chosen,
    delayed,
    effect,
    law_after,
    on_recorded,
    shape,
    signed,
    strength,
)
from sim_devices.stages import RATES, kernels
from sim_devices.stages.operators import Delay, Gap, Law, Polled, Wandering, Warming, after
from sim_devices.stages.robot import TRANSDUCERS, numbered

_SEED = shape("seed", "choice", 0, 9, 1, "which samples are hit: another number, other samples")
_RATE = shape("rate", "Hz", 0, 2000, 0, "sampling rate; 0: the instrument's own")


def _sensors(instrument: str, channel: int) -> tuple[tuple[str, str], ...]:
    """(operator, recorded signal) of the sensors that a choice names."""
    if instrument == "microrobot":
        position = tuple(("position_sensors", s) for s in numbered("axis_position"))
        force = tuple(("transducers", s) for s in TRANSDUCERS)
        return (*position, *force) if channel == 0 else (position if channel == 1 else force)
    both = (("gauge", "pressure"), ("optics", "apex_height"))
    return both if channel == 0 else both[channel - 1 : channel]


_CHANNEL = choice("channel", 0, "all", "pressure, or position", "height, or force")


def _period(instrument: str, values: Values) -> float:
    return 1.0 / (values["rate"] or RATES[instrument])


def _scattered(instrument: str, v: Values) -> dict[str, float]:
    """rms of the instants' error of jitter, or of samples of which a fraction is old: by one period, or by any time up
    to twice the delay."""
    if "sigma" in v:
        rms = v["sigma"]
    elif chosen(v, "form") == 0:
        rms = _period(instrument, v) * math.sqrt(v["fraction"] * (1.0 - v["fraction"]))
    elif "delay" in v:
        rms = v["delay"] * math.sqrt(v["fraction"] * (4.0 / 3.0 - v["fraction"]))
    else:  # the time axis closes up: no sample is off by chance
        return {}
    return {signal: rms for _, signal in _sensors(instrument, chosen(v, "channel"))}


def _latency(chain: Chain, v: Values) -> Chain:
    op: Any = chain["latency"]
    if form := chosen(v, "form"):
        looks = (v["interval"], v["phase"], op.marks if form == 2 else ())
        return after(chain, "latency", lambda s, t: Polled("polled", "timing", s, t, *looks))
    return chain.tuned("latency", delay=op.delay + v["delay"])


def _skew(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 2:
        wandering = (v["swing"], v["period"], v["phase"])
        return after(chain, "latency", lambda s, t: Wandering("wandering", "timing", s, t, *wandering))
    op: Any = chain["latency"]
    if chosen(v, "form") > 2:
        rates = (v["rate"], 0.0) if chosen(v, "form") == 3 else (0.0, v["rate"])
        return after(chain, "latency", lambda s, t: Warming("warming", "timing", s, t, *rates, v["tau"], op.marks))
    marks = op.marks if chosen(v, "form") == 0 else ()
    return chain.tuned("latency", skew=op.skew + v["rate"], marks=marks)


def _faulty(name: str, lost: float) -> Callable[[Chain, Values], Chain]:
    def install(chain: Chain, v: Values) -> Chain:
        parameters = (_period(chain.instrument, v), v["fraction"], v["seed"], lost)
        for _, signal in _sensors(chain.instrument, chosen(v, "channel")):
            chain = on_recorded(
                chain, signal, lambda s, t: Law(name, "timing", s, t, kernels.faulty_samples, parameters)
            )
        return chain

    return install


_repeated = _faulty("dropped_samples", 1.0)
_one_before = _faulty("late_samples", 0.0)


def _at_sensors(chain: Chain, v: Values, name: str, kernel: kernels.Kernel, *parameters: float) -> Chain:
    """A law of single samples behind the sensors of the chosen channel, in front of their noise."""
    for anchor in dict.fromkeys(a for a, _ in _sensors(chain.instrument, chosen(v, "channel"))):
        chain = law_after(chain, anchor, name, "timing", kernel, (_period(chain.instrument, v), *parameters))
    return chain


def _late(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 0:
        return _one_before(chain, v)
    return _at_sensors(chain, v, "late_samples", kernels.late_by_any, v["fraction"], v["seed"], v["delay"])


def _desynchronised(chain: Chain, v: Values) -> Chain:
    form, shift = chosen(v, "form"), v["shift"]
    if form == 0 and shift < 0:
        return delayed(chain, "desynchronisation", "timing", -shift, "gauge")
    if form < 2:
        return delayed(chain, "desynchronisation", "timing", shift, "optics")
    op: Any = chain["latency"]
    marks = op.marks if form == 3 else ()
    return after(
        chain, "optics", lambda s, t: Delay("desynchronisation", "timing", s, t, skew=v["growth"], marks=marks)
    )


def _dropped(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 0:
        return _repeated(chain, v)
    op: Any = chain["latency"]
    if chosen(v, "form") > 1:
        # All channels together move against the commands; height alone, against pressure too.
        anchor = "latency" if chosen(v, "form") == 2 else "optics"
        burst = (v["lost"], v["moment"], op.marks)
        return after(chain, anchor, lambda s, t: Gap("dropped_samples", "timing", s, t, *burst))
    # Stamped as if none were missing: the record's clock loses one period with each lost sample.
    return chain.tuned("latency", skew=op.skew - v["fraction"])


def _jitter(chain: Chain, v: Values) -> Chain:
    return _at_sensors(chain, v, "jitter", kernels.jittered, v["sigma"], v["seed"])


def _lost_samples(instruments: tuple[str, ...], *further: str) -> Any:
    return effect(
        "dropped_samples", "timing", instruments,
        "Samples are lost: the last value is repeated, or the time axis closes up.",
        "Number the samples and store the gaps; give the link more buffer.",
        "overrun serial buffers, cameras without frame numbers; gap.md",
        (
            strength("fraction", "1", 1e-5, 0.5, 0.1, "of the samples", only=(0, 1)),
            strength("lost", "s", 2e-3, 3.0, 0.2, "that the burst takes", only=(2, 3)),
            choice("form", 0, "the last value is repeated", "the samples after it move up, in all channels",
                   "a burst in one recording, all channels move up", *further),
            *(replace(p, only=(0,)) for p in (_CHANNEL, _SEED, _RATE)),
            shape(*MOMENT, "when the burst is lost", log=True, only=(2, 3)),
        ),
        _dropped, _scattered, sparse=True,
    )  # fmt: skip


EFFECTS = (
    effect(
        "latency", "timing", ALL,
        "Commands take effect late, by a dead time or until the device next looks at them.",
        "Time-stamp commands where they act, or measure the delay with a trigger and subtract it.",
        "buffered serial and USB links; gap.md",
        (
            strength("delay", "s", 2e-4, 0.5, 0.08, "dead time", only=(0,)),
            strength("interval", "s", 5e-4, 1.0, 0.087, "between looks at the command", only=(1, 2), fine=1e-8),
            choice("form", 0, "constant", "until the device looks next, which it does at equal intervals",
                   "the same, by intervals that begin with each recording"),
            shape("phase", "1", 0.0, 1.0, 0.37, "when it looks, in intervals", only=(1, 2)),
        ),
        _latency,
    ),
    effect(
        "clock_skew", "timing", ALL,
        "The recording's clock runs fast or slow against the command clock.",
        "Take both from one clock, or exchange time stamps at both ends of a recording.",
        "crystal tolerance is 20 to 100 ppm; software timers are far worse",
        (
            signed("rate", "s/s", 0.01, 3e-3, "positive: the recording's clock runs fast", only=(0, 1, 3, 4)),
            strength("swing", "s", 1e-5, 0.03, 5e-3, "by how much it is off at most", only=(2,)),
            choice("form", 0, "aligned at the start of each recording", "aligned once, at the start of the session",
                   "to and fro", "while its crystal is cold, at the start of the session", "once it is warm"),
            shape("tau", "s", 10.0, 2000.0, 150.0, "within which it warms up", log=True, only=(3, 4)),
            shape("period", "s", 15.0, 1500.0, 150.0, "of going to and fro", log=True, only=(2,), fine=1e-4),
            PHASE,
        ),
        _skew,
    ),
    effect(
        "late_samples", "timing", ALL,
        "Some samples are delivered late: older values under newer stamps.",
        "Stamp samples in the device, not on arrival.",
        "operating system scheduling; gap.md",
        (
            strength("fraction", "1", 1e-3, 0.5, 0.1, "of the samples"),
            choice("form", 0, "the value before", "by any time up to twice the delay"),
            strength("delay", "s", 1e-3, 0.1, 0.02, "mean lateness of those that are late", only=(1,)),
            _CHANNEL, _SEED, _RATE,
        ),
        _late, _scattered, sparse=True,
    ),
    _lost_samples(SUCTION, "a burst in one recording, the height alone moves up"),
    _lost_samples(ROBOT),
    effect(
        "desynchronisation", "timing", SUCTION,
        "The height lags or leads the pressure channel.",
        "Read height and pressure by one trigger, or align them on a step of suction.",
        "separate camera and pressure streams; gap.md",
        (
            signed("shift", "s", 0.4, 0.08, "positive: height is late", only=(0, 1)),
            signed("growth", "s/s", 0.03, 8e-4, "of the height's lateness, whose frames are counted at a wrong rate",
                   only=(2, 3)),
            choice("form", 0, "negative: pressure is late", "negative: height is stamped early",
                   "growing through the session", "growing through each recording"),
        ),
        _desynchronised,
    ),
    effect(
        "jitter", "timing", ALL,
        "True sampling instants scatter about the stamped ones.",
        "Sample by hardware timer.",
        "software-timed sampling; gap.md",
        (strength("sigma", "s", 1e-4, 0.03, 5e-3, "rms scatter, uniformly distributed"), _CHANNEL, _SEED, _RATE),
        _jitter, _scattered,
    ),
)  # fmt: skip
