"""Tier T0 of the blind check: cases from the project's own simulator, with an effect of the library or none.

They show the diagnosis when its forward model is exactly right. Everything harder (other integrators, other
formulas, other skin) comes from `gap.blind`, which shares no physics with the diagnosis; the layout of the folders and
the sealed key are the same.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from acquire.files import write_text
from acquire.recording import write_bundle
from acquire.recording.model import Recording
from gap.blind import Hidden, Truth, write_key
from gap.blind.cases import TIERS
from gap.blind.vocabulary import INSTRUMENTS
from gap.design import simulated as own
from gap.design.plan import build
from gap.effects.load import library
from gap.inference.hypothesis import from_unit
from gap.inference.linear import Projector
from sim_devices.chain import Effect

NO_EFFECT = 0.5
"""Share of cases in which nothing is hidden: T0 is asked for false alarms above all."""


def make_own(
    n: int, seed: int, out: Path | str, passphrase: str = "", instruments: Sequence[str] = INSTRUMENTS
) -> Path:
    """Write ``n`` cases into the new folder ``out`` and their sealed key beside it, as `gap.blind.make` does.

    The instruments take turns; effects and their parameters are drawn from the library's priors. Returns the key's
    path. Raises ValueError for an unknown instrument or n < 1, FileExistsError if ``out`` or the key exists.
    """
    out = Path(out)
    if unknown := [i for i in instruments if i not in INSTRUMENTS]:
        raise ValueError(f"unknown instrument {unknown[0]!r}: one of {', '.join(INSTRUMENTS)}")
    if n < 1 or not instruments:
        raise ValueError("at least one case and one instrument are needed")
    key = out.with_name(out.name + "-key") / "key.bin"
    if key.exists():
        raise FileExistsError(f"{key} exists")
    out.mkdir(parents=True, exist_ok=False)
    root = np.random.SeedSequence([seed, len(TIERS)])  # the tiers of `gap.blind` have 0, 1 ...: other names of cases
    rng = np.random.default_rng(root)
    names = sorted(f"case-{x:08x}" for x in rng.choice(2**32, size=n, replace=False).tolist())
    turns = rng.permutation([instruments[k % len(instruments)] for k in range(n)]).tolist()
    truths = [
        _make_case(out / name, instrument, child)
        for name, instrument, child in zip(names, turns, root.spawn(n), strict=True)
    ]
    manifest = {"schema": "blind-manifest/1", "cases": [{"case": t.case, "instrument": t.instrument} for t in truths]}
    write_text(out / "manifest.json", json.dumps(manifest, indent=1) + "\n")
    write_key(key, truths, passphrase)
    return key


def _make_case(folder: Path, instrument: str, seed: np.random.SeedSequence) -> Truth:
    choice, *noise = seed.spawn(3)
    rng = np.random.default_rng(choice)
    chosen = [] if rng.random() < NO_EFFECT else [_draw(instrument, rng)]
    legs = own.robot_legs(rng) if instrument == "microrobot" else own.suction_legs(instrument, rng)
    recordings = _session(instrument, noise[0], chosen, legs)
    hidden = []
    for effect, values in chosen:
        # Equal seeds give equal noise: the difference of two sessions is the effect and its rounding.
        pairs = [(_session(instrument, n, [], legs), _session(instrument, n, chosen, legs)) for n in noise]
        strength = next((values[p.name] for p in effect.strengths), float("nan"))
        hidden.append(Hidden(effect.name, effect.stage, "library", strength, detectability(*pairs), dict(values)))
    for k, recording in enumerate(recordings):
        anonymous = replace(recording.info, id="", start_time="")
        write_bundle(replace(recording, info=anonymous), folder / f"r{k + 1:02d}")
    reference = any(r.info.specimen != "skin" for r in recordings)
    delta = hidden[0].delta if hidden else 0.0
    return Truth(folder.name, "T0", instrument, hidden, delta, "own", {}, reference)


def _session(
    instrument: str,
    noise: np.random.SeedSequence,
    acting: Sequence[tuple[Effect, Mapping[str, float]]],
    legs: Sequence[own.Leg],
) -> list[Recording]:
    rng = np.random.default_rng(noise)
    if instrument == "microrobot":
        return own.robot_session(rng, acting, legs=legs)
    return own.suction_session(instrument, rng, acting, legs=legs)


def _draw(instrument: str, rng: np.random.Generator) -> tuple[Effect, Mapping[str, float]]:
    """A concept, one of its forms, and parameters from their priors."""
    known = library(instrument)
    concepts = sorted({e.name for e in known.values()})
    concept = concepts[int(rng.integers(len(concepts)))]
    forms = [e for e in known.values() if e.name == concept]
    effect = forms[int(rng.integers(len(forms)))]
    return effect, {p.name: from_unit(p, float(rng.random())) for p in effect.parameters}


def detectability(*pairs: tuple[Sequence[Recording], Sequence[Recording]]) -> float:
    """δ between the sessions of a pair (sound, changed) of equal commands and stamps, once the nuisance
    is refitted (linearly), by the diagnosis' own noise and nuisance.

    The part that rounding adds to the difference is of the size of the noise; a second pair of other noise cancels it:
    δ² is the product of the two differences."""
    total = 0.0
    first, last = (zip(*(build(s, {})[0] for s in pair), strict=True) for pair in (pairs[0], pairs[-1]))
    for (before, after), (sound, changed) in zip(first, last, strict=True):
        jacobian = before.evaluate(before.start(), {}).jacobian
        change = (after.measured - before.measured) / before.sigma
        again = (changed.measured - sound.measured) / before.sigma
        total += float(change @ Projector(jacobian, before.prior_sd).apply(again))
    return float(np.sqrt(max(total, 0.0)))
