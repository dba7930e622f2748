"""The platform's kinematics against its own constraints, and the force matrix."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.microrobot import forces
from drivers.microrobot.kinematics import GEOMETRY, Geometry, conditioning, forward, inverse, jacobian, pose, reach

HALF = GEOMETRY.stroke / 2
AXES = np.random.default_rng(3).uniform(-HALF, HALF, (20_000, 3))
ANGLES = np.arange(3) * 2 * np.pi / 3


def test_centre_pose_is_zero() -> None:
    np.testing.assert_allclose(forward(np.zeros(3)), 0, atol=1e-18)
    np.testing.assert_allclose(inverse(np.zeros(3)), 0, atol=1e-18)


def test_round_trips_over_the_whole_workspace() -> None:
    tip = forward(AXES)
    assert np.abs(inverse(tip) - AXES).max() <= 1e-12
    assert np.abs(forward(inverse(tip)) - tip).max() <= 1e-12


def test_every_pivot_lies_on_its_vertical_line_and_on_its_slide() -> None:
    p = pose(AXES)
    for i, angle in enumerate(ANGLES):
        rim = GEOMETRY.axis_radius * np.array([np.cos(angle), np.sin(angle)])
        pivot = np.column_stack([np.broadcast_to(rim, (len(AXES), 2)), AXES[:, i]])
        slide = p.rotation @ np.array([np.cos(angle), np.sin(angle), 0.0])
        np.testing.assert_allclose(p.centre + p.slides[:, i, None] * slide, pivot, atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(p.rotation), 1.0, rtol=1e-12)
    tip = p.centre + GEOMETRY.tip_height * p.rotation[..., 2] - [0, 0, GEOMETRY.tip_height]
    np.testing.assert_allclose(tip, forward(AXES), atol=1e-15)


def test_parasitic_motion_is_there_and_of_second_order() -> None:
    tilt = np.array([1.0, -0.5, -0.5])
    shift = np.array([forward(a * tilt)[2] for a in (1e-3, 2e-3)])
    assert 3.9 < shift[1] / shift[0] < 4.1
    assert abs(shift[0]) > 1e-6


def test_jacobian_agrees_with_differences() -> None:
    axes, step = AXES[:500], 1e-6
    for m in range(3):
        nudge = step * np.eye(3)[m]
        slope = (forward(axes + nudge) - forward(axes - nudge)) / (2 * step)
        np.testing.assert_allclose(jacobian(axes)[..., m], slope, atol=1e-7)


def test_symmetry_under_a_third_of_a_turn() -> None:
    turn = np.array([[-0.5, -np.sqrt(0.75), 0], [np.sqrt(0.75), -0.5, 0], [0, 0, 1]])
    np.testing.assert_allclose(forward(np.roll(AXES, 1, axis=1)), forward(AXES) @ turn.T, atol=1e-15)


def test_reach_says_what_forbids() -> None:
    r = reach([[1.4e-3, 0, 0], [0, 0, 5.1e-3], [4.5e-3, 0, 0], [25e-3, 0, 0]])
    assert r.ok.tolist() == [True, False, False, False]
    assert r.within_stroke.tolist() == [True, False, False, False]
    assert r.pose_exists.tolist() == [True, True, True, False]
    assert np.isnan(inverse([25e-3, 0, 0])).all()
    assert conditioning(np.zeros(3)) == pytest.approx(0.943, abs=1e-3)
    assert conditioning(AXES).min() > 0.5


def test_near_the_singularity_the_check_warns() -> None:
    steep = Geometry(stroke=1.0, slide_travel=1.0)
    assert not reach([19.9e-3, 0, 0], steep).ok


def test_shapes_are_kept_and_wrong_ones_named() -> None:
    assert forward(np.zeros((4, 5, 3))).shape == (4, 5, 3)
    assert jacobian(np.zeros((4, 5, 3))).shape == (4, 5, 3, 3)
    assert inverse(np.zeros((0, 3))).shape == (0, 3)
    with pytest.raises(ValueError, match="three components"):
        forward(np.zeros((3, 2)))


@settings(max_examples=40, deadline=None)
@given(st.floats(0.01, 0.1), st.floats(0.3, 2.0), st.tuples(*[st.floats(-0.15, 0.15)] * 3))
def test_round_trip_for_any_geometry(radius: float, slender: float, relative: tuple[float, float, float]) -> None:
    geometry = Geometry(radius, radius * slender)  # a flatter one has a second pose for the same tip
    axis = radius * np.array(relative)
    np.testing.assert_allclose(inverse(forward(axis, geometry), geometry), axis, atol=1e-11)


def test_force_matrix_is_the_papers() -> None:
    w, h = forces.TRANSDUCER_RADIUS, forces.PROBE_HEIGHT
    assert w == pytest.approx(8.66e-3, abs=1e-5)
    leg = np.array([0.3, -0.1, 0.4])
    expected = [
        np.sqrt(3) * w / (2 * h) * (leg[2] - leg[0]),
        w / h * leg[1] - w / (2 * h) * (leg[0] + leg[2]),
        -leg.sum(),
    ]
    np.testing.assert_allclose(forces.reaction(leg), expected)
    np.testing.assert_allclose(forces.legs(forces.reaction(leg)), leg)
    with pytest.raises(ValueError, match="positive w and h"):
        forces.matrix(h=0.0)


def test_voltages_tare_and_range() -> None:
    calibration = forces.Calibration(sensitivity=(0.012, 0.0122, 0.0118), null=(0.001, -0.002, 0.0))
    legs = np.random.default_rng(0).uniform(0, 10, (50, 3))
    np.testing.assert_allclose(forces.transducer_forces(forces.transducer_volts(legs, calibration), calibration), legs)
    assert forces.transducer_volts(forces.GRAM_FORCE) == pytest.approx(0.12e-3)
    np.testing.assert_allclose(forces.tare(legs), legs.mean(axis=0))
    with pytest.raises(ValueError, match="shape"):
        forces.tare(np.zeros((0, 3)))
    with pytest.raises(ValueError, match="finite"):
        forces.tare(np.full((2, 3), np.nan))
    assert forces.out_of_range([-0.1, 1.0, 15.0]).tolist() == [True, False, True]
