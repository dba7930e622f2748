"""Subjects of the blind generator, made once: one person on each instrument."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.blind import robot_tissue, tissue
from gap.blind.session import robot_session, suction_session
from gap.blind.strength import Subject


def make_subject(instrument: str, law: str = "conventional", seed: int = 5) -> Subject:
    """A person on an exact instrument without scatter, with reference recordings."""
    rng = np.random.default_rng(seed)
    if instrument == "microrobot":
        session, person = robot_session(rng, True), robot_tissue.draw(rng)
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
