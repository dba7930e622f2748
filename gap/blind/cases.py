"""Making blind cases: anonymous folders of recordings, and a sealed key that names the hidden effect of each."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from . import effects_robot, effects_suction, effects_wide, laboratory, robot_tissue, tissue
from .bundle import write_recording
from .forms import Form
from .laboratory import STYLES
from .lock import seal
from .rig import REFERENCES, as_plain
from .session import Session, robot_session, suction_session
from .session_wide import wide_robot, wide_suction
from .specimens import standard
from .strength import Subject, scatter_of
from .vocabulary import INSTRUMENTS, UNKNOWN, stage_of

TIERS = ("T1", "T2", "T3", "T4", "T5", "T6")
DELTA = (0.5, 300.0)  # range of the target detectability, log-uniform
DELTA_SEVERAL = (3.0, 300.0)  # the same for each effect of tier T4
NO_EFFECT = 0.08  # share of cases of T1-T3 without any effect
REFERENCE = 0.4  # share of cases with reference recordings
KEEP_FAINT, KEEP_GROSS = 0.2, 0.5  # effects that cannot be as weak or strong as aimed at are kept this often
_SITES = ("forehead", "cheek", "forearm", "upper arm", "jaw")
# With a wrong tissue law (T3) these have two true answers, the law and the effect: not asked.
_LAW_LIKE = frozenset(
    {"slow_creep", "power_law_creep", "viscoplastic_residual", "strain_stiffening", "missing_deep_layer"}
)


@dataclass(frozen=True)
class Hidden:
    """An effect hidden in a case: concept, form, strength (SI), and delta given the other effects of the case."""

    concept: str
    stage: str
    form: str
    strength: float
    delta: float
    knobs: dict[str, float]


@dataclass(frozen=True)
class Truth:
    """One entry of the key. ``effects`` is empty where nothing is hidden; T5 names begin with ``unknown``."""

    case: str
    tier: str
    instrument: str
    effects: list[Hidden]
    delta: float
    law: str
    tissue: dict[str, float]
    reference: bool
    delta_free: float = 0.0
    style: str = "dense"
    rig: dict[str, Any] = field(default_factory=dict, repr=False)


def _forms(instrument: str, tier: str, style: str) -> list[Form]:
    every = effects_suction if instrument != "microrobot" else effects_robot
    pool = every.OUTSIDE if tier == "T5" else every.FORMS + (effects_wide.FORMS if style == "wide" else ())
    own = tier != "T1"
    return [
        f
        for f in pool
        if instrument in f.instruments and f.own is own and not (tier == "T3" and f.concept in _LAW_LIKE)
    ]


def _session(instrument: str, style: str, rng: np.random.Generator, reference: bool) -> Session:
    is_robot = instrument == "microrobot"
    if style == "wide":
        lab = laboratory.draw(instrument, rng)
        return wide_robot(rng, reference, lab) if is_robot else wide_suction(instrument, rng, reference, lab)
    return robot_session(rng, reference) if is_robot else suction_session(instrument, rng, reference)


def _subject(
    instrument: str, tier: str, style: str, rng: np.random.Generator, references: str = "some"
) -> tuple[Subject, bool]:
    reference = bool(rng.random() < REFERENCE) and references == "some"
    is_robot = instrument == "microrobot"
    session = _session(instrument, style, rng, reference)
    if references == "standard":
        session, reference = standard(session), True
    laws = list((robot_tissue if is_robot else tissue).LAWS)
    law = str(rng.choice(laws[1:])) if tier in ("T3", "T6") else laws[0]
    person = robot_tissue.draw(rng) if is_robot else tissue.draw(instrument, rng)
    scatter = np.exp(scatter_of(session) * rng.normal(size=len(session.recordings)))
    tolerance = {name: float(sd * rng.normal()) for name, sd in session.lab.tolerances.items()}
    return Subject(session, law, person, scatter, tolerance, int(rng.integers(2**31))), reference


class _Deck:
    """Concepts in random order, all dealt before any comes again: every class is asked about equally often."""

    def __init__(self, concepts: Sequence[str], rng: np.random.Generator) -> None:
        self._all, self._rng, self._left = sorted(set(concepts)), rng, list[str]()

    def deal(self) -> str:
        if not self._left:
            self._left = [str(c) for c in self._rng.permutation(self._all)]
        return self._left.pop()


def _hide_one(
    subject: Subject, deck: _Deck, forms: list[Form], span: tuple[float, float], rng: np.random.Generator
) -> tuple[Form, float, float, int]:
    """Choose a form and a strength with a detectability log-uniform in ``span``: (form, strength, delta, seed)."""
    target = float(np.exp(rng.uniform(*np.log(span))))
    while True:
        concept = deck.deal()
        form = [f for f in forms if f.concept == concept][int(rng.integers(sum(f.concept == concept for f in forms)))]
        seed = int(rng.integers(2**31))
        strength, delta = subject.calibrate(form, target, seed)
        off = np.log(max(delta, 1e-9) / target)
        if abs(off) < 0.5 or rng.random() < (KEEP_FAINT if off < 0 else KEEP_GROSS):
            return form, strength, delta, seed


def _hide(subject: Subject, tier: str, deck: _Deck, rng: np.random.Generator) -> list[Hidden]:
    instrument = subject.session.instrument
    if tier == "T6" or (tier in ("T1", "T2", "T3") and rng.random() < NO_EFFECT):
        return []
    forms = _forms(instrument, tier, subject.session.lab.style)
    wanted = 1 if tier != "T4" else int(rng.choice([2, 3], p=[0.7, 0.3]))
    span = DELTA if tier != "T4" else DELTA_SEVERAL
    chosen: list[tuple[Form, float, float, dict[str, float]]] = []
    while len(chosen) < wanted:
        form, strength, delta, seed = _hide_one(subject, deck, forms, span, rng)
        knobs = form.knobs(strength, instrument, seed)
        taken = {k for c in chosen for k in c[3]} | {c[0].concept for c in chosen}
        if not taken & (set(knobs) | {form.concept}):
            chosen.append((form, strength, delta, knobs))
    hidden = []
    for form, strength, delta, knobs in chosen:
        beside = {k: v for c in chosen if c[3] is not knobs for k, v in c[3].items()}
        if beside:
            delta = subject.detectability(knobs, beside)
        stage = UNKNOWN if form.outside else stage_of(form.concept)
        hidden.append(Hidden(form.concept, stage, form.name, strength, delta, knobs))
    return hidden


def _check(tier: str, n: int, instruments: Sequence[str], style: str, references: str) -> None:
    """Raises ValueError for cases that cannot be made."""
    if tier == "T0":
        raise ValueError("tier T0 is made by the diagnosis' own simulator, not by this generator (which has T1 ... T6)")
    if tier not in TIERS:
        raise ValueError(f"unknown tier {tier!r}: one of T0, {', '.join(TIERS)}")
    if style not in STYLES:
        raise ValueError(f"unknown style {style!r}: one of {', '.join(STYLES)}")
    if references not in REFERENCES:
        raise ValueError(f"unknown references {references!r}: one of {', '.join(REFERENCES)}")
    if unknown := [i for i in instruments if i not in INSTRUMENTS]:
        raise ValueError(f"unknown instrument {unknown[0]!r}: one of {', '.join(INSTRUMENTS)}")
    if n < 1 or not instruments:
        raise ValueError("at least one case and one instrument are needed")


def make(
    tier: str,
    n: int,
    seed: int,
    out: Path | str,
    instruments: Sequence[str] = INSTRUMENTS,
    passphrase: str = "",
    progress: Callable[[int, int], None] | None = None,
    style: str = "wide",
    references: str = "some",
) -> Path:
    """Write ``n`` blind cases of ``tier`` into the new folder ``out`` and their sealed key beside it.

    The instruments take turns. Each case is ``case-<hex>/r01 ...``, recordings of one session in order; the key is
    ``<out>-key/key.bin``, sealed with ``passphrase`` (see ``write_key``). Returns the key's path.
    ``style`` is ``wide`` (laboratories as they differ) or ``dense`` (README.md's instrument to the letter);
    ``references`` are of ``some`` kinds in two of five cases, ``none``, or the ``standard`` set. Equal arguments give
    equal cases. Raises ValueError for an unknown tier, style, references or instrument, FileExistsError if ``out``
    or the key exists.
    """
    out = Path(out)
    _check(tier, n, instruments, style, references)
    key = out.with_name(out.name + "-key") / "key.bin"
    if key.exists():
        raise FileExistsError(f"{key} exists")
    out.mkdir(parents=True, exist_ok=False)
    root = np.random.SeedSequence([seed, TIERS.index(tier)])
    rng = np.random.default_rng(root)
    names = [f"case-{x:08x}" for x in rng.choice(2**32, size=n, replace=False).tolist()]
    turns = rng.permutation([instruments[k % len(instruments)] for k in range(n)])
    decks = {i: _Deck([f.concept for f in _forms(i, tier, style)] or ["none"], rng) for i in instruments}
    truths = []
    # Written in the order of their names, so that time stamps of files follow nothing but the names.
    for k, (case, child) in enumerate(zip(sorted(names), root.spawn(n), strict=True)):
        own = np.random.default_rng(child)
        truths.append(_make_case(out / case, str(turns[k]), tier, style, decks, own, references))
        if progress:
            progress(k + 1, n)
    manifest = {"schema": "blind-manifest/1", "cases": [{"case": t.case, "instrument": t.instrument} for t in truths]}
    (out / "manifest.json").write_text(json.dumps(manifest, indent=1) + "\n")
    write_key(key, truths, passphrase)
    return key


def write_key(path: Path, truths: Sequence[Truth], passphrase: str = "") -> None:
    """Seal the hidden effects of every case into the key file ``path``.

    Without a passphrase a fixed one is used: labels are then unread, not secret.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = json.dumps({"schema": "blind-key/1", "cases": [asdict(t) for t in truths]})
    path.write_bytes(seal(plain.encode(), passphrase))


def _make_case(
    folder: Path,
    instrument: str,
    tier: str,
    style: str,
    decks: dict[str, _Deck],
    rng: np.random.Generator,
    references: str,
) -> Truth:
    looks = rng.spawn(1)[0]
    subject, reference = _subject(instrument, tier, style, rng, references)
    hidden = _hide(subject, tier, decks[instrument], rng)
    knobs = {k: v for h in hidden for k, v in h.knobs.items()}
    total = hidden[0].delta if len(hidden) == 1 else subject.detectability(knobs) if hidden else 0.0
    free = subject.detectability_free(knobs) if knobs else 0.0
    channels = subject.record(knobs, noisy=True)
    person, site = f"P{int(looks.integers(100)):02d}", str(looks.choice(_SITES))
    for k in range(len(subject.session.recordings)):
        write_recording(folder / f"r{k + 1:02d}", subject.session, k, channels, person, site)
    return Truth(
        folder.name, tier, instrument, hidden, total, subject.law, dict(subject.tissue), reference, free, style,
        as_plain(subject, knobs, person, site),
    )  # fmt: skip
