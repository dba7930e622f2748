"""Rigs that can answer an experiment: an instrument of the project's simulator, or the hidden rig of a blind case."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from acquire.recording import load, write_bundle
from acquire.recording.model import Recording
from gap.batch import of_skin, session_paths
from gap.blind import perform
from gap.data.quantities import quantity
from gap.data.session import SKIN
from gap.design import simulated as own
from gap.design.bench import Acting
from gap.design.experiment import Experiment, write
from gap.effects.load import library
from gap.inference.hypothesis import from_unit
from gap.report.words import words
from sim_devices.effects import parse_effect

HISTORY = "history.bin"
"""Sealed, beside an answer of a blind case's rig: the rig after it."""


class Rig(Protocol):
    """Something that has recorded a session and goes on recording."""

    @property
    def session(self) -> list[Recording]:
        """The recordings that there are at first."""
        ...

    def answer(self, experiment: Experiment, folder: Path) -> Recording:
        """Do an experiment; its files and its recording go into ``folder``."""
        ...


class SimulatedRig:
    """An instrument of ours with effects hidden in it, and a person. Every answer is one more recording of the same
    session."""

    PAUSE = 20.0

    def __init__(self, instrument: str, acting: Acting, seed: int, legs: Sequence[own.Leg] = ()) -> None:
        rng = np.random.default_rng(seed)
        self._instrument, self._acting, self._seed = instrument, acting, seed
        usual = own.robot_legs(rng) if instrument == "microrobot" else own.suction_legs(instrument, rng)
        self._legs = list(legs) or [leg for leg in usual if leg.specimen == SKIN]

    def _record(self) -> list[Recording]:
        rng = np.random.default_rng([self._seed, 1])
        if self._instrument == "microrobot":
            return own.robot_session(rng, self._acting, legs=self._legs)
        return own.suction_session(self._instrument, rng, self._acting, legs=self._legs, pause=self.PAUSE)

    @property
    def session(self) -> list[Recording]:
        return self._record()

    def answer(self, experiment: Experiment, folder: Path) -> Recording:
        last = self._legs[-1]  # vented, or at the centre, while the rest lasts
        waited = replace(last, duration=last.duration + max(experiment.rest_before - self.PAUSE, 0.0))
        self._legs = [*self._legs[:-1], waited, experiment.leg]
        done = self._record()[-1]
        done = replace(done, info=replace(done.info, experiment=experiment.id))
        write(experiment, folder)
        write_bundle(done, folder / "answer")
        return done


class BlindRig:
    """The hidden rig of a blind case. Every answer is kept in its folder with what the rig has been through by then: a
    folder that holds one already is not asked again."""

    def __init__(self, case: Path, passphrase: str = "", skin_alone: bool = False) -> None:
        self._case, self._passphrase, self._skin_alone = case, passphrase, skin_alone
        self._been: Path | None = None

    @property
    def recorded(self) -> list[Recording]:
        """All that is in the case's folder."""
        return [load(p) for p in session_paths(self._case)]

    @property
    def session(self) -> list[Recording]:
        return of_skin(self.recorded) if self._skin_alone else self.recorded

    def answer(self, experiment: Experiment, folder: Path) -> Recording:
        out, after = folder / "answer", folder / HISTORY
        if not after.exists():
            shutil.rmtree(folder, ignore_errors=True)  # of a run that was broken off
            write(experiment, folder)
            now = folder / f"now-{HISTORY}"
            if self._been is not None:
                shutil.copy(self._been, now)
            perform(self._case, folder, out, self._passphrase, now)
            now.rename(after)  # written last: an answer that has it is whole
        self._been = after
        return load(out)


def drawn(instrument: str, seed: int) -> Acting:
    """An effect of the instrument or its hold on the skin, its parameters from their priors."""
    rng = np.random.default_rng([seed, 2])
    known = [e for e in library(instrument).values() if e.stage != "tissue" and not e.event]
    effect = known[int(rng.integers(len(known)))]
    return [(effect, {p.name: from_unit(p, float(rng.uniform(0.3, 0.8))) for p in effect.parameters})]


def named(effects: Sequence[str], instrument: str) -> Acting:
    """Effects as the command line says them; nothing for ``none``. Raises ValueError."""
    return [parse_effect(text, instrument) for text in effects if text != "none"]


def hidden_in_words(acting: Acting) -> str:
    """The effects that act, with their parameters."""
    said = []
    for effect, values in acting:
        units = {p.name: p.unit for p in effect.parameters}
        shown = [f"{words(k)} {quantity(v, units.get(k, '1'), name=k)}" for k, v in values.items()]
        said.append(f"{words(effect.name)} ({', '.join(shown)})")
    return " and ".join(said) or "nothing"
