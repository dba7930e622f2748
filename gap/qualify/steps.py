"""The standard set of each instrument: the mounted specimen, the protocol, and the instruction to the person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from protocols.specimens import SPECIMENS, Stated, check_complete, stated


@dataclass(frozen=True)
class Step:
    """One recording: the specimen with its known properties, and a protocol of the library."""

    name: str
    specimen: str
    protocol: str
    known: Mapping[str, Stated] = field(default_factory=dict)

    @property
    def instruction(self) -> str:
        """The instruction for the person at the bench."""
        reference = SPECIMENS[self.specimen]
        numbers = ", ".join(reference.property(key).in_words(value) for key, value in self.known.items())
        return reference.instruction + (f" ({numbers})" if numbers else "")


def _step(name: str, specimen: str, protocol: str, **known: object) -> Step:
    return Step(name, specimen, protocol, stated(specimen, known))


def _suction(instrument: str) -> tuple[Step, ...]:
    return (
        _step("block", "rigid block", f"qualify-block-{instrument}"),
        _step("step-low", "gauge step", f"qualify-step-{instrument}", height="0.500±0.002 mm"),
        _step("step-mid", "gauge step", f"qualify-step-{instrument}", height="1.000±0.002 mm"),
        _step("step-high", "gauge step", f"qualify-step-{instrument}", height="1.500±0.002 mm"),
        _step("membrane", "reference membrane", f"qualify-membrane-{instrument}", memory=0.01),
        _step("manometer", "manometer", f"qualify-manometer-{instrument}"),
    )


def _weight(name: str, direction: str) -> Step:
    return _step(name, "dead weight", "qualify-weight-microrobot", mass="50.00±0.05 g", direction=f"{direction} ± 0.01")


STANDARD: Mapping[str, tuple[Step, ...]] = {
    "cutometer": _suction("cutometer"),
    "aspiration": _suction("aspiration"),
    "microrobot": (
        _step("air", "open air", "qualify-air-microrobot"),
        _step("spring", "reference spring", "qualify-spring-microrobot", k="400±4 N/m"),
        _weight("weight-down", "0, 0, -1"),
        _weight("weight-x", "1, 0, 0"),
        _weight("weight-y", "0, 1, 0"),
    ),
}
"""The measured steps, in this order. The numbers are those of the simulated references; a laboratory states its own."""


def steps_of(instrument: str, properties: Sequence[str] = ()) -> tuple[Step, ...]:
    """The standard set, with a laboratory's own numbers: each of ``properties`` is ``STEP.KEY=VALUE``.

    Raises ValueError that names the step or key it cannot use.
    """
    if instrument not in STANDARD:
        raise ValueError(f"no standard set for {instrument!r}; there is one for {', '.join(STANDARD)}")
    steps = {step.name: step for step in STANDARD[instrument]}
    for text in properties:
        place, equals, value = text.partition("=")
        name, dot, key = place.strip().partition(".")
        if not equals or not dot or name not in steps:
            raise ValueError(f"{text!r}: expected STEP.KEY=VALUE, with a step of {', '.join(steps)}")
        step = steps[name]
        try:
            steps[name] = replace(step, known={**step.known, **stated(step.specimen, {key: value})})
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
    for step in steps.values():
        check_complete(step.specimen, instrument, step.known)
    return tuple(steps.values())
