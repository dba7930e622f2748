"""The block of the micro-robot's axes: its clock and its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from acquire.recording.model import AXIS_LOOP
from gap.design import simulated as own
from gap.design.simulated import Leg
from gap.effects.load import library
from gap.inference.hypothesis import Candidate
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.robot import robot_problems
from gap.null.robot_axes import AXES, QUANTITIES, AxesBlock
from gap.null.robot_loop import CONTROLLERS
from gap.null.robot_suspects import guessed, rubbed
from sim_devices.stages.tissues import sheet_tissue


def test_a_late_command_is_a_record_that_is_early_by_as_much() -> None:
    """The corners of a delayed command lay between nodes of the loop's grid and were cut: 6 sigma at each."""
    legs = [own.direction_cycles(0.4, 0.1, 1.2e-3, 4.0, 1)]
    axes = AxesBlock(GroupedSession(own.robot_session(np.random.default_rng(3), legs=legs), QUANTITIES), {})
    late = library("microrobot")["latency[form=0]"]
    axes = axes.knowing({"latency": late})
    candidate = Candidate("latency", "latency", "timing", late.parameters, ("axes",))
    for delay in (4e-3, 11.8e-3, 35e-3):
        moved = axes.start()
        moved[3] -= delay
        shifted = axes.evaluate(moved, {}, want_jacobian=False).residual
        delayed = axes.evaluate(axes.start(), {candidate: {"delay": delay}}, want_jacobian=False).residual
        assert np.max(np.abs(delayed - shifted)) < 0.5


def test_after_lost_samples_a_record_is_ahead() -> None:
    """A nominal command that was kept from before took the place of the one that moves up: nothing changed, and two
    lost samples (6392 -> 2602 of chi2) were told an offset of a transducer."""
    legs = [own.direction_cycles(0.4, 0.1, 1.2e-3, 4.0, 1)]
    axes = AxesBlock(GroupedSession(own.robot_session(np.random.default_rng(3), legs=legs), QUANTITIES), {})
    burst = library("microrobot")["dropped_samples[form=2,channel=0]"]
    axes = axes.knowing({"burst": burst})
    candidate = Candidate("burst", "dropped_samples", "timing", burst.parameters, ("axes",))
    ahead = axes.start()
    ahead[3] += 0.02
    sound = axes.evaluate(axes.start(), {}, want_jacobian=False).residual
    early = axes.evaluate(ahead, {}, want_jacobian=False).residual
    lost = axes.evaluate(axes.start(), {candidate: {"lost": 0.02, "moment": 2.0}}, want_jacobian=False).residual
    before, behind = axes.rows.time < 1.6, axes.rows.time > 2.5
    assert np.max(np.abs(early - sound)[behind]) > 3.0
    assert np.max(np.abs(lost - sound)[before]) < 0.1
    assert np.max(np.abs(lost - early)[behind]) < 0.5


def test_slow_noise_of_the_axes_shows_beside_a_rigid_post() -> None:
    """No session with a post had its axes' slow noise whitened: a gap of 1.3 in the axes of a sound robot."""
    legs = [own.direction_cycles(angle, 0.1, 1.2e-3, 8.0, 3) for angle in (0.0, 1.2)]
    push = replace(own.direction_cycles(0.0, np.pi / 2, 4e-5, 2.0, 1), specimen="rigid post")
    recordings, rng = own.robot_session(np.random.default_rng(3), legs=[*legs, push]), np.random.default_rng(4)
    for r in recordings:
        for name in AXES:
            series = r.streams[name]
            slow = lfilter([1.0], [1.0, -np.exp(-0.01 / 0.3)], rng.normal(size=len(series.value)))
            series.value[:] += 4e-6 * rng.normal(size=len(slow)) + 2e-6 * slow / np.std(slow)
    blocks, _ = robot_problems(recordings, {})
    axes = next(b for b in blocks if isinstance(b, AxesBlock))
    assert axes.row_noise.memory is not None
    null = fit(axes)
    assert np.sqrt(null.chi2 / len(null.residual)) < 1.1


def test_what_a_derivative_of_the_error_makes_of_a_jump_tells_nothing_for_a_moment() -> None:
    """Of a sound robot of an outside author each step was another part of the card's cycle away, and drag was told."""
    turns = np.array([0.0, 3.0, 3.0, 6.0, 6.0, 9.0])
    way = 1e-3 * np.array([0.0, 0.0, 0.8, 0.8, -0.3, -0.3])
    legs = [Leg({q: (turns, way * (q == "probe_x")) for q in QUANTITIES}, 9.0)]
    recordings = own.robot_session(np.random.default_rng(3), legs=legs)
    values = {"loop_proportional": 1500.0, "loop_integral": 12e3, "loop_derivative": 15.0, "axis_mass": 0.06}
    known = {name: {"value": value, "unit": AXIS_LOOP[name]} for name, value in values.items()}
    recordings = [replace(r, info=replace(r.info, calibration=known)) for r in recordings]
    axes = AxesBlock(GroupedSession(recordings, QUANTITIES), {})
    begin = axes.session.recordings[0].setpoints["probe_x"].time[0]
    assert not axes.controller.on_error  # the simulated loop damps the position: all rows tell
    before = axes.row_noise.sigma
    assert not np.any(before > 1e3 * np.median(before))
    axes.controller = replace(axes.controller, on_error=True)
    axes._leave_out_kicks()
    wider = axes.row_noise.sigma / before
    behind = np.tile(axes.stamps - begin, 3)
    kicked = ((behind > 2.998) & (behind < 3.02)) | ((behind > 5.998) & (behind < 6.02))
    np.testing.assert_array_equal(wider > 1e3, kicked)
    soon = ((behind > 3.02) & (behind < 3.04)) | ((behind > 6.02) & (behind < 6.04))
    assert np.min(wider[soon]) > 1.3
    assert np.max(wider[~kicked & ((behind < 2.99) | ((behind > 3.5) & (behind < 5.99)))]) < 1.01


def test_the_lever_arms_of_the_load_are_the_mechanics() -> None:
    """A vendor's loop was taken with the lever arms of the centre alone, and a force constant told for the rest."""
    legs = [own.direction_cycles(angle, 0.3, 1.2e-3, 4.0, 2) for angle in (0.0, 1.2, 2.4)]
    forearm = sheet_tissue("forearm")
    stiff = replace(forearm, stiffness=tuple(20.0 * k for k in forearm.stiffness))
    recordings = own.robot_session(np.random.default_rng(3), (), stiff, legs)
    axes = AxesBlock(GroupedSession(recordings, QUANTITIES), {})
    vendors = CONTROLLERS[1]
    axes._take(replace(vendors, centred=False), held=False)
    noise = np.random.default_rng(4).normal(size=len(axes.measured))
    axes.measured = axes._predict(axes.prior_mean, {}) + axes.sigma * noise
    wrong = axes._plain(vendors, held=False)
    axes._best = wrong
    assert axes._levered(wrong).objective < wrong.objective - 20.0
    assert axes.controller == replace(vendors, centred=False)


def test_a_controller_chosen_under_a_smoothed_load_is_weighed_once_more() -> None:
    """Of a digital loop of an outside author the wrong controller's latency left a bit less under the smoothed load,
    the right one .69 of chi2 a row under the one that is known later (the wrong one .85, told a transducer's gain)."""
    legs = [own.direction_cycles(angle, 0.1, 1.2e-3, 4.0, 2) for angle in (0.0, 1.2)]
    recordings = own.robot_session(np.random.default_rng(3), legs=legs)
    axes = AxesBlock(GroupedSession(recordings, QUANTITIES), library("microrobot"))
    right = axes.controller
    wrong = CONTROLLERS[1]
    axes._best = axes._plain(wrong, held=False)
    axes._start, axes._strained = axes._best.nuisance, True
    axes.reload({})
    assert axes.controller is right
    again = fit(axes)
    assert again.chi2 / len(again.residual) < 1.2


def test_friction_that_builds_up_over_micrometres_is_fitted_as_such() -> None:
    """Bristles of 2 um were fitted from none of it and stayed there, so that Stribeck's law, which began with some, was
    told with a kinetic friction above the static one."""
    friction = library("microrobot")["coulomb_friction[form=0,axis=0]"]
    true = {"force": 0.1, "presliding": 2.5e-6}
    legs = [own.direction_cycles(angle, 0.1, 1.2e-3, 4.0, 2) for angle in (0.0, 1.2)]
    recordings = own.robot_session(np.random.default_rng(3), [(friction, true)], legs=legs)
    block = AxesBlock(GroupedSession(recordings, QUANTITIES), {"rubs": friction})
    found = rubbed(block, guessed(block, "rubs", friction))
    assert found.active[found.hypothesis[0]] == pytest.approx(true, rel=0.3)


def test_a_loop_that_does_not_come_to_rest_is_no_place_for_a_fit() -> None:
    """It was simulated for ten times as long as others, until every axis was at its end stop."""
    legs = [own.direction_cycles(0.4, 0.1, 1.2e-3, 4.0, 1)]
    axes = AxesBlock(GroupedSession(own.robot_session(np.random.default_rng(3), legs=legs), QUANTITIES), {})
    wild = axes.start()
    wild[1] = 3.0  # of the integral gain's logarithm
    assert not np.any(np.isfinite(axes.evaluate(wild, {}, want_jacobian=False).residual))
    found = fit(axes, nuisance=wild, iterations=5)
    assert found.chi2 < 1.5 * len(found.residual)
