"""Deterministic signatures: defects that a channel shows by itself, before any model is fitted.

A converter that clips, repeats, skips or coarsens leaves marks that no physics makes. They are found in the samples
themselves and enter the comparison as evidence (in nats) for the effects that make them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.stats import gamma

from acquire.plugins import instrument
from acquire.recording.model import Recording, Series
from gap.data.lines import DIFFERENCE, Spectra, differences, rate_of, without_the_loudest
from gap.data.noise import grid_step, high_band_sigma
from gap.data.polled import looks_at_commands
from gap.data.repeats import copied_rows, held_values, repeated_values, repeats_surprise, runs_of, stale_rows
from sim_devices.chain import FloatArray

CERTAIN = 30.0
"""Nats of a signature that admits no other reading."""
AT_REST = 5
"""Equal samples in a row that a channel with noise of its own has by no chance."""
PILE, PILE_LEVELS, PILE_NEAR = 6.0, 12, 0.1
"""Times more often than at any other level that a channel stands at its end to be cut off there, and how many levels
there must be within which share of its range."""
NO_MORE = 3
"""Repeats beyond those foretold, and what chance adds to these, that are none."""
SURPRISING = 14.0
"""Nats against more repeats by chance: of thousands of channels none has so many."""
COARSER = 1.3
"""Steps against the nominal resolution above which a channel counts as coarse."""
LEVELS_NEAR = 8
"""Steps either way within which a scale's bend is nothing."""
UNEVEN, UNEVENLY = 0.03, 0.25
"""Share by which a step is no multiple of the smallest near it, and share of such steps from which on they are
uneven. A converter's codes times a constant are even to the last digit of the file, which is allowed for."""
SHOWN = 1.05
"""Times that uneven steps must widen the noise to be told: those of a command are its levels."""
SHAKEN_LEVELS, SHAKEN_VISITS, SHAKEN = 100, 3, (0.3, 10.0)
"""Levels, how often each is usually met, and noise in steps, from which on uneven steps are the converter's, whatever
they add to the noise: no command chose these levels. In more noise than that they do no harm."""
AGAIN = 15
"""Times that a size of a step comes again to be one of the converter's."""
ROUNDED = 1.155
"""The same of even steps. Up to two σ of the noise a step only adds its square over twelve (Widrow and Kollár,
*Quantization Noise*, 2008): a laboratory that writes few digits has no fault."""
HUM = "periodic_disturbance"
"""A line in a channel's noise: a pump, say. No effect of the library makes it."""
MAINS = "mains_pick_up"
"""Such a line at the frequency of the mains: cables pick it up. It moves nothing and widens the noise."""
GRIDS = (50.0, 60.0)
"""Hz: nominal frequencies of public supplies."""
OFF_GRID = 0.01
"""Share by which a supply's frequency is off: EN 50160 has 1 % for 99.5 % of a year."""
HARMONICS = 5
"""Of the mains' that show in a record."""
HUM_FROM = 8
"""A line's frequency is at least the sampling rate over this: slower ones may be of the person, or of a swept path."""
HUM_CHANCE = 1e-9
"""Chance that noise alone has such a line. Of eighty development sessions two with a hum had 1e-39 and less, the others
2e-5 and more."""
HUM_WIDTH = 1.0
"""Hz within which noise, and the trace of a step, have an even spectrum, as a line has not."""
BEND = 0.05
"""s before and after a sample over which an edge bends the signal, as noise and a slow path do not,"""
EDGE = 8.0
"""by more than so many times the median bend."""
EDGE_NEAR = 0.3
"""s about such an edge that are left out: seven time constants of a pressure regulator."""


@dataclass(frozen=True)
class Signature:
    """A mark in ``channel`` made by an effect named ``effect``: ``nats`` of evidence, ``text`` for people. The effects
    of ``also`` leave the same. ``noise`` is how many times wider the defect makes the channel's noise, which a gap,
    told in units of that noise, does not show; ``alone``, whether it then acts whatever else does. One that is
    ``certain`` has no other cause, however little that moves."""

    effect: str
    channel: str
    nats: float
    text: str
    also: tuple[str, ...] = ()
    noise: float = 1.0
    alone: bool = True
    certain: bool = False


def find(recordings: Sequence[Recording], channels: Sequence[str] | None = None) -> list[Signature]:
    """All signatures in the measured channels, or in those of a rig named ``channels``: inputs of a model,
    such as a command that stands at its end, are taken as they are. A rig may stand still or swing, so that repeats and
    lines say nothing."""
    out: list[Signature] = []
    nominal = _resolutions(recordings[0].info.instrument)
    for name in _measured(recordings):
        series = [r.streams[name] for r in recordings if name in r.streams and len(r.streams[name].value) > 30]
        if not series or (channels is not None and name not in channels):
            continue
        out += _clipping(name, series) + _lost(name, series)
        out += [*_repeats(name, series), *_hum(name, series)] if channels is None else []
        out += _coarse(name, series, nominal.get(name, np.inf))
    if channels is not None:
        return out
    looks = _looks(recordings)
    # A line that goes with the speed is no pump's.
    return [s for s in out if not looks or s.effect != HUM] + _old_rows(recordings) + looks


def _measured(recordings: Sequence[Recording]) -> list[str]:
    """The channels that are measured, not computed from others as a robot's probe position and force are."""
    computed = ("probe_", "force_") if any("transducer_force_a" in r.streams for r in recordings) else ()
    return list(dict.fromkeys(n for r in recordings for n in r.streams if not n.startswith(computed or "\0")))


def _resolutions(kind: str) -> dict[str, float]:
    """Nominal resolution of an instrument's channels, SI; nothing of a rig that is not ours."""
    try:
        return {c.name: c.resolution for c in instrument(kind).channels}
    except ValueError:
        return {}


def _clipping(name: str, series: Sequence[Series]) -> list[Signature]:
    """Runs at the extreme value that the signal enters and leaves with a slope.

    A converter at its end holds one exact value; a plateau of a physical signal carries noise, and one that is only
    quantised is approached step by step. Where a channel stands still at other values too, as that of a servo at rest
    short of its set-point does, stillness at an extreme says nothing.
    """
    out = []
    value = np.concatenate([s.value[np.isfinite(s.value)] for s in series])
    span = float(np.ptp(value))
    if span == 0:
        return []
    for effect, sign in (("saturation", 1.0), ("lower_saturation", -1.0)):
        top = float(np.max(sign * value))
        at = np.isclose(sign * value, top, rtol=0, atol=1e-9 * span)
        near = float(np.mean((sign * value < top - 1e-9 * span) & (sign * value > top - 0.03 * span)))
        step = max(grid_step(value), 3 * high_band_sigma(value), 0.003 * span)
        clipped = 0
        for b, e in runs_of(at):
            before = sign * value[max(b - max(3, (e - b) // 2), 0) : b]
            # A slow signal on a coarse grid also dwells at its largest value, but it comes there step by step.
            if e - b >= 3 and len(before) >= 3 and top - float(np.mean(before)) > 2 * step:
                clipped += e - b
        share = clipped / len(value)
        sloped = share > 0.005 and share > 1.2 * near and share > _still(value[~at])
        if not sloped and _piles_up(sign * value, top, span) and np.mean(at) > _still(value[~at]):
            sloped, share = True, float(np.mean(at))
        if sloped:
            text = f"{name} stands at {sign * top:.4g} exactly in {100 * share:.1f} % of its samples"
            out.append(Signature(effect, name, CERTAIN, text))
    return out


def _piles_up(value: FloatArray, top: float, span: float) -> bool:
    """Whether a channel whose noise spreads over many levels stands at its ``top`` so often as at no other near it: it
    creeps up to an end of its range, and noise takes it below again and again."""
    levels, times = np.unique(value, return_counts=True)
    beside = times[(levels < top - 1e-9 * span) & (levels > top - PILE_NEAR * span)]
    return len(beside) >= PILE_LEVELS and bool(times[-1] >= PILE * max(float(np.max(beside)), 2.0))


def _still(value: FloatArray) -> float:
    """Share of samples (n,) in runs of one exact value, `AT_REST` samples long at least."""
    runs = runs_of(np.r_[False, np.diff(value) == 0]) if len(value) > 1 else []
    return sum(e - b + 1 for b, e in runs if e - b + 1 >= AT_REST) / max(len(value), 1)


def _repeats(name: str, series: Sequence[Series]) -> list[Signature]:
    """More exact repeats of the last value than the spread of its changes foretells.

    On a grid, changes of nought are as frequent as small changes either way, however fine the grid is; off a grid,
    noise never repeats. A value held for long, from which the channel jumps, is certainly an old one.
    """
    held, nats = held_values(series)
    if held >= NO_MORE and nats > SURPRISING:
        text = f"{name} holds a value {held} times for longer than its noise lets it, and jumps then"
        return [Signature("dropped_samples", name, CERTAIN, text, certain=True)]
    repeated, expected, counted = repeated_values(series)
    surprise = repeats_surprise(repeated, expected)
    if counted and repeated > 5 and repeated > 1.3 * expected and surprise > SURPRISING:
        text = f"{name} repeats its last value {repeated} times where {expected:.0f} are expected"
        # A device asked twice for the same value gives an old one under a new stamp.
        return [Signature("dropped_samples", name, min(surprise, CERTAIN), text, ("late_samples",))]
    return []


def _looks(recordings: Sequence[Recording]) -> list[Signature]:
    """The ripple of a command that is held until a controller looks at it next, in the channels that follow it."""
    followed = [n for n in _measured(recordings) if n == "pressure" or n.startswith("axis_position")]
    frequency = looks_at_commands(recordings, followed)
    if frequency is None:
        return []
    text = f"{followed[0]} has a ripple at {frequency:.1f} Hz (or its alias by sampling) that goes with the speed"
    # Samples taken at moments that beat about the stamped ones leave the same line.
    return [Signature("latency", followed[0], CERTAIN, text, ("jitter",), certain=True)]


def _old_rows(recordings: Sequence[Recording]) -> list[Signature]:
    """Samples in which all channels of an instrument stand at once, or come again later, as they do where an old one is
    written again."""
    names = _measured(recordings)
    rows, expected = stale_rows(recordings, names)
    if rows > NO_MORE + 3.0 * expected and repeats_surprise(rows, expected) > SURPRISING:
        text = f"all {len(names)} channels repeat their last values {rows} times where {expected:.2g} are expected"
        return [Signature("dropped_samples", names[0], CERTAIN, text, ("late_samples",), certain=True)]
    copies, nats = copied_rows(recordings, names)
    if copies > NO_MORE and nats > SURPRISING:
        text = f"{copies} samples are copies of older ones, in all {len(names)} channels and to the last digit"
        return [Signature("late_samples", names[0], CERTAIN, text, certain=True)]
    return []


def never_repeat(recordings: Sequence[Recording]) -> bool:
    """Whether a value repeated in place of a lost sample would show in every channel that is measured, and none is."""
    names = _measured(recordings)
    for name in names:
        series = [r.streams[name] for r in recordings if name in r.streams]
        repeated, expected, counted = repeated_values(series)
        if counted < sum(len(s.value) for s in series) or repeated > expected + 3.0 * np.sqrt(expected) + NO_MORE:
            return False
    return bool(names)


def _lost(name: str, series: Sequence[Series]) -> list[Signature]:
    """Gaps in the sequence numbers, or in otherwise even time stamps."""
    lost = 0
    for s in series:
        if s.seq is not None and len(s.seq) > 1:
            lost += int(np.sum(np.diff(s.seq) > 1))
        steps = np.diff(s.time)
        usual = float(np.median(steps))
        even = float(np.mean(np.abs(steps - usual) < 0.1 * usual)) > 0.9
        if even:
            lost += int(np.sum((steps > 1.5 * usual) & (steps < 20 * usual)))
    if lost:
        return [Signature("dropped_samples", name, CERTAIN, f"{name} has {lost} gaps in its samples")]
    return []


def _coarse(name: str, series: Sequence[Series], nominal: float) -> list[Signature]:
    """Levels that lie farther apart than the channel's ``nominal`` resolution, SI, or unevenly: a sound converter has
    steps of one size, whatever its resolution."""
    values = [s.value[np.isfinite(s.value)] for s in series]
    value = np.concatenate(values)
    levels, visits = np.unique(value, return_counts=True)
    if len(levels) < 3 or len(levels) > 0.25 * len(value):
        return []
    gaps = np.concatenate([np.diff(np.unique(v)) for v in values])  # each recording may have a zero of its own
    if not len(gaps):  # each stands still
        return []
    wider = _by_steps(value, gaps, nominal)
    shaken = len(levels) >= SHAKEN_LEVELS and float(np.median(visits)) >= SHAKEN_VISITS
    shaken &= SHAKEN[0] < high_band_sigma(value) / float(np.median(gaps)) < SHAKEN[1]
    uneven = (wider > SHOWN or shaken) and _uneven(gaps, levels)
    step = float(np.quantile(np.diff(levels), 0.1))  # sparse levels skip steps
    if not uneven and (step <= COARSER * nominal or wider <= ROUNDED):
        return []
    text = f"{name} comes in steps of {step:.3g}, {step / nominal:.1f} times its resolution"
    if uneven:
        text = f"{name} comes in uneven steps of {np.quantile(gaps, 0.1):.3g} to {np.quantile(gaps, 0.9):.3g}"
    certain = uneven and (shaken or _of_two_sizes(gaps, levels))
    return [Signature("sensor_quantisation", name, CERTAIN, text, noise=wider, certain=bool(certain))]


def _uneven(gaps: FloatArray, levels: FloatArray) -> bool:
    """Whether the ``gaps`` (n,) between neighbouring levels are often no multiples of the smallest about them: neither
    skipped levels nor a scale that bends slowly do that. Digits of a file blur a level by half a digit."""
    near = np.sort(sliding_window_view(np.pad(gaps, LEVELS_NEAR, constant_values=np.inf), 2 * LEVELS_NEAR + 1), axis=1)
    like = np.sum(near < 1.2 * near[:, :1], axis=1)
    every = np.arange(len(gaps))
    step = 0.5 * (near[every, (like - 1) // 2] + near[every, like // 2])  # the median of those
    multiple = np.maximum(np.round(gaps / step), 1.0)
    odd = np.sum(
        np.abs(gaps - multiple * step) > np.maximum(UNEVEN * multiple * step, (multiple + 1.0) * _digit(levels))
    )
    return len(gaps) >= LEVELS_NEAR and bool(odd > UNEVENLY * len(gaps))


def _of_two_sizes(gaps: FloatArray, levels: FloatArray) -> bool:
    """Whether two sizes of ``gaps`` (n,), of which one is no multiple of the other, come again and again to the last
    digit: no signal chooses such levels, however little noise visits them."""
    digit = max(_digit(levels), 1e-12)
    sizes, often = np.unique(np.round(gaps / digit), return_counts=True)
    if np.sum(often >= AGAIN) < 2:
        return False
    small, large = np.sort(sizes[np.argsort(-often, kind="stable")[:2]])
    off = abs(large - max(round(large / small), 1) * small)
    return bool(off > max(UNEVEN * large, 3.0))


def _digit(levels: FloatArray) -> float:
    """The last decimal digit of the ``levels`` (n,), SI: the largest power of ten of which all are multiples."""
    scale = float(np.max(np.abs(levels)))
    for power in range(int(np.floor(np.log10(scale))), int(np.floor(np.log10(scale))) - 9, -1):
        multiples = levels / 10.0**power
        if np.all(np.abs(multiples - np.round(multiples)) < 1e-4):
            return float(10.0**power)
    return 0.0


def _by_steps(value: FloatArray, gaps: FloatArray, nominal: float) -> float:
    """Times that a channel's noise is wider for its steps (``gaps`` between its levels) than it would be with even ones
    as fine as the finest, or as the ``nominal`` resolution if that is finer still."""
    noise = high_band_sigma(value) ** 2
    finest = float(np.min(gaps))
    rounding = float(np.mean(np.square(gaps[gaps < 3.0 * finest]))) / 12.0  # wider gaps skip levels
    fine = min(finest, nominal) ** 2 / 12.0
    return float(np.sqrt(max(noise, rounding) / max(noise - rounding, fine)))


def _hum(name: str, series: Sequence[Series]) -> list[Signature]:
    """A line in the spectrum of fourth differences, in all recordings at the same frequency.

    Each recording's power over its own running median is exponential where there is noise only, and their sum of a
    gamma distribution. Edges of the signal itself are taken out: they come back with every cycle, and such a comb has
    lines. The recording that speaks for a line the most is not counted, where there are several.
    """
    values = [v for s in series if len(v := np.asarray(s.value, dtype=float)[np.isfinite(s.value)]) > 128]
    rate = rate_of([s.time for s in series])
    if not values or rate == 0.0:
        return []
    spectra = Spectra(rate, max(len(v) for v in values))
    each = [power for v in values if (power := _quiet_power(v, spectra)) is not None]
    if not each:
        return []
    frequency = spectra.frequency
    above, counted = without_the_loudest(each)
    above[frequency < rate / HUM_FROM] = 0.0
    likely = gamma.sf(above, counted) * spectra.longest < HUM_CHANCE
    theirs = _of_the_mains(frequency, np.where(likely, above, 0.0))
    out = []
    for mark, among, more in (
        (HUM, ~theirs, " (or at its alias by sampling), as from a pump"),
        (MAINS, theirs, ", mains"),
    ):
        if np.any(likely & among):
            k = int(np.argmax(np.where(among, above, 0.0)))
            out.append(Signature(mark, name, CERTAIN, f"{name} has a line at {frequency[k]:.1f} Hz{more}"))
    return out


def _quiet_power(value: FloatArray, spectra: Spectra) -> FloatArray | None:
    """Power (k,) of the noise of a channel (n,) over the usual one, away from edges of its signal; None if little is
    left."""
    near = _edges(value, spectra.rate)[2:-2]
    noise = np.where(near, 0.0, differences(value)) * np.hanning(len(near))
    if np.mean(near) > 0.5 or not noise.any():
        return None
    passed = np.maximum(spectra.power(DIFFERENCE), 1e-12)
    return spectra.above(spectra.power(noise) / passed, HUM_WIDTH)


def _of_the_mains(frequency: NDArray[np.floating[Any]], power: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
    """Which of some frequencies (k,) Hz are of the mains, by the ``power`` of lines among them: theirs, and where there
    is such a line its harmonics as sampling folds them.

    A mains' own alias may be anywhere: only a line that is sampled fast enough is known to be one.
    """
    theirs = np.zeros(len(frequency), dtype=bool)
    for grid in GRIDS:
        near = np.abs(frequency - grid) <= OFF_GRID * grid
        if not np.any(power[near]):
            continue
        line, rate = frequency[np.argmax(np.where(near, power, 0.0))], 2.0 * frequency[-1]
        folded = np.arange(1, HARMONICS + 1) * line
        folded = np.abs(folded - rate * np.round(folded / rate))
        theirs |= near | np.any(np.abs(frequency[:, None] - folded) <= OFF_GRID * grid, axis=1)
    return theirs


def _edges(value: FloatArray, rate: float) -> NDArray[np.bool_]:
    """Where a channel (n,), sampled at ``rate`` Hz, is near an edge of its signal."""
    m = max(int(np.ceil(BEND * rate)), 1)
    bend = np.zeros(len(value))
    bend[m:-m] = np.abs(value[2 * m :] - 2.0 * value[m:-m] + value[: -2 * m])
    usual = float(np.median(bend[m:-m]))
    return np.asarray(binary_dilation(bend > EDGE * usual, iterations=max(int(EDGE_NEAR * rate), m)))
