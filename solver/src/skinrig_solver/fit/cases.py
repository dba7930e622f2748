"""From recordings to cases: the drive of a model and the data it is compared with.

Recordings are duck-typed: ``info`` (id, instrument, and the fields that `stated` reads), ``streams`` and ``setpoints``,
mappings of series with ``time``, ``value`` and ``unit`` in SI.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from typing import Any

import numpy as np

from ..api import Array, Experiment, Instrument, ModelInfo
from .noise import white_noise
from .spec import Options, Spec
from .stated import Given, Setup, setup

DRIVES = {"suction": ("pressure",), "finger": ("pressure",), "sheet": ("probe_x", "probe_y", "probe_z")}
INSTRUMENTS: dict[str, tuple[Instrument, ...]] = {
    "suction": ("cutometer", "aspiration"),
    "finger": ("cutometer", "aspiration"),
    "sheet": ("microrobot",),
}
MEASURED_AS = {"deflection": "apex_height"}  # channels of models that recordings know under another name
HEIGHTS = ("apex_height", "deflection")  # channels whose zero is that of one reading, or of a moment's mean
LOAD = 0.05  # of the largest drive: where the load begins
IDLE = 0.1  # of the largest component: a smaller one is scaled by this, so that its noise does not count as signal
_UNIT = {"pressure": "Pa", "force_x": "N", "force_y": "N", "force_z": "N"}  # all others are metres


class RecordingError(ValueError):
    """A recording that a model cannot be fitted to; the message names the recording and the channel that is missing."""


@dataclass(frozen=True)
class Case:
    """One recording as a fit sees it.

    ``data``, ``scale`` and ``weight`` are keyed by the model's channel: measured values (n,) in SI, the divisor of
    residuals (the largest measured value of each force component, paper M), and the square root of each sample's
    weight (n,). Curves in ``floating`` have an unknown zero; ``drive_noise`` is the white noise of each measured drive
    [SI]. ``note`` says how the recorded samples were prepared, ``setup`` holds the facts of the set-up.
    """

    label: str
    experiment: Experiment
    data: Mapping[str, Array]
    scale: Mapping[str, float]
    weight: Mapping[str, Array]
    note: str = ""
    setup: Setup = field(default_factory=Setup)
    floating: tuple[str, ...] = ()
    drive_noise: Mapping[str, float] = field(default_factory=dict)

    def values(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """The model's parameters for this recording: those of the fit, and held ones that its own set-up states."""
        return {**parameters, **self.setup.parameters}

    @property
    def size(self) -> int:
        """Number of compared values."""
        return sum(values.size for values in self.data.values())


def cases(recordings: Sequence[Any], spec: Spec, info: ModelInfo) -> list[Case]:
    """The recordings that ``spec`` does not skip, as cases. Raises RecordingError naming the missing channel."""
    found: list[Case] = []
    labels = _labels(recordings)
    for number, (recording, label) in enumerate(zip(recordings, labels, strict=True)):
        options = [o for o in spec.recordings if matches(o.pattern, label, recording.info.instrument, number)]
        if not any(o.skip for o in options):
            found.append(_case(recording, label, spec, info, options))
    for pattern in (o.pattern for o in spec.recordings):
        if not any(matches(pattern, str(r.info.id), r.info.instrument, k) for k, r in enumerate(recordings)):
            raise RecordingError(f"recordings.{pattern}: fits none of {', '.join(sorted(labels)) or 'no recordings'}")
    if not found:
        raise RecordingError("a fit needs at least one recording")
    return _balanced(found) if spec.balance == "recordings" else found


def _labels(recordings: Sequence[Any]) -> list[str]:
    """The recordings' ids, or numbers where they have none, made different by primes."""
    labels: list[str] = []
    for number, recording in enumerate(recordings):
        label = str(recording.info.id) or f"recording {number + 1}"
        while label in labels:
            label += "'"
        labels.append(label)
    return labels


def matches(pattern: str, label: str, instrument: str, number: int) -> bool:
    """Whether a pattern (glob) means a recording: by its id, its instrument, or its number in the call, from 1."""
    return fnmatch(label, pattern) or pattern in (instrument, str(number + 1))


def _case(recording: Any, label: str, spec: Spec, info: ModelInfo, options: Sequence[Options]) -> Case:
    instrument = recording.info.instrument
    allowed = INSTRUMENTS[info.problem]
    if instrument not in allowed:
        raise RecordingError(
            f"recording {label} is of a {instrument}; model {info.name} is fitted to {' or '.join(allowed)}"
        )
    series = {c: _stream(recording, label, MEASURED_AS.get(c, c)) for c in _channels(spec, info)}
    time, data = _common(label, series)
    drive, drive_noise, notes = _driven(recording, label, DRIVES[info.problem], spec.drive, time)
    sampled = time.size
    reduce, group = _averaged if info.problem == "sheet" else _picked, -(-sampled // spec.samples)
    time, data, drive = reduce(time, data, drive, group)
    if reduce is _averaged:
        drive_noise = {name: sd / np.sqrt(group) for name, sd in drive_noise.items()}
    if time.size < sampled:
        notes.append(f"{time.size} of {sampled} samples, {reduce.__doc__}".rstrip("."))
    weight = float(np.prod([option.weight for option in options]))
    known = setup(recording.info, info, given_by(spec, info, options))
    origin = float(time[0]) if spec.phase_origin == "recording" else _loading(time, drive)
    of_phase = _phase_weights(time - origin, spec)
    experiment = Experiment(instrument, time - time[0], drive, known.geometry, label)
    weights = {c: np.sqrt(weight * spec.channels.get(c, 1.0) * of_phase) for c in data}
    floating = tuple(c for c in data if spec.zero == "free" or (spec.zero == "auto" and c in HEIGHTS))
    return Case(label, experiment, data, _scales(label, data), weights, "; ".join(notes), known, floating, drive_noise)


def given_by(spec: Spec, info: ModelInfo, options: Sequence[Options] = ()) -> Given:
    """A specification's part in a recording's set-up."""
    geometry = dict(spec.geometry)
    for option in options:
        geometry.update(option.geometry)
    variables = spec.variables(info)
    held = {s: variables.held[s] for s in spec.parameters if s not in variables.wanted}
    return Given(geometry, held, variables.wanted)


def _channels(spec: Spec, info: ModelInfo) -> list[str]:
    """Those that are compared."""
    for channel in spec.channels:
        if channel not in info.channels:
            raise RecordingError(f"channels.{channel}: model {info.name} has {', '.join(info.channels)}")
    channels = [c for c in info.channels if spec.channels.get(c, 1.0) > 0.0]
    if not channels:
        raise RecordingError("channels: every channel has weight 0")
    return channels


def _scales(label: str, data: Mapping[str, Array]) -> dict[str, float]:
    largest = {c: float(np.abs(values).max()) for c, values in data.items()}
    if not max(largest.values()) > 0.0:
        raise RecordingError(f"recording {label}: {' and '.join(data)} are zero throughout")
    return {c: max(size, IDLE * max(largest.values())) for c, size in largest.items()}


def _driven(
    recording: Any, label: str, names: Sequence[str], wanted: str, time: Array
) -> tuple[dict[str, Array], dict[str, float], list[str]]:
    """The drives at ``time``, the noise of those that were measured, and notes of the others."""
    drive: dict[str, Array] = {}
    noise: dict[str, float] = {}
    notes: list[str] = []
    for name in names:
        source, commanded = _drive(recording, label, name, wanted)
        drive[name] = _resampled(label, name, source, time)
        if commanded and wanted == "measured":
            notes.append(f"{name} was not recorded: set-point used")
        if not commanded:
            stated = getattr(source, "noise", None)
            noise[name] = float(stated) if stated else white_noise(np.asarray(source.value, dtype=np.float64))
    return drive, noise, notes


def _stream(recording: Any, label: str, name: str) -> Any:
    if name not in recording.streams:
        have = ", ".join(recording.streams) or "none"
        raise RecordingError(f"recording {label} has no channel {name!r}; it has {have}")
    series = recording.streams[name]
    unit = _UNIT.get(name, "m")
    if series.unit != unit:
        raise RecordingError(f"recording {label}: channel {name!r} is in {series.unit!r}, not in {unit!r}")
    return series


def _drive(recording: Any, label: str, name: str, wanted: str) -> tuple[Any, bool]:
    """A drive's series, and whether it is the set-point."""
    if name in recording.streams and wanted == "measured":
        return _stream(recording, label, name), False
    if name in recording.setpoints:
        return recording.setpoints[name], True
    have = ", ".join(recording.streams) or "none"
    where = "channel or set-point" if wanted == "measured" else "set-point"
    raise RecordingError(f"recording {label} has no {where} {name!r}; its channels are {have}")


def _common(label: str, series: Mapping[str, Any]) -> tuple[Array, dict[str, Array]]:
    """The channels on the time of the first, where all are finite."""
    first = next(iter(series.values()))
    time = np.asarray(first.time, dtype=np.float64)
    order = np.flatnonzero(np.isfinite(time) & (time > np.concatenate([[-np.inf], np.fmax.accumulate(time)[:-1]])))
    time = time[order]
    data = {}
    for name, one in series.items():
        own, value = np.asarray(one.time, dtype=np.float64), np.asarray(one.value, dtype=np.float64)
        if value.ndim != 1 or value.size != own.size:
            raise RecordingError(f"recording {label}: channel {name!r} has shape {value.shape}, not one value a time")
        if one is first or np.array_equal(own, first.time):
            data[name] = value[order]
        else:
            inside = (time >= np.nanmin(own)) & (time <= np.nanmax(own))
            data[name] = np.where(inside, np.interp(time, own, value), np.nan)
    good = np.all([np.isfinite(values) for values in data.values()], axis=0)
    if good.sum() < 10:
        raise RecordingError(
            f"recording {label}: only {int(good.sum())} samples have finite values in {' and '.join(series)}"
        )
    return time[good], {name: values[good] for name, values in data.items()}


def _resampled(label: str, name: str, series: Any, time: Array) -> Array:
    own, value = np.asarray(series.time, dtype=np.float64), np.asarray(series.value, dtype=np.float64)
    good = np.isfinite(own) & np.isfinite(value)
    if not good.any():
        raise RecordingError(f"recording {label}: {name!r} has no finite value")
    return np.interp(time, own[good], value[good])


_Curves = tuple[Array, dict[str, Array], dict[str, Array]]


def _averaged(time: Array, data: dict[str, Array], drive: dict[str, Array], group: int) -> _Curves:
    """means of neighbours."""  # the sheet's drive is smooth, and means keep a signal that noise would hide
    count = time.size // group

    def mean(values: Array) -> Array:
        return np.asarray(values[: count * group].reshape(count, group).mean(axis=1))

    return mean(time), {k: mean(v) for k, v in data.items()}, {k: mean(v) for k, v in drive.items()}


def _picked(time: Array, data: dict[str, Array], drive: dict[str, Array], group: int) -> _Curves:
    """evenly picked."""  # steps of suction must stay steps
    return time[::group], {k: v[::group] for k, v in data.items()}, {k: v[::group] for k, v in drive.items()}


def _loading(time: Array, drive: Mapping[str, Array]) -> float:
    size = np.sqrt(np.sum([values**2 for values in drive.values()], axis=0))
    return float(time[np.argmax(size > LOAD * size.max())])


def _phase_weights(time: Array, spec: Spec) -> Array:
    """Each sample's weight (n,): a_i / N_i of its phase (paper F), scaled to a mean of one over the phases' samples."""
    if not spec.phases:
        return np.ones(time.size)
    weight = np.zeros(time.size)
    for phase in spec.phases:
        inside = (time >= phase.start) & (time < phase.stop)
        if inside.any():
            weight[inside] = phase.weight / inside.sum()
    if not weight.any():
        raise RecordingError("phases: no recorded sample lies in any phase of a weight above 0")
    return np.asarray(weight * np.count_nonzero(weight) / weight.sum())


def _balanced(found: list[Case]) -> list[Case]:
    mean = sum(case.size for case in found) / len(found)
    return [replace(c, weight={k: w * np.sqrt(mean / c.size) for k, w in c.weight.items()}) for c in found]
