"""Reduced tissues: nonlinear elastic curve x linear memory, slow flow that stays, softening by the first loading.

Nobody published reduced-model parameters for these instruments: every number here is assumed, chosen so that heights
and forces lie in the published ranges (Cutometer 0.1-0.6 mm at 150-450 mbar, aspiration 1-4 mm, robot 0.5-1.2 N at 1.3
mm with 12-34 % energy loss) and that repeats differ by the few per cent reported for the first curve of a series.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

T = TypeVar("T")

REFERENCE_OPENING = 2e-3
"""Probe opening (diameter, m) to which suction compliances refer."""
OPENING_EXPONENT = 1.6
"""Heights grow with the opening to this power: 1 by similarity, more because deeper layers are softer. Assumed."""


class Softens:
    """A tissue that loading softens."""

    softening_rise: float
    softening_fall: float
    softening_end: float

    @property
    def softening_law(self) -> tuple[float, float, float]:
        """Rise and fall (s) and end of `kernels.exposed`."""
        return self.softening_rise, self.softening_fall, self.softening_end


@dataclass(frozen=True)
class SuctionTissue(Softens):
    """Skin under a suction probe.

    Instantaneous height phi(q) = c q0 ((1 + q/q0)^m - 1) / m for suction q >= 0; creep h = phi + sum g_i lag(phi,
    tau_i); residual r -> k h within ``residual_rise``, back within ``residual_fall``; first-curve softening 1 + a w.
    """

    compliance: float  # c, m/Pa at the reference opening, at zero suction
    knee: float = 10e3  # q0, Pa
    exponent: float = 0.4  # m; below 1: stiffening
    creep: tuple[float, ...] = (0.15, 0.15, 0.2, 0.2)  # g_i
    times: tuple[float, ...] = (0.12, 1.0, 6.0, 40.0)  # tau_i, s
    residual: float = 0.12  # k
    residual_rise: float = 20.0  # s
    residual_fall: float = 150.0  # s
    softening: float = 0.05  # a; 0: no first-curve difference
    softening_rise: float = 8.0  # s
    softening_fall: float = 900.0  # s
    softening_end: float = 0.0  # how far w stops at 1, whatever the height
    softening_height: float = 0.3e-3  # m at the reference opening: height at which w is 1


@dataclass(frozen=True)
class SheetTissue(Softens):
    """Skin moved by a glued probe in three directions.

    Elastic force f = K u (1 + u.K u / (k l²))^p with K from ``stiffness`` along axes turned by ``angle`` about z, then
    by ``tilt`` about x and y, as where skin is not level under the robot, and k their mean: it has a potential. With
    ``isotropy`` 1 u.u stands for u.K u / k: stiffening by distance, not by energy. Memory f - sum g_i lag(f, tau_i);
    softening by loading 1 - a w.
    """

    stiffness: tuple[float, float, float]  # N/m: along, across, normal
    angle: float = 0.3  # rad, of the stiffest in-plane direction (across Langer's lines)
    tilt: tuple[float, float] = (0.0, 0.0)  # rad
    length: float = 1.2e-3  # l, m
    exponent: float = 0.35  # p; above 0: stiffening
    isotropy: float = 0.0
    relaxation: tuple[float, ...] = (0.10, 0.15, 0.15, 0.08)  # g_i
    times: tuple[float, ...] = (0.08, 0.6, 4.0, 30.0)  # tau_i, s
    softening: float = 0.05  # a
    softening_rise: float = 6.0  # s
    softening_fall: float = 600.0  # s
    softening_force: float = 0.5  # N at which w is 1
    softening_end: float = 0.0  # how far w stops at 1, whatever the force


SUCTION: dict[str, SuctionTissue] = {
    "forearm": SuctionTissue(compliance=7.5e-9),
    "face": SuctionTissue(compliance=9.5e-9, creep=(0.15, 0.2, 0.25, 0.3), residual=0.2),
    "forehead": SuctionTissue(compliance=6.5e-9, exponent=0.35),
    "cheek": SuctionTissue(compliance=12e-9, creep=(0.15, 0.2, 0.3, 0.35), residual=0.22),
    "jaw": SuctionTissue(compliance=10e-9, creep=(0.15, 0.2, 0.25, 0.3), residual=0.2),
    "fingertip": SuctionTissue(compliance=5e-9, knee=15e3, exponent=0.5, creep=(0.2, 0.15, 0.15, 0.15)),
}

SHEET: dict[str, SheetTissue] = {
    "forearm": SheetTissue(stiffness=(840.0, 640.0, 480.0)),
    "upper arm": SheetTissue(stiffness=(520.0, 430.0, 330.0)),
    "face": SheetTissue(stiffness=(600.0, 480.0, 380.0)),
    "forehead": SheetTissue(stiffness=(740.0, 620.0, 470.0), angle=0.0),
    "cheek": SheetTissue(stiffness=(470.0, 420.0, 330.0)),
    "jaw": SheetTissue(stiffness=(540.0, 450.0, 350.0), angle=-0.4),
}

_RIGID_COMPLIANCE = 1e-14  # m/Pa and, as its inverse, far above any instrument's own stiffness

SPECIMENS: dict[str, tuple[SuctionTissue, SheetTissue]] = {
    "rigid block": (
        SuctionTissue(_RIGID_COMPLIANCE, exponent=1.0, creep=(), times=(), residual=0.0, softening=0.0),
        SheetTissue((1e5, 1e5, 1e5), angle=0.0, exponent=0.0, relaxation=(), times=(), softening=0.0),
    ),
    "open air": (
        SuctionTissue(0.0, exponent=1.0, creep=(), times=(), residual=0.0, softening=0.0),
        SheetTissue((0.0, 0.0, 0.0), angle=0.0, exponent=0.0, relaxation=(), times=(), softening=0.0),
    ),
    "silicone": (
        SuctionTissue(6e-9, exponent=0.8, creep=(0.03,), times=(0.5,), residual=0.0, softening=0.0),
        SheetTissue((450.0, 450.0, 350.0), angle=0.0, exponent=0.1, relaxation=(0.04,), times=(0.5,), softening=0.0),
    ),
}
"""Reference specimens for both kinds of instrument: known bodies in place of skin."""


def suction_tissue(name: str) -> SuctionTissue:
    """The named skin site or reference specimen. Raises ValueError that lists the known names."""
    if name in SPECIMENS:
        return SPECIMENS[name][0]
    return _look_up(SUCTION, name)


def sheet_tissue(name: str) -> SheetTissue:
    """The named skin site or reference specimen. Raises ValueError that lists the known names."""
    if name in SPECIMENS:
        return SPECIMENS[name][1]
    return _look_up(SHEET, name)


def for_opening(tissue: SuctionTissue, opening: float) -> SuctionTissue:
    """The tissue as a probe of ``opening`` (diameter, m) meets it."""
    scale = (opening / REFERENCE_OPENING) ** OPENING_EXPONENT
    return replace(
        tissue, compliance=tissue.compliance * scale, softening_height=tissue.softening_height * max(scale, 1e-12)
    )


def _look_up(table: dict[str, T], name: str) -> T:
    try:
        return table[name]
    except KeyError:
        raise ValueError(f"no tissue {name!r}; there are {', '.join([*table, *SPECIMENS])}") from None
