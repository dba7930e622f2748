"""Sheets that do other than relax linearly, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gap.null.chains import run
from gap.null.sheet_operators import (
    ODD,
    Activated,
    Apart,
    Arms,
    Bedding,
    Chains,
    Consolidation,
    Fibres,
    Skew,
    Springs,
    turned,
)
from sim_devices.stages.kernels import evaluate, prony
from sim_devices.stages.robot import xyz

FORCE, MOVED, OUT = xyz("reaction"), xyz("skin"), xyz("felt")
TIME = np.linspace(0.0, 10.0, 1001)


def _path(seed: int = 1) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    waves = [np.sin(w * TIME) for w in (0.7, 1.9, 4.1)]
    return {s: 1e-3 * sum(a * w for a, w in zip(rng.normal(size=3), waves, strict=True)) for s in MOVED}


def _felt(op: object, signals: dict[str, np.ndarray]) -> np.ndarray:
    made = run([op], TIME, signals)
    return np.stack([made[s] for s in OUT])


@given(angle=st.floats(-3.0, 3.0))
def test_turning_there_and_back_changes_nothing(angle: float) -> None:
    path = list(_path().values())
    assert np.allclose(turned(list(turned(path, angle)), -angle), path, atol=1e-15)


def test_whole_springs_are_a_stiffness_matrix_turned() -> None:
    path, none = _path(), dict.fromkeys(FORCE, 0 * TIME)
    op = Springs("springs", "tissue", FORCE + MOVED, OUT, (300.0, 200.0, 100.0), 0.4)
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    expected = -turn @ np.diag([300.0, 200.0, 100.0]) @ turn.T @ np.stack(list(path.values()))
    assert np.allclose(_felt(op, path | none), expected, atol=1e-12)


def test_a_spring_that_slips_holds_no_more_than_its_length_and_dissipates_four_times_it() -> None:
    """Prandtl's element: over a cycle of amplitude A it takes 4 k y (A - y)."""
    k, y, reach = 500.0, 0.2e-3, 1e-3
    corners = np.array([0, reach, -reach, reach, -reach])
    path = {MOVED[0]: np.interp(TIME, np.linspace(0, 10, 5), corners), MOVED[1]: 0 * TIME, MOVED[2]: 0 * TIME}
    op = Springs("slips", "tissue", FORCE + MOVED, OUT, (k, k, k), 0.0, ((1.0, y),))
    pull = -_felt(op, path | dict.fromkeys(FORCE, 0 * TIME))[0]
    assert np.max(np.abs(pull)) == pytest.approx(k * y, rel=1e-12)
    cycle = slice(250, 751)  # from one end to the other and back
    lost = float(np.trapezoid(pull[cycle], path[MOVED[0]][cycle]))
    assert lost == pytest.approx(4 * k * y * (reach - y), rel=1e-2)


def test_a_skew_sheet_has_a_potential() -> None:
    op = Skew("skew", "tissue", FORCE + MOVED, OUT, tuple(np.linspace(-1, 1, 10)), 1e-3)
    at, h = np.array([0.3e-3, -0.7e-3, 0.5e-3]), 1e-9

    def force(where: np.ndarray) -> np.ndarray:
        return op.force([np.array([x]) for x in where])[:, 0]

    slopes = np.array([(force(at + h * e) - force(at - h * e)) / (2 * h) for e in np.eye(3)])
    assert np.allclose(slopes, slopes.T, atol=1e-6 * np.max(np.abs(slopes)))
    assert np.allclose(force(-at), force(at))  # this way and that differ: even in the displacement


def test_open_ways_consolidate_linearly_and_closing_ones_later() -> None:
    signals = _path() | {s: np.where(TIME > 0, -1.0, 0.0) for s in FORCE}
    op = Consolidation("memory", "tissue", FORCE + MOVED, OUT, (0.1, 0.2), (0.3, 2.0), 0.0)
    since = TIME - 0.5 * TIME[1]  # the step is a ramp over the first sample
    expected = 1 - 0.1 * (1 - np.exp(-since / 0.2))
    for k in ODD:
        expected -= 0.3 * 8 / (np.pi * k) ** 2 * (1 - np.exp(-since * k**2 / 2.0))
    assert np.allclose(_felt(op, signals)[0][5:], -expected[5:], atol=1e-3)
    slower = Consolidation("memory", "tissue", FORCE + MOVED, OUT, (0.1, 0.2), (0.3, 2.0), 1e6)
    assert np.all(_felt(slower, signals)[0][20:] < _felt(op, signals)[0][20:])


def test_hardly_activated_flow_relaxes_linearly_in_every_direction() -> None:
    signals = dict(zip(FORCE, (1e3 * v for v in _path(2).values()), strict=True))
    op = Activated("memory", "tissue", FORCE, OUT, 0.7, (1e-6, -0.2, 0.5, -0.1, 3.0))
    expected = [evaluate(prony, TIME, f, 1.0, -0.2, 0.5, -0.1, 3.0) for f in signals.values()]
    assert np.allclose(_felt(op, signals), expected, atol=2e-2)


def test_a_bed_resists_what_is_pushed_into_it_and_a_toe_is_soft() -> None:
    path = _path()
    force = dict(zip(FORCE, (-300.0 * path[s] for s in MOVED), strict=True))
    felt = _felt(Bedding("bedding", "tissue", FORCE + MOVED, OUT, 2e5, 0.0, 0.4, 3e-4), force | path)
    x, y, z = (path[s] for s in MOVED)
    soft = 1 - 0.4 * np.exp(-(x**2 + y**2 + z**2) / 3e-4**2)
    assert np.allclose(felt[0], force[FORCE[0]] * soft)
    assert np.allclose(felt[2], force[FORCE[2]] * soft - 2e5 * np.where(z > 0, z, 0.0) ** 2)


def test_a_sheet_stiffens_along_each_of_its_axes_apart() -> None:
    path = _path()
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    made = _felt(Apart("apart", "tissue", MOVED, OUT, tuple(turn.ravel()), 1.0, 5e-4), path)
    u = turn.T @ np.stack([path[m] for m in MOVED])
    assert np.allclose(turn.T @ made, u + u**3 / 5e-4**2)


def test_chains_pull_by_the_inverse_langevin_function_of_their_stretch() -> None:
    """Against its inverse: coth y - 1/y = r. Cohen's approximant is 5 % off at most."""
    y = np.linspace(0.05, 6.0, 50)
    stretch = 1.0 / np.tanh(y) - 1.0 / y
    k, end = 300.0, 4e-4
    u = stretch * np.sqrt(end / k)
    path = dict(zip(MOVED, (u, 0 * u, 0 * u), strict=True))
    force = dict(zip(FORCE, (-k * u, 0 * u, 0 * u), strict=True))
    op = Chains("chains", "tissue", FORCE + MOVED, OUT, (k, 0, 0, 0, k, 0, 0, 0, k), end)
    made = run([op], np.arange(len(u), dtype=float), path | force)[OUT[0]]
    assert np.allclose(made / (-k * u), y / (3.0 * stretch), rtol=0.05)


def test_fibres_pull_along_themselves_only_and_have_a_potential() -> None:
    path, none = _path(), dict.fromkeys(FORCE, 0 * TIME)
    k, angle, length = 200.0, 0.4, 0.8e-3
    one = -_felt(Fibres("fibres", "tissue", FORCE + MOVED, OUT, k, angle, 0.0, length), path | none)
    along = np.cos(angle) * path[MOVED[0]] + np.sin(angle) * path[MOVED[1]]
    assert np.allclose(one[0], 2 * k * along * np.exp((along / length) ** 2) * np.cos(angle))
    assert np.allclose(one[2], 0.0)
    two = Fibres("fibres", "tissue", FORCE + MOVED, OUT, k, angle, 0.6, length)
    at, h = np.array([0.3e-3, -0.7e-3, 0.5e-3]), 1e-9

    def force(u: np.ndarray) -> np.ndarray:
        return two.force(list(u[:, None]))[:, 0]

    slopes = np.array([(force(at + h * e) - force(at - h * e)) / (2 * h) for e in np.eye(3)])
    assert np.allclose(slopes, slopes.T, rtol=1e-4, atol=1e-3)


def test_arms_relax_by_themselves_and_soften_with_the_skin() -> None:
    """Maxwell's arms, of a ramp: k share tau (1 - exp(-t/tau)) per speed; of skin at a steady force all is softer by
    one share."""
    ramp = {s: v * TIME for s, v in zip(MOVED, (1e-4, 0.0, -2e-4), strict=True)}
    force = {s: np.full(len(TIME), v) for s, v in zip(FORCE, (0.3, 0.0, 0.4), strict=True)}
    arms, stiffness = ((0.3, 0.5), (0.2, 4.0)), (300.0, 200.0, 100.0)
    expected = sum(share * tau * (1.0 - np.exp(-TIME / tau)) for share, tau in arms)
    for a in (0.0, 0.1):
        op = Arms("arms", "tissue", FORCE + MOVED, OUT, stiffness, 0.0, arms, (a, 0.5, 0.1, 0.1, 0.0))
        beside = np.stack(list(force.values())) - _felt(op, ramp | force)
        late = TIME > 2.0  # the softening has come to |F| / 0.5 N = 1
        np.testing.assert_allclose(beside[0, late], (1 - a) * 300.0 * 1e-4 * expected[late], rtol=1e-6)
        np.testing.assert_allclose(beside[2, late], (1 - a) * 100.0 * -2e-4 * expected[late], rtol=1e-6)
