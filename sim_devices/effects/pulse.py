"""A person's pulse or breath: a rhythm that the nominal tissue does not have, steady or of a rate that wanders."""

from __future__ import annotations

import math

from sim_devices.chain import Chain, Effect, Parameter
from sim_devices.effects.build import (
    CHOICE,
    ROBOT,
    SUCTION,
    Install,
    Values,
    Wander,
    choice,
    chosen,
    effect,
    map_after,
    shape,
    strength,
)
from sim_devices.effects.sheet_forces import to_and_fro, wandering_force
from sim_devices.stages import laws
from sim_devices.stages.operators import Map, Names, after
from sim_devices.stages.robot import TRANSDUCERS

NAME, STAGE = "pulse_breathing", "tissue"


def _moves(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 1:
        return map_after(
            chain, "softening", NAME, STAGE, laws.wandering_pulse, (v["amplitude"], v["frequency"], v["seed"])
        )
    parameters = (v["amplitude"], v["frequency"], v["phase"], v["second_sine"], v["second_cosine"])
    return map_after(chain, "softening", NAME, STAGE, laws.pulse, parameters)


def _moves_by_chance(v: Values) -> dict[str, float]:
    return {"apex_height": v["amplitude"] / math.sqrt(2.0)} if chosen(v, "form") == 1 else {}


def _pushes(chain: Chain, v: Values) -> Chain:
    direction = (v["azimuth"], v["elevation"])
    if chosen(v, "form") == 2:
        wanders = (v["amplitude"], v["frequency"], v["seed"], *direction)
        return after(chain, "tissue", lambda s, t: Map(NAME, STAGE, s, t, wandering_force, wanders))
    rhythm = (v["frequency"], v["phase"], *direction, v["second_sine"], v["second_cosine"])
    if chosen(v, "form") == 0:
        return after(chain, "tissue", lambda s, t: Map(NAME, STAGE, s, t, to_and_fro, (v["amplitude"], *rhythm)))
    return after(chain, "glue", lambda s, t: Map(NAME, STAGE, s, t, to_and_fro, (-v["motion"], *rhythm)))


def _pushes_by_chance(v: Values) -> dict[str, float]:
    """Of each transducer: it has a third of the mean square of a force whose direction is not known."""
    return dict.fromkeys(TRANSDUCERS, v["amplitude"] / math.sqrt(6.0)) if chosen(v, "form") == 2 else {}


def _pulse(
    instruments: Names, strengths: tuple[Parameter, ...], install: Install, rhythm: Wander, steady: tuple[int, ...],
    *further: Parameter,
) -> Effect:  # fmt: skip
    return effect(
        NAME, STAGE, instruments,
        "Periodic motion by heart beat or breath.",
        "Average over beats, or record pulse and breath and subtract.",
        "0.15 to 0.4 Hz breath, 0.8 to 2 Hz pulse; Task Force 1996 for the variability of the heart's rate",
        (
            *strengths,
            shape("frequency", "Hz", 0.15, 2.0, 1.1, log=True, fine=1e-5),
            shape("phase", "rad", 0.0, 2 * math.pi, 0.0, only=steady),
            *further,
            shape("second_sine", "1", -0.8, 0.8, 0.21, "of the second harmonic: of twice the phase, against the first",
                  only=steady),
            shape("second_cosine", "1", -0.8, 0.8, 0.21, "the same of its cosine", only=steady),
            shape("seed", CHOICE, 0, 9, 1, "which course: another number, another one", only=(steady[-1] + 1,)),
        ),
        install,
        rhythm=rhythm,
    )  # fmt: skip


EFFECTS = (
    _pulse(
        SUCTION,
        (strength("amplitude", "m", 1e-7, 3e-4, 1.5e-5),),
        _moves,
        _moves_by_chance,
        (0,),
        choice("form", 0, "steady", "whose rate wanders"),
    ),
    _pulse(
        ROBOT,
        (
            strength("amplitude", "N", 2e-5, 0.3, 0.03, only=(0, 2)),
            strength("motion", "m", 3e-8, 1e-3, 5e-5, only=(1,)),
        ),
        _pushes,
        _pushes_by_chance,
        (0, 1),
        choice("form", 0, "a force on the probe", "the skin moves under it", "a force whose rate wanders"),
        shape("azimuth", "rad", 0.0, 2 * math.pi, 0.5, "of its direction, in plane"),
        shape("elevation", "rad", -0.5 * math.pi, 0.5 * math.pi, 1.1, "of its direction, out of the plane"),
    ),
)
