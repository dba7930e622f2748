"""Laws of skin that are no elastic curve with a linear memory: against their equations, and found in sessions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.skin_laws import DASHPOT, FURTHER, PARTS, SkinLaw, activated, rewired, slowed, stiffening_sheet
from gap.null.suction_height import HeightBlock
from gap.null.suction_pressure import PressureBlock
from sim_devices.chain import Effect
from sim_devices.effects.tissue import power_law_creep
from sim_devices.stages import nominal
from sim_devices.stages.kernels import STATE, Kernel, evaluate, prony
from sim_devices.stages.tissues import SuctionTissue

FloatArray = NDArray[np.float64]
TIME = np.linspace(0.0, 6.0, 3001)
LOAD = np.interp(TIME, [0.0, 0.5, 0.8, 3.0, 3.2, 6.0], [0.0, 0.0, 1.0, 0.7, 0.0, 0.0])
TWO = (0.3, 0.4, 0.2, 3.0)


def solved(rate: Callable[[float, FloatArray, float], list[float]], size: int) -> FloatArray:
    """States (size, n) of z' = rate(t, z, load) from rest."""
    answer = solve_ivp(
        lambda t, z: rate(t, z, float(np.interp(t, TIME, LOAD))),
        (0.0, TIME[-1]),
        np.zeros(size),
        "Radau",
        TIME,
        rtol=1e-9,
        atol=1e-11,
        max_step=0.01,
    )
    return np.asarray(answer.y)


def test_activated_creep_solves_eyrings_equation() -> None:
    a, (g1, t1, g2, t2) = 5.0, TWO
    z = solved(lambda t, z, u: [np.sinh(a * (u - z[0])) / (a * t1), np.sinh(a * (u - z[1])) / (a * t2)], 2)
    np.testing.assert_allclose(
        evaluate(activated, TIME, LOAD, a, *TWO), LOAD + g1 * z[0] + g2 * z[1], atol=2e-4 * LOAD.max()
    )


def test_slowed_creep_solves_the_equation_of_reduced_time() -> None:
    a, (g1, t1, g2, t2) = 1.2, TWO
    z = solved(lambda t, z, u: [(u - z[0]) / (t1 * np.exp(a * u)), (u - z[1]) / (t2 * np.exp(a * u))], 2)
    np.testing.assert_allclose(evaluate(slowed, TIME, LOAD, a, *TWO), LOAD + g1 * z[0] + g2 * z[1], atol=2e-5)


def test_a_sheet_solves_its_equation() -> None:
    pressure, height, tension, bend, viscosity, share, tau = 20e3, 1e-3, 0.3, 0.8, 0.2, 0.25, 1.5

    def rate(t: float, z: FloatArray, load: float) -> list[float]:
        # The dashpot is a stiff spring in series with it, as in the kernel.
        stiff = viscosity / DASHPOT
        x = root(load + stiff * z[0] + share * z[1], stiff + share)
        return [(x - z[0]) / DASHPOT, (x - z[1]) / tau]

    def root(load: float, slope: float) -> float:
        x = 0.0
        for _ in range(100):
            grown = np.exp(bend * x * x)
            elastic = tension * x + (1 - tension) * x * (grown - 1) / np.expm1(bend)
            stiffness = tension + (1 - tension) * (grown - 1 + 2 * bend * x * x * grown) / np.expm1(bend)
            x -= (elastic + slope * x - load) / (stiffness + slope)
        return x

    z = solved(rate, 2)
    slope = viscosity / DASHPOT + share
    expected = [
        root(u + viscosity / DASHPOT * z1 + share * z2, slope) for u, z1, z2 in zip(LOAD, z[0], z[1], strict=True)
    ]
    made = evaluate(stiffening_sheet, TIME, -LOAD * pressure, pressure, height, tension, bend, viscosity, share, tau)
    np.testing.assert_allclose(made / height, expected, atol=2e-4)


def test_a_sheet_reaches_its_height_in_the_end() -> None:
    held = np.minimum(TIME / 0.1, 1.0) * -10e3
    made = evaluate(stiffening_sheet, TIME, held, 10e3, 2e-3, 0.2, 1.0, 0.05, 0.2, 0.5)
    assert made[-1] == pytest.approx(2e-3, rel=1e-3)


@pytest.mark.parametrize("kernel", [activated, slowed])
def test_without_its_amount_creep_is_linear(kernel: Kernel) -> None:
    np.testing.assert_allclose(
        evaluate(kernel, TIME, LOAD, 1e-6, *TWO), evaluate(prony, TIME, LOAD, 1.0, *TWO), atol=2e-4
    )


@pytest.mark.parametrize(
    ("kernel", "constants"),
    [(activated, (4.0, *TWO)), (slowed, (1.0, *TWO)), (stiffening_sheet, (-1.0, 1.0, 0.3, 0.8, 0.1, 0.2, 1.0))],
)
def test_calls_join_without_a_seam(kernel: Kernel, constants: tuple[float, ...]) -> None:
    whole = evaluate(kernel, TIME, LOAD, *constants)
    state, parts, p = np.zeros(STATE), np.empty_like(TIME), np.array(constants)
    for at in (slice(0, 700), slice(700, 701), slice(701, None)):
        kernel(state, TIME[at], LOAD[at], p, parts[at])
    np.testing.assert_allclose(parts, whole, atol=1e-9)


SKIN = SuctionTissue(9e-9, knee=8e3, exponent=0.3, creep=(0.3, 0.3), times=(0.7, 7.0), residual=0.0, softening=0.0)
STRONG = {
    "fung": {"fung": 1.0},
    "activation": {"activation": 6.0},
    "slowing": {"slowing": 1.2},
    "flow": {"flow": 0.2, "yield": 0.15, "rise": 0.5},
    "sheet": {"sheet": 1.0, "slack": 1.5, "bend": 0.2},
}


@pytest.mark.parametrize("law", FURTHER, ids=lambda law: "-".join((law.amounts[0], *law.nonlinear)))
def test_the_law_of_a_persons_skin_is_found(law: SkinLaw) -> None:
    """A session of each kind of skin is at the noise under its own law and far above it under the basic ones."""
    (kind,) = law.nonlinear
    at_rest = {name: 0.0 if part.of == name else part.begin for name, part in PARTS.items()}
    shares, times = zip(*power_law_creep(0.3, 0.2), strict=True) if "power" in law.amounts else (SKIN.creep, SKIN.times)
    skin = replace(SKIN, creep=shares, times=times) if kind != "sheet" else replace(SKIN, creep=(), times=())
    known = Effect(
        "skin", "tissue", ("aspiration",), "", "", "", (),
        lambda chain, _: rewired(chain, at_rest | STRONG[kind], 20e3, 0.8e-3),
    )  # fmt: skip
    legs = [own.step_hold(-level, 4.0, 6.0) for level in (20e3, 12e3, 16e3, 20e3)]
    recordings = own.suction_session("aspiration", np.random.default_rng(4), [(known, {})], legs=legs, tissue=skin)
    session, effects = GroupedSession(recordings, ("pressure",)), library("aspiration")
    block = HeightBlock(session, effects, PressureBlock(session, effects))
    null = fit(block)
    assert block.laws[0] == law
    assert null.chi2 / len(null.residual) < 1.15


@pytest.mark.parametrize("law", FURTHER, ids=lambda law: "-".join((law.amounts[0], *law.nonlinear)))
@pytest.mark.parametrize("far", [-800.0, 800.0])
def test_what_a_fit_tries_far_out_is_simulated(law: SkinLaw, far: float) -> None:
    """A logarithm without bounds must not end a diagnosis."""
    (kind,) = law.nonlinear
    tried = {name: far if part.of == kind != name else 0.0 for name, part in PARTS.items()} | {kind: 1.0}
    chain = rewired(nominal("aspiration"), tried, 20e3, 1e-3)
    made = chain.run(TIME, {"command_pressure": -20e3 * LOAD})["bulge"]
    assert len(made) == len(TIME)
    assert not np.any(np.isnan(made))


@pytest.mark.parametrize("far", [-800.0, 800.0])
def test_a_tissue_far_out_is_simulated(far: float) -> None:
    """Knee, exponent and creep times as well: a warning here would be an error elsewhere."""
    recordings = own.suction_session("aspiration", np.random.default_rng(2), legs=[own.step_hold(-15e3, 2.0, 2.0)] * 2)
    session, effects = GroupedSession(recordings, ("pressure",)), library("aspiration")
    block = HeightBlock(session, effects, PressureBlock(session, effects))
    nuisance = block.prior_mean.copy()
    for k, (name, part) in enumerate(block.PARTS.items()):
        amount = part.of == name
        nuisance[k] = part.begin if amount and name not in ("fung", "sheet") else 0.0 if amount else far
    assert np.all(np.isfinite(block.evaluate(nuisance, {}, want_jacobian=False).residual))


def test_the_compliance_and_gains_of_recordings_make_up_for_each_other_along_a_straight_line() -> None:
    """Both as logarithms: as shares, the second-order part of a step of a tenth was 190 σ, and fits crept."""
    recordings = own.suction_session("aspiration", np.random.default_rng(2), legs=[own.step_hold(-15e3, 2.0, 2.0)] * 2)
    session, effects = GroupedSession(recordings, ("pressure",)), library("aspiration")
    block = HeightBlock(session, effects, PressureBlock(session, effects))
    here = fit(block).nuisance
    moved = here.copy()
    first = len(block.PARTS) + 1
    moved[list(block.PARTS).index("compliance")] += 0.3
    moved[first : first + len(recordings)] -= 0.3
    change = (block.evaluate(here, {}, False).residual - block.evaluate(moved, {}, False).residual) * block.sigma
    assert np.max(np.abs(change)) < 2e-3 * np.max(block.measured)
