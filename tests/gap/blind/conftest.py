"""Subjects of the blind generator, made once: one person on each instrument."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.blind import robot_tissue, tissue
from gap.blind.session import Session, robot_session, suction_session
from gap.blind.strength import Subject


def shortened(session: Session, n: int) -> Session:
    """The first ``n`` recordings of a session."""
    kept = session.recordings[:n]
    until = int(np.searchsorted(session.t, kept[-1].start + kept[-1].duration + 0.5))
    return replace(session, recordings=kept, t=session.t[:until], dt=session.dt[:until])


def make_subject(instrument: str, law: str = "conventional", seed: int = 5) -> Subject:
    """A person on an exact instrument without scatter, with reference recordings."""
    rng = np.random.default_rng(seed)
    if instrument == "microrobot":
        session, person = shortened(robot_session(rng, True), 4), robot_tissue.draw(rng)
    else:
        session, person = suction_session(instrument, rng, True), tissue.draw(instrument, rng)
    return Subject(session, law, person, np.ones(len(session.recordings)), {}, 3)


@pytest.fixture(scope="session")
def subjects() -> dict[str, Subject]:
    return {i: make_subject(i) for i in ("cutometer", "aspiration", "microrobot")}


@pytest.fixture(scope="session")
def with_law():
    """``with_law(subject, law)``: the same person with skin of another law."""
    return lambda subject, law: replace(subject, law=law)
