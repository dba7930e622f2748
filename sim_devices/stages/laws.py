"""Laws without memory, ``law(time, signal, *parameters)``: for stages, effects and user rigs.

All take and return arrays (n,).
"""

from __future__ import annotations

import numpy as np

from sim_devices.chain import FloatArray


def gain(time: FloatArray, u: FloatArray, error: float) -> FloatArray:
    """u (1 + error)."""
    return u * (1.0 + error)


def offset(time: FloatArray, u: FloatArray, amount: float) -> FloatArray:
    """u + amount."""
    return u + amount


def jump(time: FloatArray, u: FloatArray, amount: float, moment: float) -> FloatArray:
    """u + amount from ``moment`` on."""
    return u + amount * (time >= moment)


LONGEST_STEP = 0.1
"""s before a sample for which it stands at most: longer ones are pauses."""


def spell(time: FloatArray, moment: float, duration: float, ease: float = 0.0) -> FloatArray:
    """1 from ``moment`` on for ``duration`` s, else 0; the share of its step in a sample (n,) where it begins or ends.

    A sample stands for the time since the one before. So a spell's effect is continuous in both parameters,
    and a fit finds the moment within a fraction of a sample. With an ``ease``, s, it begins and ends within that time,
    the moments in the middle."""
    step, since = _stood(time) + ease, time - moment + 0.5 * ease
    return np.asarray(np.clip(since / step, 0.0, 1.0) - np.clip((since - duration) / step, 0.0, 1.0))


def _stood(time: FloatArray) -> FloatArray:
    """s (n,) before each sample for which it stands."""
    return np.clip(np.diff(time, prepend=time[0] - LONGEST_STEP), 1e-9, LONGEST_STEP)


def offset_for_a_while(time: FloatArray, u: FloatArray, amount: float, moment: float, duration: float) -> FloatArray:
    """u + amount for a while."""
    return u + amount * spell(time, moment, duration)


def gain_for_a_while(
    time: FloatArray, u: FloatArray, error: float, moment: float, duration: float, ease: float = 0.0
) -> FloatArray:
    """u (1 + error) for a while."""
    return u * (1.0 + error * spell(time, moment, duration, ease))


def softer_for_a_while(
    time: FloatArray, u: FloatArray, change: float, moment: float, duration: float, ease: float = 0.0
) -> FloatArray:
    """u / (1 + change) for a while."""
    return _of_stiffer(u, change * spell(time, moment, duration, ease))


def _of_stiffer(u: FloatArray, change: FloatArray) -> FloatArray:
    """u / (1 + change): the response of something stiffer, where the denominator stays above 0.05."""
    return np.asarray(u / np.maximum(1.0 + change, 0.05))


def flawed(time: FloatArray, u: FloatArray, amount: float, at: float, width: float) -> FloatArray:
    """u + amount about one value ``at`` of it, within some ``width``: a scratch on a scale."""
    return u + amount * np.exp(-(((u - at) / width) ** 2))


def fading_offset(time: FloatArray, u: FloatArray, amount: float, tau: float, *marks: float) -> FloatArray:
    """u + amount exp(-(t - t0)/tau), t0 the latest of ``marks``, or 0."""
    return np.asarray(u + amount * np.exp(-np.maximum(_age(time, marks), 0.0) / tau))


def jump_each_time(time: FloatArray, u: FloatArray, amount: float, later: float, *marks: float) -> FloatArray:
    """u + amount from ``later`` s after each of ``marks`` until the next; the share of it in the sample of the jump."""
    return np.asarray(u + amount * np.clip((_age(time, marks) - later) / _stood(time), 0.0, 1.0))


def _age(time: FloatArray, marks: tuple[float, ...]) -> FloatArray:
    """s (n,) since the latest of ``marks``, or since 0."""
    since = np.array([0.0, *sorted(marks)])
    return np.asarray(time - since[np.maximum(np.searchsorted(since, time, side="right") - 1, 0)])


def affine(time: FloatArray, u: FloatArray, error: float, amount: float) -> FloatArray:
    """u (1 + error) + amount: the reading of a gauge with relative gain error and offset."""
    return u * (1.0 + error) + amount if error or amount else u


def misread(time: FloatArray, command: FloatArray, error: float, amount: float) -> FloatArray:
    """The suction (negative) that a loop closed by such a gauge makes of its command: the true pressure at which the
    gauge shows it. Vented, it holds nothing."""
    return np.where(command < 0.0, np.minimum((command - amount) / (1.0 + error), 0.0), command)


def bent(time: FloatArray, u: FloatArray, error: float, knee: float) -> FloatArray:
    """u of two slopes: 1 within ±``knee``, 1 + error beyond."""
    return u + error * dead_zone(time, u, knee)


def quadratic(time: FloatArray, u: FloatArray, error: float, reference: float) -> FloatArray:
    """u (1 + error u / reference)."""
    return u * (1.0 + error * u / reference)


def cubic(time: FloatArray, u: FloatArray, error: float, reference: float) -> FloatArray:
    """u (1 + error (u / reference)²): cubic stiffness, radial distortion."""
    return u * (1.0 + error * (u / reference) ** 2)


FARTHEST, NEWTON, STEEPEST = 10.0, 6, 0.1
"""Times its reference above which a gauge's error grows no more, as no reading is believed there; steps in which a
bend is undone, and the least slope it has for them: where a gauge reads the less the more there is, no loop closes."""


def bent_alike(time: FloatArray, u: FloatArray, error: float, reference: float, power: float) -> FloatArray:
    """u (1 + error |u / reference|^power): of either sign alike, as a transformer's core near the end of its coils."""
    times = np.minimum(np.abs(u / reference), FARTHEST)
    return np.asarray(u * (1.0 + error * times**power))


def unbent_alike(time: FloatArray, u: FloatArray, error: float, reference: float, power: float) -> FloatArray:
    """The pressure that a gauge `bent_alike` reads as ``u``: a loop over it holds the reading where it is asked for."""
    true, most = u, FARTHEST * reference
    for _ in range(NEWTON):
        bend = error * np.abs(true / reference) ** power
        step = (true * (1.0 + bend) - u) / np.maximum(1.0 + (1.0 + power) * bend, STEEPEST)
        true = np.clip(true - step, -most, most)
    return np.asarray(true)


def saturation(time: FloatArray, u: FloatArray, limit: float, soft: float = 0.0) -> FloatArray:
    """u within ±limit: clipped, or bent smoothly (u / (1 + |u/limit|^6)^(1/6)) where ``soft`` is 1."""
    if soft > 0.5:
        return np.asarray(u / (1.0 + np.abs(u / limit) ** 6) ** (1.0 / 6.0))
    return np.clip(u, -limit, limit)


def saturation_one_way(time: FloatArray, u: FloatArray, limit: float, way: float) -> FloatArray:
    """u that is bent towards the limit where it has the sign of ``way`` alone: a preloaded transducer reads tension
    until its preload is used up."""
    return np.where(u * way > 0.0, saturation(time, u, limit, 1.0), u)


def dead_zone(time: FloatArray, u: FloatArray, half_width: float) -> FloatArray:
    """Zero within ±half_width, u less that beyond."""
    return u - np.clip(u, -half_width, half_width)


def quantisation(time: FloatArray, u: FloatArray, step: float) -> FloatArray:
    """u in whole steps (0: as it is)."""
    return np.round(u / step) * step if step > 0.0 else u


def leak(time: FloatArray, u: FloatArray, share: float, exponent: float, reference: float) -> FloatArray:
    """u less ``share`` of it at ``reference``, as |u|^(1 + exponent): 0 laminar leak, -0.5 orifice, 1 that opens."""
    return np.asarray(u - share * np.copysign(reference * (np.abs(u) / reference) ** (1.0 + exponent), u))


def lifted(time: FloatArray, u: FloatArray, share: float, knee: float, power: float, reference: float) -> FloatArray:
    """u less ``share`` of the ``reference`` there, in proportion to the ``power`` of |u| - ``knee`` beyond the knee."""
    beyond = np.abs(dead_zone(time, u, knee)) / (reference - knee)
    return np.asarray(u - share * np.copysign(reference * beyond**power, u))


def coulomb(time: FloatArray, speed: FloatArray, force: float, smoothing: float) -> FloatArray:
    """Friction force of ``speed``: ±force, smoothed by tanh(speed / smoothing); sharp where smoothing is 0."""
    return force * (np.tanh(speed / smoothing) if smoothing > 0.0 else np.sign(speed))


def stribeck(
    time: FloatArray, speed: FloatArray, force: float, stiction: float, stribeck_speed: float, smoothing: float
) -> FloatArray:
    """Friction force of ``speed``: ``force``, and ``stiction`` above it that fades as exp(-(speed/stribeck_speed)²)."""
    level = force + stiction * np.exp(-((speed / stribeck_speed) ** 2))
    return level * coulomb(time, speed, 1.0, smoothing)


def course(time: FloatArray, tau: float, form: float, phase: float = 0.0) -> FloatArray:
    """How something slow runs with the clock: 0 linear t/tau, 1 saturating 1 - exp(-t/tau), 2 swinging
    sin(2π(t/tau - phase))."""
    if form < 0.5:
        return time / tau
    return -np.expm1(-np.maximum(time, 0.0) / tau) if form < 1.5 else np.sin(2 * np.pi * (time / tau - phase))


def drift(time: FloatArray, u: FloatArray, amount: float, tau: float, form: float, phase: float = 0.0) -> FloatArray:
    """u + amount · ``course``."""
    return u + amount * course(time, tau, form, phase)


def gain_drift(
    time: FloatArray, u: FloatArray, amount: float, tau: float, form: float, phase: float = 0.0
) -> FloatArray:
    """u (1 + amount · ``course``)."""
    return u * (1.0 + amount * course(time, tau, form, phase))


def without_gain_drift(
    time: FloatArray, u: FloatArray, amount: float, tau: float, form: float, phase: float = 0.0
) -> FloatArray:
    """The signal that ``gain_drift`` shows as ``u``."""
    return u / (1.0 + amount * course(time, tau, form, phase))


def stiffness_drift(
    time: FloatArray, u: FloatArray, amount: float, tau: float, form: float, phase: float = 0.0
) -> FloatArray:
    """u / (1 + amount · ``course``)."""
    return _of_stiffer(u, amount * course(time, tau, form, phase))


def stiffening(time: FloatArray, u: FloatArray, strength: float, exponent: float, reference: float) -> FloatArray:
    """u / (1 + strength |u/reference|^n)^(1/n): grows ever more slowly, never falls."""
    return np.asarray(u / (1.0 + strength * np.abs(u / reference) ** exponent) ** (1.0 / exponent))


def ramp(u: FloatArray, start: float, width: float) -> FloatArray:
    """(u - start)+ with its corner rounded over ``width`` (softplus), zero at u = 0."""
    return np.asarray(width * (np.logaddexp(0.0, (u - start) / width) - np.logaddexp(0.0, -start / width)))


def layered(time: FloatArray, u: FloatArray, stiffness: float, start: float, width: float) -> FloatArray:
    """u whose slope falls to 1 / (1 + stiffness) beyond ``start``: a second spring takes part."""
    extra = stiffness / (1.0 + stiffness)
    return u - extra * np.copysign(ramp(np.abs(u), start, width), u)


def pulse(
    time: FloatArray, u: FloatArray, amplitude: float, frequency: float, phase: float, sine: float, cosine: float
) -> FloatArray:
    """u + amplitude (sin a + sine sin 2a + cosine cos 2a), a = 2 pi frequency t + phase: a beat rises faster than it
    falls, a breath rests between."""
    a = 2 * np.pi * frequency * time + phase
    return u + amplitude * (np.sin(a) + sine * np.sin(2 * a) + cosine * np.cos(2 * a))


SWINGS = (0.03, 0.1, 0.25)
"""Hz of the bands (VLF, LF, HF) in which a heart's rate varies (Task Force of ESC and NASPE 1996);"""
SWING = 0.04
"""and by which share in each: an rms of 5 % in all, as of 50 ms in a second (SDNN)."""


def wandering_pulse(time: FloatArray, u: FloatArray, amplitude: float, frequency: float, seed: float) -> FloatArray:
    """u + amplitude sin a, a the integral of 2 pi f (t), a ``frequency`` that swings at `SWINGS` by `SWING` each, drawn
    by a ``seed``."""
    begins = np.random.default_rng(round(seed)).uniform(0.0, 2 * np.pi, len(SWINGS) + 1)
    swings = zip(SWINGS, begins[1:], strict=True)
    wandered = sum(SWING * np.sin(2 * np.pi * rate * time + begin) / (2 * np.pi * rate) for rate, begin in swings)
    return np.asarray(u + amplitude * np.sin(2 * np.pi * frequency * (time + wandered) + begins[0]))


def through_zero(time: FloatArray, u: FloatArray, amount: float, distance: float) -> FloatArray:
    """u + amount (1 - exp(-|u|/distance)) with u's sign: an error that is there as soon as there is a signal."""
    return u - amount * np.copysign(np.expm1(-np.abs(u) / distance), u)
