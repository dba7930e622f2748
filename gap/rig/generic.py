"""Effects that any rig can have, acting on one of its signals through a *tap*.

A model calls ``tap("force", values, velocity=v)`` where something could act; the nominal chain returns the values
unchanged. Taps are causal and keep a state, so a model may call them on whole series or sample by sample inside its own
integration loop. `gap.rig.catalogue` lists them, `gap.rig.generic_laws` has their laws.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from gap.data.noise import Counts
from gap.rig.generic_laws import State
from sim_devices.chain import FloatArray, Parameter

INITIAL = "initial"
"""Name of a parameter that says how a recording began: every recording has one of its own."""


@dataclass(frozen=True)
class GenericEffect:
    """``act(state, time, values, related, p)`` returns the changed values; ``needs`` names the related signal it acts
    with, ``beside`` another one. What ``resists`` motion adds to a tapped resistance and is taken from a tapped net
    force. A ``form`` tells apart effects that are one concept of one name. An effect ``of_turns`` shows only where the
    signal it acts with turns back: on one way it is nothing but a bent characteristic. ``looks_ahead`` ones need whole
    series: they can act on an input, which is known beforehand, not inside a model's own integration. One ``of_net``
    acts on a net force alone, which moves nothing where friction holds it. ``taps`` are the only ones it fits; none
    named: all.

    Parameters of unit ``signal`` have priors relative to the range of the signal, ``velocity`` and ``position``
    relative to those of the related one; they are scaled when the effect meets its rig. A ``level`` is one between the
    signal's lowest and highest value, a ``size`` a share of its greatest.
    """

    name: str
    meaning: str
    remedy: str
    parameters: tuple[Parameter, ...]
    act: Callable[
        [State, FloatArray, FloatArray, Mapping[str, FloatArray], Mapping[str, float]],
        FloatArray,
    ]
    needs: str = ""
    beside: str = ""
    resists: bool = False
    form: str = ""
    of_turns: bool = False
    looks_ahead: bool = False
    of_net: bool = False
    taps: tuple[str, ...] = ()


def counted(counts: Counts, unit: str) -> GenericEffect:
    """Coarse steps of a channel whose counts can be read from it: up to the ``step`` seen, the nearest count."""
    thresholds = 0.5 * (counts.levels[1:] + counts.levels[:-1])

    def nearest(
        state: State,
        time: FloatArray,
        y: FloatArray,
        related: Mapping[str, FloatArray],
        p: Mapping[str, float],
    ) -> FloatArray:
        share = p["step"] / counts.step
        return np.asarray((1 - share) * y + share * counts.levels[np.searchsorted(thresholds, y)])

    step = Parameter("step", unit, 0.0, 1.2 * counts.step, null=0.0, default=counts.step)
    return GenericEffect("quantisation", "coarse steps", "a finer converter or range", (step,), nearest)
