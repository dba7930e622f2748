"""The prior of the skin's law by earlier sessions of the same person and site.

Each is diagnosed by itself. Where its instrument was sound, the skin's parameters as fitted there are the prior of the
same law here, with their errors and those of skin from day to day (``gap/data/between_sessions.yaml``). A
recording's own parameters (zero, gain, sampling) are not carried over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files

import numpy as np
import yaml

from acquire.recording.model import Recording
from gap.data.checks import stated_opening
from gap.inference.evidence import Fit
from gap.inference.hypothesis import FROZEN
from gap.inference.linear import Projector
from gap.null.known_skin import KnownSkin
from gap.null.skin_laws import CREEP, SkinLaw
from gap.null.suction_height import HeightBlock
from gap.search.compare import Comparison
from sim_devices.chain import FloatArray
from sim_devices.stages.suction import elastic_height

SAME_LOAD = 0.05
"""Relative difference of the strongest suctions within which nonlinear parameters carry over."""
CLEARLY = 4.0
"""Standard deviations from where a parameter was, from which on the skin has changed."""
NOTABLE = 1.1
"""Ratio of detectabilities from which on an effect stands out more."""


@dataclass(frozen=True)
class Skin:
    """The skin as one ``session`` has it: its ``law``, the parameters ``names`` with their ``mean`` (m,) and
    ``covariance`` (m, m), at a ``strongest`` suction (Pa), and its elastic ``curve`` (m/Pa, Pa, 1)."""

    session: str
    law: SkinLaw
    names: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray
    strongest: float
    curve: tuple[float, float, float]


@dataclass(frozen=True)
class Earlier:
    """The use of earlier sessions: those ``believed`` and, by session, why others are ``doubted``; the parameters
    that they told; what has changed since; and for each effect the detectability without and with them, in σ."""

    believed: tuple[str, ...] = ()
    doubted: Mapping[str, str] = field(default_factory=dict)
    told: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    gains: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@cache
def between_sessions() -> dict[str, float]:
    """The standard deviations between sessions, by parameter or kind of parameter."""
    text = files("gap.data").joinpath("between_sessions.yaml").read_text(encoding="utf-8")
    return {name: float(entry["value"]) for name, entry in yaml.safe_load(text).items()}


def unlike(earlier: Sequence[Recording], here: Sequence[Recording]) -> str:
    """Why a session is not another one of the same person, site, instrument and probe; '' where it is."""
    if {(r.info.id, r.info.start_time) for r in earlier} & {(r.info.id, r.info.start_time) for r in here}:
        return "it is this session itself, or has recordings of it"
    for what, read in (
        ("instrument", lambda r: r.info.instrument),
        ("subject", lambda r: r.info.subject),
        ("site", lambda r: r.info.site),
        ("opening of the probe", _opening),
    ):
        one, other = {read(r) for r in earlier}, {read(r) for r in here}
        if what in ("subject", "site") and not all(one | other):
            return f"it is not known to be of the same {what}: a recording states none"
        if one != other:
            return f"it is of another {what}: {', '.join(sorted(one))}, not {', '.join(sorted(other))}"
    return ""


def _opening(recording: Recording) -> str:
    diameter = stated_opening(recording)
    return f"{1e3 * diameter:g} mm" if np.isfinite(diameter) else "not stated"


def skin_of(session: str, block: HeightBlock, f: Fit, temper: float) -> Skin:
    """The skin in a fit of a session by itself."""
    place = next((k for k, sd in enumerate(block.prior_scales) if np.array_equal(sd, f.prior_sd)), len(block.laws))
    law = block.laws[place] if place < len(block.laws) else block.full
    free = {name: k for k, (name, part) in enumerate(block.PARTS.items()) if law.frees(part) and part.sd > FROZEN}
    at = list(free.values())
    wide = f.prior_sd.copy()
    wide[at] = [block.PARTS[name].sd for name in free]
    inverse = np.linalg.inv(f.gram / temper + np.diag(1.0 / np.square(wide)))
    covariance = np.asarray(inverse[np.ix_(at, at)], dtype=float)
    tissue = block.tissue(f.nuisance)
    curve = (tissue.compliance, tissue.knee, tissue.exponent)
    return Skin(session, law, tuple(free), f.nuisance[at], covariance, block.strongest, curve)


def known_skin(block: HeightBlock, skins: Sequence[Skin]) -> tuple[KnownSkin | None, tuple[str, ...], dict[str, str]]:
    """A block whose skin's law is known from earlier sessions (None where it is not); the sessions that tell it, and
    why others do not."""
    law, doubted, used = skins[-1].law, dict[str, str](), []
    for s in skins:
        if s.law != law:
            doubted[s.session] = "its skin follows another law than that of the latest session"
        elif law.nonlinear and abs(s.strongest / block.strongest - 1.0) > SAME_LOAD:
            doubted[s.session] = "its law depends on the strongest suction, which was another"
        else:
            used.append(s)
    if not used:
        return None, (), doubted
    precision, pull = np.zeros_like(used[0].covariance), np.zeros_like(used[0].mean)
    for s in used:
        mean, covariance = _here(s, block)
        scatter = np.diag(np.square([_scatter(name, m) for name, m in zip(s.names, mean, strict=True)]))
        one = np.linalg.inv(covariance + scatter)
        precision, pull = precision + one, pull + one @ mean
    together = np.linalg.inv(precision)
    # The next day differs from the person's own mean as much as the others do.
    known = KnownSkin(block, law, used[-1].names, together @ pull, together + scatter * (len(used) > 1))
    return known, tuple(s.session for s in used), doubted


def _here(skin: Skin, block: HeightBlock) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of the parameters as a block has them: with the compliance at its own strongest suction."""
    begin = block.start()
    k = list(block.PARTS).index("compliance")
    unit = block.quantities(begin)["elastic_height"][0] / np.exp(begin[k])
    reached = elastic_height(np.zeros(1), np.array([-block.strongest]), *skin.curve)[0] / unit
    mean = skin.mean.copy()
    mean[skin.names.index("compliance")] = np.log(reached)
    return mean, skin.covariance


def _scatter(name: str, mean: float) -> float:
    """How much a parameter about a mean differs between sessions, sd."""
    table = between_sessions()
    if name in table:
        return table[name]
    if name in CREEP:
        return max(table["creep"] * abs(mean), 0.01)
    if name.startswith("time") or name == "fraction":
        return table["time"]
    return max(table["other"] * abs(mean), 0.02)


def moved(skin: KnownSkin, f: Fit) -> tuple[str, ...]:
    """Whether the skin is clearly not as earlier sessions have it, in words."""
    away = float(np.sqrt(np.sum(np.square(f.nuisance[skin.places])) / len(skin.places)))
    return (
        (f"the skin is {away:.1f} standard deviations (rms) from that of earlier sessions",) if away > CLEARLY else ()
    )


def gains(comparison: Comparison, skin: KnownSkin) -> dict[str, tuple[float, float]]:
    """For each effect that shows in the height, how far the faintest of the strengths tried stands out, in σ, where the
    skin's parameters are as free as they usually are, and where they are known; those that this changes by a tenth."""
    f = comparison.null.fits[skin.name]
    own = f.jacobian.copy()
    own[:, skin.places] = f.jacobian[:, skin.places] @ np.linalg.inv(skin.root)
    place = next((k for k, sd in enumerate(skin.prior_scales) if np.array_equal(sd, f.prior_sd)), 0)
    free, known = Projector(own, skin.widths[place]), Projector(f.jacobian, f.prior_sd)
    temper = comparison.temper()[skin.name]
    out: dict[str, tuple[float, float]] = {}
    for s in comparison.screened:
        changes = s.traces.get(skin.name)
        if changes is None:
            continue
        was = np.sqrt(np.maximum(free.squares(changes, own.T @ changes), 0.0) / temper)
        now = np.sqrt(np.maximum(known.squares(changes, f.jacobian.T @ changes), 0.0) / temper)
        k = int(np.argmin(np.where(now > 0, now, np.inf)))
        if now[k] > NOTABLE * was[k]:
            out.setdefault(s.candidate.name, (float(was[k]), float(now[k])))
    return out
