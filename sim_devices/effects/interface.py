"""Effects between instrument and skin: rim, tilt, recoil, glue, support."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_devices.chain import Chain, FloatArray, Signals
from sim_devices.effects.build import (
    CUTOMETER,
    DRAWN,
    PRESSURE,
    ROBOT,
    SUCTION,
    Values,
    choice,
    chosen,
    effect,
    for_a_while,
    law_after,
    map_after,
    shape,
    strength,
)
from sim_devices.stages import kernels, laws
from sim_devices.stages.operators import Names, Wired, after
from sim_devices.stages.sheet import Glue


@dataclass(frozen=True)
class RimFriction(Wired):
    """Height, or the suction that skin feels (first source), that lags within a play which the skin's pressure on the
    rim (second source) opens.

    ``share`` of the half ``width`` (m or Pa, at 300 mbar) is in proportion to suction, the rest is always there.
    """

    width: float
    share: float
    soft: float

    def fresh(self) -> Any:
        return np.zeros(kernels.STATE)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        height, pressure = (signals[s] for s in self.source)
        width = self.width * (1.0 - self.share + self.share * np.abs(pressure) / PRESSURE)
        out = np.empty(len(time))
        kernels.play_within(state, height, width, self.soft, out)
        signals[self.target[0]] = out


@dataclass(frozen=True)
class Recoil(Wired):
    """Height (first source) plus the sinking of the probe under its own suction (second source), ``tau`` s late; not
    further than its ``stop``, a share of the ``depth`` at 300 mbar (inf: none)."""

    depth: float
    tau: float
    stop: float = math.inf

    def fresh(self) -> Any:
        return np.zeros(kernels.STATE), np.array([self.tau])

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        height, pressure = (signals[s] for s in self.source)
        if self.stop < math.inf:
            pressure = self.stop * PRESSURE * np.tanh(pressure / (self.stop * PRESSURE))
        sunk = np.empty(len(time))
        kernels.low_pass(state[0], time, pressure, state[1], sunk)
        signals[self.target[0]] = height - self.depth / PRESSURE * sunk


@dataclass(frozen=True)
class Seating(Wired):
    """Height (first source) plus the tipping of a leaning probe under its greatest suction (second source) since the
    latest of ``marks`` (s), when it was put on: ``depth`` m in the end, within ``seat`` Pa. It stays flat when vented.
    """

    depth: float
    seat: float
    marks: tuple[float, ...]

    def fresh(self) -> Any:
        return {"greatest": 0.0, "part": -1}

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        height, pressure = (signals[s] for s in self.source)
        part = np.searchsorted(sorted(self.marks), time, side="right")
        greatest = np.empty(len(time))
        for k in np.unique(part):
            at = part == k
            before = state["greatest"] if k == state["part"] else 0.0
            greatest[at] = np.maximum.accumulate(np.maximum(-pressure[at], before))
            state["greatest"], state["part"] = float(greatest[at][-1]), int(k)
        signals[self.target[0]] = height - self.depth * np.expm1(-greatest / self.seat)


@dataclass(frozen=True)
class Slip(Wired):
    """Displacement of the skin (x, y, z) less the slip under the support once it is ``reach`` m from where it sits.

    ``share`` of the excess slips; it stays where it slipped to. z does not slip.
    """

    reach: float
    share: float

    def fresh(self) -> Any:
        return np.zeros(2)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        plane, out = np.stack([signals[s] for s in self.source[:2]]), np.empty((2, len(time)))
        kernels.slipping(state, plane, self.reach, self.share, out)
        signals.update(zip(self.target, (*out, signals[self.source[2]]), strict=True))


LEVER = 5e-3
"""m from the point about which a leaning probe tips to where the height is read (assumed)."""


def tilted_pressure(time: FloatArray, pressure: FloatArray, seal: float) -> FloatArray:
    """Suction less the loss through a gap under the rim until ``seal`` Pa have closed it."""
    lost = -seal * np.expm1(-np.abs(pressure) / seal)
    return pressure - np.copysign(lost, pressure)


def _preload(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 0:
        return map_after(chain, "probe", "spring_preload", "interface", laws.offset, (-v["pressure"],))
    if chosen(v, "form") == 2:
        op: Any = chain["latency"]
        parameters = (-v["pressure"], v["tau"], *op.marks)
        return map_after(chain, "probe", "spring_preload", "interface", laws.fading_offset, parameters)
    elastic: Any = chain["elastic"]
    lost = float(elastic.function(np.zeros(1), np.array([-v["pressure"]]), *elastic.parameters)[0])
    return map_after(chain, "optics", "spring_preload", "interface", lost_height, (lost,))


def lost_height(time: FloatArray, height: FloatArray, lost: float) -> FloatArray:
    """Height that shows only beyond ``lost`` m, its corner rounded over a fifth of that."""
    return np.copysign(laws.ramp(np.abs(height), lost, 0.2 * lost), height)


def _rim_friction(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 4:
        slips = kernels.in_a_row(v["width"])
        return law_after(chain, "softening", "rim_friction", "interface", kernels.prandtl, slips, add=True)
    behind, width = ("softening", v["width"]) if chosen(v, "form") < 2 else ("probe", v["friction"])
    soft = float(chosen(v, "form") % 2)

    def make(source: Names, target: Names) -> Wired:
        load = "skin_pressure" if behind == "softening" else source[0]
        return RimFriction("rim_friction", "interface", (*source, load), target, width, v["share"], soft)

    return after(chain, behind, make)


def _rim_leak(chain: Chain, v: Values) -> Chain:
    """What flows in at the rim flows through the hose, at whose end there is less suction: a manometer at the probe
    sees that, the gauge at the other end does not."""
    if chosen(v, "form") == 1:
        return map_after(chain, "hose", "rim_leak", "interface", tilted_pressure, (v["share"] * PRESSURE,))
    if chosen(v, "form") == 2:
        spell = (-v["share"], v["moment"], v["duration"])
        return map_after(chain, "hose", "rim_leak", "interface", laws.gain_for_a_while, spell)
    if chosen(v, "form") == 4:
        return law_after(chain, "hose", "rim_leak", "interface", kernels.sealing, (v["share"], v["seal"], DRAWN))
    if chosen(v, "form") == 3:
        lost = kernels.prony, (0.0, 1.0 - v["share"], v["tau"])
        return law_after(chain, "hose", "rim_leak", "interface", *lost)
    return map_after(chain, "hose", "rim_leak", "interface", laws.leak, (v["share"], v["exponent"], PRESSURE))


def _tilt(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 1:
        op: Any = chain["latency"]
        seating = (v["angle"] * LEVER, v["seat"], op.marks)
        return after(
            chain,
            "optics",
            lambda s, t: Seating("probe_tilt", "interface", (*s, "line_pressure"), t, *seating),
        )
    chain = map_after(chain, "optics", "probe_tilt", "interface", laws.gain, (math.cos(2 * v["angle"]) - 1.0,))
    seal = v["seal"] * v["angle"]
    return map_after(chain, "hose", "probe_tilt_seal", "interface", tilted_pressure, (seal,)) if seal > 0.01 else chain


def _recoil(chain: Chain, v: Values) -> Chain:
    stop = v["stop"] if chosen(v, "form") == 1 else math.inf
    return after(
        chain,
        "optics",
        lambda s, t: Recoil("probe_recoil", "interface", (*s, "line_pressure"), t, v["depth"], v["tau"], stop),
    )


def _glue(chain: Chain, v: Values) -> Chain:
    form, plane = chosen(v, "form"), v["compliance"]
    glue = Glue(plane, plane * v["normal"])
    if form in (1, 3):
        glue = glue._replace(creeps=v["creeps"], within=v["tau"])
    if form > 1:
        glue = glue._replace(closes=1.0 / v["load"])
    return chain.tuned("tissue", glue=glue)


def _slip(chain: Chain, v: Values) -> Chain:
    return after(chain, "glue", lambda s, t: Slip("support_slip", "interface", s, t, v["reach"], v["share"]))


EFFECTS = (
    effect(
        "spring_preload", "interface", CUTOMETER,
        "The probe's spring bulges the skin before the zero is taken, so that this height is lost.",
        "Weigh the contact force, zero before contact, or add the lost height (ZeroDisp).",
        "F: ZeroDisp 0.05 to 0.09 mm on biomimetics",
        (
            strength("pressure", "Pa", 200.0, 15e3, 4e3, "suction that would bulge the skin as much as the spring"),
            choice("form", 0, "a preload of the tissue", "a dead height before the reading rises",
                   "a preload that relaxes in every recording"),
            shape("tau", "s", 1.0, 300.0, 10.0, "within which it relaxes", log=True, only=(2,)),
        ),
        _preload,
    ),
    effect(
        "rim_friction", "interface", SUCTION,
        "Skin sticks and slips on the probe's rim: height lags on the way up and on the way down.",
        "A lubricated or rounded rim; compare with a silicone block.",
        "F: Coulomb friction 0.35 at the rim",
        (
            strength("width", "m", 1e-6, 5e-4, 3e-5, "half width of the lag at 300 mbar", only=(0, 1, 4)),
            strength("friction", "Pa", 10.0, 2e4, 1e3, "suction that it carries at 300 mbar", only=(2, 3)),
            shape("share", "1", 0.0, 1.0, 0.5, "of it in proportion to suction, the rest constant", only=(0, 1, 2, 3)),
            choice("form", 0, "sharp play of the height", "play taken up gradually",
                   "it carries some of the suction", "it carries ever more of the suction, up to a limit",
                   "several slips in a row (Maxwell slip), of the height"),
        ),
        _rim_friction,
    ),
    effect(
        "rim_leak", "interface", SUCTION,
        "Air leaks under the rim: skin sees less suction than the gauge.",
        "Press more evenly, grease the rim, shave the site; tighten the hose.",
        "contact on hairy or curved sites; gap.md",
        (
            strength("share", "1", 2e-4, 0.6, 0.12, "of the suction at 300 mbar (form 1: of 300 mbar in the end)"),
            choice("form", 0, "a power of suction", "until suction has sealed the rim", "open for a while",
                   "at the end of a long hose, which delays suction besides",
                   "until suction has pressed the rim tight, each time anew"),
            shape("exponent", "1", -0.5, 1.5, 0.5, "-0.5 orifice, 0 laminar, above: a leak that opens", only=(0,)),
            *for_a_while(2),
            shape("tau", "s", 0.01, 3.0, 0.2, "of the hose", log=True, only=(3,)),
            shape("seal", "s", 0.1, 20.0, 1.5, "within which it closes", log=True, only=(4,)),
        ),
        _rim_leak,
    ),
    effect(
        "probe_tilt", "interface", SUCTION,
        "The probe stands askew: its dome rises out of the beam's axis, its rim seals late, or suction tips it flat.",
        "A holder that squares the probe to the skin.",
        "contact is the main scatter of hand-held probes (reported)",
        (
            strength("angle", "rad", 5e-4, 0.5, 0.15, "between probe axis and skin normal"),
            choice("form", 0, "it stays askew", "its first suction tips it flat"),
            shape("seal", "Pa", 0.0, 60e3, 20e3, "suction per radian that closes the gap under the rim", only=(0,)),
            shape("seat", "Pa", 300.0, 30e3, 3e3, "suction that tips it", log=True, only=(1,)),
        ),
        _tilt,
    ),
    effect(
        "probe_recoil", "interface", SUCTION,
        "The probe is drawn into the skin by its own suction, so that the apex seems higher.",
        "Clamp the probe, or measure its position.",
        "hand-held probes on soft sites; gap.md",
        (
            strength("depth", "m", 1e-6, 1e-3, 4e-5, "at 300 mbar"),
            shape("tau", "s", 0.0, 5.0, 0.3, "time it takes"),
            choice("form", 0, "into the skin, in proportion to suction", "on its own spring, up to a stop"),
            shape("stop", "1", 0.2, 3.0, 0.8, "of the depth, at which it ends", log=True, only=(1,)),
        ),
        _recoil,
    ),
    effect(
        "glue_compliance", "interface", ROBOT,
        "The glue between probe and skin yields: the skin moves less than the probe.",
        "A thinner layer, cyanoacrylate instead of tape; track the skin by camera.",
        "M glues the probe; yield unknown",
        (
            strength("compliance", "m/N", 5e-7, 1e-3, 2e-4, "in plane"),
            shape("normal", "1", 0.05, 1.0, 0.3, "compliance along the normal against that in plane"),
            choice("form", 0, "elastic", "some of it creeps, as tape does", "foam that closes as it is loaded",
                   "foam that creeps and closes"),
            shape("creeps", "1", 0.1, 1.0, 0.5, "of the compliance that creeps", only=(1, 3)),
            shape("tau", "s", 0.01, 100.0, 1.0, "within which it creeps", log=True, only=(1, 3)),
            shape("load", "N", 0.05, 10.0, 0.7, "by which its compliance is halved", log=True, only=(2, 3)),
        ),
        _glue,
    ),
    effect(
        "support_slip", "interface", ROBOT,
        "Skin slips under the support plate beyond a load, and does not come back.",
        "More contact pressure or double-sided tape under the plate; smaller amplitude.",
        "M holds the skin by a plate with a hole; gap.md",
        (
            strength("share", "1", 0.01, 1.0, 0.4, "of the displacement beyond the threshold that is lost to slip"),
            shape("reach", "m", 0.1e-3, 1.5e-3, 0.6e-3, "displacement at which slip begins"),
        ),
        _slip,
    ),
)  # fmt: skip
