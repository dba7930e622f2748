"""Reference specimens of the generator, by laws of its own: bodies that a probe meets in place of skin.

Numbers that a laboratory states of a specimen are true within their standard uncertainty; a membrane's curve is its
maker's and stated nowhere. They differ from case to case (``seed``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from .session import REST_STEP, STEP, Recording, Session, grid, hold_and_rest, triangle
from .session_wide import staircase
from .signals import Array, lag

Stated = Mapping[str, tuple[tuple[float, ...], float, str]]
"""Property -> value (one component or three), standard uncertainty, SI unit."""
SUCTION = ("rigid block", "gauge step", "reference membrane", "manometer")
ROBOT = ("open air", "reference spring", "dead weight")
SLIDES_IN, SLIDING = 2.2, 0.4
"""s after a recording's beginning at which a gauge step is slid under the probe, and for how long."""
G = 9.80665
HANDLING = 20.0
"""s at least between two recordings."""


def specimens_of(instrument: str) -> tuple[str, ...]:
    """The reference specimens that an instrument of the generator has."""
    return ROBOT if instrument == "microrobot" else SUCTION


def usual(specimen: str, instrument: str) -> Stated:
    """A laboratory's statements about its specimen."""
    height = 0.3e-3 if instrument == "cutometer" else 2e-3
    table: dict[str, Stated] = {
        "gauge step": {"height": ((height,), 2e-6, "m")},
        "reference membrane": {"memory": ((0.01,), 0.0, "1")},
        "reference spring": {"k": ((400.0,), 4.0, "N/m")},
        "dead weight": {"mass": ((0.020,), 2e-5, "kg"), "direction": ((0.0, 0.0, -1.0), 0.01, "1")},
    }
    return table.get(specimen, {})


def _true(stated: Stated, key: str, seed: int) -> Array:
    value, se, _ = stated[key]
    rng = np.random.default_rng((seed, sum(map(ord, key))))
    x = np.array(value) + se * rng.standard_normal(len(value))
    return x / np.linalg.norm(x) if len(x) > 1 else x


def height(s: Session, r: Recording, felt: Array, size: float, seed: int) -> Array:
    """Height (N,) m of the body under the probe in recording ``r`` when it feels the suction ``felt`` (N,) Pa;
    ``size`` m is that of skin."""
    stated = dict(r.properties) or usual(r.specimen, s.instrument)
    if r.specimen == "gauge step":
        return np.asarray(_true(stated, "height", seed)[0] * np.clip((s.t - r.start - SLIDES_IN) / SLIDING, 0.0, 1.0))
    if r.specimen == "reference membrane":
        rng = np.random.default_rng((seed, 77))
        at, loss = float(rng.uniform(80e2, 250e2)), float(rng.uniform(0.2, 0.8)) * stated["memory"][0][0]
        curve = float(rng.uniform(0.7, 1.3)) * size * np.arcsinh(np.maximum(felt, 0.0) / at) / np.arcsinh(300e2 / at)
        return np.asarray(curve - 0.6 * loss * (curve - lag(curve, s.dt, 0.5)))
    return np.zeros_like(felt)


def spring_of(r: Recording, instrument: str, seed: int) -> float:
    """Stiffness N/m of the body that holds the probe's tip in recording ``r``, the same in all directions."""
    stated = dict(r.properties) or usual(r.specimen, instrument)
    return float(_true(stated, "k", seed)[0]) if r.specimen == "reference spring" else 0.0


def weight_of(r: Recording, instrument: str, seed: int) -> Array:
    """Force (3,) N that hangs on the probe in recording ``r``."""
    if r.specimen != "dead weight":
        return np.zeros(3)
    stated = dict(r.properties) or usual(r.specimen, instrument)
    return np.asarray(_true(stated, "mass", seed)[0] * G * _true(stated, "direction", seed))


def standard(session: Session) -> Session:
    """A session with the laboratory's standard reference recordings after it."""
    robot, instrument = session.instrument == "microrobot", session.instrument
    like = max(session.recordings, key=lambda r: max(v for _, v in r.corners))
    top = max(v for _, v in like.corners)
    onset = 1.0
    rest: tuple[list[tuple[float, float]], float] = ([(0.0, 0.0), (10.0, 0.0)], 10.0)
    step, ramp = hold_and_rest(top, onset, 8.0, 4.0), triangle(top, onset, 10.0, 4.0)
    stairs = staircase([0.4 * top, 0.8 * top, top, 0.5 * top], onset, 4.0, 4.0)
    cycle = triangle(top, onset, 5.0, 2.0)
    plan = {
        "rigid block": [step, stairs], "gauge step": [rest], "reference membrane": [step, ramp], "manometer": [stairs],
        "open air": [cycle], "reference spring": [cycle], "dead weight": [rest],
    }  # fmt: skip
    turned = (-like.direction[1], like.direction[0], like.direction[2])
    ways = [like.direction, turned if turned != like.direction else (0.0, 1.0, 0.0)] if robot else [like.direction]
    made = session
    for specimen in specimens_of(instrument):
        for corners, length in plan[specimen]:
            for way in ways if robot and specimen != "dead weight" else ways[:1]:
                moves = max(v for _, v in corners) > 0
                r = Recording(
                    start_after(made), float(np.ceil(length * 25) / 25), tuple(corners), onset if moves else 0.0,
                    f"ramp {specimen}", 1, specimen, way, properties=tuple(usual(specimen, instrument).items()),
                )  # fmt: skip
                made = appended(made, r)
    return made


def start_after(session: Session, rest: float = HANDLING) -> float:
    last = session.recordings[-1]
    return float(round(last.start + last.duration + max(rest, HANDLING), 2))


def appended(session: Session, *recordings: Recording) -> Session:
    """The session with recordings after its last one, on a grid of its own; effects that last as long as the session
    go on as they did."""
    every = (*session.recordings, *recordings)
    steps = (5e-3, 5e-3) if session.instrument == "microrobot" else (REST_STEP, STEP)
    t, dt = grid(every, *steps)
    return replace(session, recordings=every, t=t, dt=dt, span=session.span or float(session.t[-1]))
