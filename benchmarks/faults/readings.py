"""Readings that are wrong: not finite, spiking, stuck, frozen, scaled, offset, drifting, of the other sign; heights
that do not follow; two gauges that disagree."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from acquire.engine import State
from acquire.engine.plausibility import FREEZE, RESPONSE
from acquire.engine.rules import Rules
from acquire.recording import open_recording
from benchmarks.faults.rig import Rig, Stillness
from benchmarks.faults.table import Campaign, Part, Row

FULL = 100
#: Two control cycles (20 ms each), the answer of the device, and the block of samples that carries the reading.
TWO_CYCLES = 0.04 + 0.06
TRACKING = Rules().tracking["pressure"]
AGREEMENT = Rules().agreement["pressure"]
MOVING = 0.4  # s after the instrument begins to act: the set-point has just moved
HELD = TRACKING.duration + 0.5  # s after that: no longer settling
DRIFT = 6e3  # Pa/s
SLACK = 0.25  # s of wall time beyond what a rule itself takes: blocks of samples, the way to the device, its answer
#: Of the instrument's time: rules go by its clock, and take a quarter of their time here.
SPEED = 4.0
LIFT, UP = 3.0, 2.0  # s for which the skin is pulled up, and after which its height freezes
LIFTS = (
    "- {type: wait, duration: 1.5 s}\n- {type: group, repeat: 6, steps: "
    f"[{{type: hold, suction: 200 mbar, duration: {LIFT} s}}, {{type: wait, duration: 4 s}}]}}"
)
HOLD = "- {type: hold, suction: 200 mbar, duration: 1 s, repeat: 80}"


@dataclass(frozen=True)
class Group:
    """Kinds of distortion with their amounts (Pa, m; a factor) that must trip, by one of ``codes``.

    ``rule`` is how long the rule itself waits, in s of the instrument's time: 0 for what has to trip within two control
    cycles. They begin ``after`` s of acting (None: before the run), on ``channel``.
    """

    name: str
    kinds: tuple[tuple[str, float], ...]
    codes: tuple[str, ...]
    rule: float = 0.0
    after: float | None = HELD
    exception: str = ""
    channel: str = "pressure"
    reference: bool = False
    steps: str = HOLD

    @property
    def limit(self) -> float:
        """At most so long, in s of wall time."""
        return self.rule / SPEED + SLACK if self.rule else TWO_CYCLES


GROUPS: dict[str, Group] = {
    "no-number": Group("NaN, Inf", (("nan", 0.0), ("inf", 0.0)), ("nan", "value"), after=MOVING),
    "beyond": Group(
        "stuck beyond a limit, offset beyond a limit",
        (("stuck", 30e3), ("offset", -60e3)),
        ("value", "jump"),
        after=MOVING,
    ),
    "jumping": Group(
        "stuck, scaled, offset, sign-swapped within the limits, in a hold",
        (("stuck", 0.0), ("scale", 0.3), ("offset", 6e3), ("offset", -6e3), ("sign", 1.0)),
        ("jump", "value"),
        exception="a jump of less than 50 mbar is not seen by one gauge",
    ),
    "moving": Group(
        "the same just after the set-point moved",
        (("stuck", 0.0), ("scale", 0.3), ("offset", 15e3)),
        ("tracking", "jump", "value"),
        TRACKING.duration,
        MOVING,
        "less than 100 mbar in a moving run is not seen by one gauge: a leak, a lag and a wrong gauge look alike",
    ),
    "drifting": Group(
        "drifting by 60 mbar/s",
        (("drift", DRIFT), ("drift", -DRIFT)),
        ("tracking", "value"),
        TRACKING.error / DRIFT + TRACKING.duration,
        MOVING,
        "a drift slower than the run is not seen by one gauge",
    ),
    "frozen": Group("frozen in a hold", (("frozen", 0.0),), ("frozen",), FREEZE, 2.0),
    "reference": Group(
        "off by 40 mbar, by a fifth, against a second gauge",
        (("offset", 4e3), ("offset", -4e3), ("scale", 0.75)),
        ("reference",),
        AGREEMENT.duration,
        MOVING,
        "both gauges wrong alike",
        reference=True,
    ),
    "dead-height": Group(
        "height that does not rise with the suction",
        (("stuck", 0.0),),
        ("response",),
        RESPONSE,
        None,
        "where no rest goes before the pull; a height that freezes while it is up (until the release: the next row)",
        "apex_height",
        steps=LIFTS,
    ),
    "stays-up": Group(
        "height that stays up after the release",
        (("frozen", 0.0),),
        ("response",),
        LIFT - UP + RESPONSE,
        UP,
        "skin that rose by less than 80 µm; counted from the freezing, a second before the release",
        "apex_height",
        steps=LIFTS,
    ),
}


def rows(group: Group, campaign: Campaign) -> Iterator[Row]:
    """The row of one group, on the Cutometer's pressure held at -200 mbar."""
    row = Row(f"reading: {group.name}", "trips in time, by its name", "s to the safe command", group.limit)
    if group.rule:
        row.must += f" ({group.rule:.3g} s of the instrument's time, which runs {SPEED:g} times as fast)"
    row.exception = group.exception
    with Rig("cutometer", seed=campaign.seed, reference=group.reference, speed=SPEED) as rig:
        for number in range(campaign.count(FULL)):
            _trial(row, rig, group, *group.kinds[number % len(group.kinds)])
    yield row


def _trial(row: Row, rig: Rig, group: Group, kind: str, amount: float) -> None:
    def distort() -> None:
        rig.call("distort", channel=group.channel, kind=kind, amount=amount)

    before: Callable[[], None] = distort if group.after is None else lambda: None
    engine = rig.begin(group.steps, before)
    time.sleep((group.after or 0.0) / SPEED)
    still, began = Stillness(), time.monotonic()
    if group.after is not None:
        distort()
    stopped, problem = rig.stopped(row.limit + 3)
    waited = still.close()
    outcome = rig.over(engine)
    if not problem and (outcome.trip is None or outcome.trip.code not in group.codes):
        problem = f"ended {outcome.status}: {outcome.reason}"
    row.trial(max(0.0, stopped - began - waited), problem and f"{kind} {amount:g}: {problem}")


def spikes(campaign: Campaign) -> Iterator[Row]:
    """One sample alone, far away."""
    row = Row("reading: one sample spikes", "one sample alone does not trip; it is recorded")
    with Rig("cutometer", seed=campaign.seed) as rig:
        for number in range(campaign.count(FULL)):
            _spike(row, rig, -60e3 if number % 2 else 60e3)
    yield row


def _spike(row: Row, rig: Rig, amount: float) -> None:
    engine = rig.begin()
    rig.call("distort", channel="pressure", kind="spike", amount=amount, samples=1)
    time.sleep(0.5)
    state = engine.state
    engine.abort("enough")
    outcome = rig.over(engine)
    seen = False
    if outcome.recording is not None:
        value = open_recording(outcome.recording).streams["pressure"].value
        seen = bool((abs(value) > 55e3).any() if amount < 0 else (value > 20e3).any())
    problem = f"ended {state}: {outcome.reason}" if state is not State.RUNNING else "" if seen else "not recorded"
    row.trial(problem=problem)


CLOCKED = True
PARTS: dict[str, Part] = {**{name: partial(rows, group) for name, group in GROUPS.items()}, "spikes": spikes}
