"""Generic effects where they can act in a rig: at the model's taps, with priors in the units of its signals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gap.data.noise import Counts
from gap.inference.hypothesis import Candidate
from gap.rig.catalogue import GENERIC
from gap.rig.generic import INITIAL, GenericEffect, counted
from gap.rig.model import ForwardModel
from gap.rig.taps import Seen, scaled
from sim_devices.chain import FloatArray, Parameter

BOTH_WAYS = 0.3
"""Share of the larger way that a signal must go the other way to have a limit on both sides."""
HARDLY = 1e-3
"""Share of its size by which a signal moves at least to come to an end of its range."""
NOTHING = 1e-9
"""Share of a larger signal below which one counts as nought."""


@dataclass(frozen=True)
class Rig:
    """The facts of a rig that its effects' priors scale with.

    ``seen`` has the statistics of each tap in a nominal run, ``counts`` the coarse channels; ``measured`` is the
    largest range of a channel, ``unit`` that of the first, and ``ends`` each channel's lowest and highest value and by
    how much noise may have moved them. A recording lasts ``duration`` s with samples every ``interval`` s, and there
    are ``recordings`` of them.
    """

    model: ForwardModel
    seen: Mapping[str, Seen]
    counts: Mapping[str, Counts]
    unit: str
    measured: float
    interval: float
    duration: float
    recordings: int
    ends: Mapping[str, tuple[float, float, float]]

    def library(self, further: Sequence[GenericEffect] = ()) -> Iterator[tuple[Candidate, GenericEffect]]:
        """Every effect at every tap where it can act and would show: ours, the model's own and ``further`` ones."""
        effects = (*GENERIC, *getattr(self.model, "effects", ()), *further)
        for tap, stage in self.model.stages.items():
            if tap not in self.seen:
                continue
            for effect in effects:
                if can_act(effect, tap, self.seen[tap]) and would_show(effect, self.seen[tap], self.measured):
                    yield self._candidate(effect, tap, stage)

    def _candidate(self, effect: GenericEffect, tap: str, stage: str) -> tuple[Candidate, GenericEffect]:
        unit = getattr(self.model, "units", {}).get(tap) or self.unit
        if effect.name == "quantisation" and tap in self.counts:
            effect = counted(self.counts[tap], unit)

        def of_rig(parameter: Parameter) -> Parameter:
            own = scaled(parameter, self.seen[tap], self.measured, self.interval, self.duration, unit)
            return at_a_sensors_end(own, effect, *self.ends[tap]) if tap in self.ends else own

        candidate = Candidate(
            key=f"{effect.form or effect.name}@{tap}",
            name=effect.name,
            stage=stage,
            parameters=_of_each_recording(effect.parameters, self.recordings, of_rig),
            blocks=("rig",),
            meaning=f"{effect.meaning} (at {tap})",
            remedy=effect.remedy,
        )
        return candidate, effect


def can_act(effect: GenericEffect, tap: str, seen: Seen) -> bool:
    """Whether a tap gives an effect all that it acts with."""
    return (
        (not effect.taps or tap in effect.taps)
        and {effect.needs, effect.beside} - {""} <= set(seen.related)
        and (not effect.of_turns or seen.turns(effect.needs))
        and (not effect.of_net or not seen.opposes)
        and (not effect.looks_ahead or seen.whole)
    )


def would_show(effect: GenericEffect, seen: Seen, measured: float) -> bool:
    """Whether an effect at a tap could change anything, in channels with a range of ``measured``."""
    size = max(abs(seen.low), abs(seen.high))
    if size < NOTHING * measured and not effect.needs:
        return False  # a tap that carries nothing nominally can only gain something from a related signal
    still = seen.high - seen.low < HARDLY * size
    one_way = min(-seen.low, seen.high) < BOTH_WAYS * size
    ends = {p.unit for p in effect.parameters}
    return not (still and ends & {"level", "size"}) and not (one_way and "size" in ends)  # it ends at no limit


def at_a_sensors_end(parameter: Parameter, effect: GenericEffect, low: float, high: float, noise: float) -> Parameter:
    """The limit of a saturation at a channel's own tap, within ``noise`` of where the channel's values, ``low`` to
    ``high``, end: a sensor reads nothing beyond its limit, and one farther off would show nowhere. Any other parameter
    as it is."""
    if parameter.name != "limit":
        return parameter
    end = {"lower_saturation": low, "symmetric_saturation": max(-low, high)}.get(effect.form or effect.name, high)
    return replace(parameter, low=end - noise, high=end + noise, default=end)


def _of_each_recording(
    parameters: Sequence[Parameter], recordings: int, of_rig: Callable[[Parameter], Parameter]
) -> tuple[Parameter, ...]:
    """The parameters of an effect; of the state in which a recording begins, one for each."""
    out: list[Parameter] = []
    for parameter in map(of_rig, parameters):
        if parameter.name == INITIAL and recordings > 1:
            out += [replace(parameter, name=f"{INITIAL}_{k}") for k in range(1, recordings + 1)]
        else:
            out.append(parameter)
    return tuple(out)


def widest_range(channels: Sequence[Sequence[FloatArray]]) -> float:
    """The largest range of finite values of any channel in any recording."""
    return float(max(np.ptp(m[np.isfinite(m)]) for ms in channels for m in ms))
