import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knotwork.core import geometry
from knotwork.core.camera import excitation, j_l
from knotwork.core.depth.base import backing_up, drive_to, goal_pose, move_goal, swing_rate

OFFSET = 0.08
poses = st.tuples(st.floats(-1, 1.0), st.floats(-0.5, 0.5), st.floats(-0.6, 0.6))


def seen_from(points, pose):
    """Image and depth of base-frame points (n, 3) (forward, left, up) from a base at `pose`."""
    x, y = np.array([geometry.compose(geometry.inverse(pose), (*p[:2], 0.0))[:2] for p in points]).T
    return np.column_stack((-y, -points[:, 2])) / (x - OFFSET)[:, None], x - OFFSET


@settings(deadline=None, max_examples=60)
@given(poses, st.integers(0, 10**6))
def test_the_goal_pose_is_where_the_points_look_as_wanted(pose, seed):
    rng = np.random.default_rng(seed)
    points = np.column_stack((rng.uniform(2.0, 5.0, 7), rng.uniform(-1, 1, 7), rng.uniform(-0.8, 0.8, 7)))
    s, z = seen_from(points, (0.0, 0.0, 0.0))
    goal, _ = seen_from(points, pose)
    found = np.zeros(3)
    assert goal_pose(s, 1 / z, goal, OFFSET, found)
    np.testing.assert_allclose(found, pose, atol=1e-6)


def test_too_few_points_leave_the_pose_as_it_was():
    pose = np.array((0.3, 0.1, 0.2))
    assert not goal_pose(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)), OFFSET, pose)
    s = np.array([(0.1, 0.1)])
    goal_pose(s, np.ones(1), s + 0.1, OFFSET, pose)
    assert np.isfinite(pose).all()


@settings(deadline=None, max_examples=60)
@given(poses, st.floats(-0.3, 0.3), st.floats(-2, 2), st.floats(0.01, 0.5))
def test_the_goal_moves_against_the_base(pose, v, w, h):
    expected = geometry.compose(geometry.inverse(geometry.exp((v * h, 0.0, w * h))), pose)
    moved = np.array(pose)
    move_goal(moved, v, w, h)
    np.testing.assert_allclose(moved[:2], expected[:2], atol=1e-9)
    assert math.remainder(moved[2] - expected[2], math.tau) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("x", [-0.6, 0.4, 1.0])
@pytest.mark.parametrize("y", [-0.2, 0.0, 0.1])
@pytest.mark.parametrize("yaw", [-0.4, 0.0, 0.4])
def test_the_drive_arrives_within_its_bounds(x, y, yaw):
    pose, command = np.array((x, y, yaw)), np.zeros(2)
    for _ in range(400):
        drive_to(pose, 1.0, 0.2, 1.0, command)
        assert abs(command[0]) <= 0.2 * (1 + 1e-12)
        assert abs(command[1]) <= 1.0 + 1e-12
        move_goal(pose, *command, 0.05)
    assert abs(pose[0]) < 1e-3
    assert abs(pose[1]) < 5e-3
    assert abs(pose[2]) < 1e-3


def test_backing_up_meets_theorem_8_2_straight_and_shows_the_middle_only_with_a_swing():
    s = np.array([(-0.3, 0.1), (0.3, -0.2), (0.0, 0.0)])
    back = np.array((0.0, 0.0, -0.2))
    assert (j_l(s) @ np.zeros(3) <= 0).all()
    np.testing.assert_allclose(excitation(s, back), (s**2).sum(axis=1) * 0.04)
    turn = swing_rate(0.0, 0.3, 0.2, 0.2)
    assert excitation(s, np.array((-OFFSET * turn, 0.0, -0.2)))[2] == pytest.approx((OFFSET * turn) ** 2)


def test_the_swing_ends_where_it_began_and_is_as_wide_as_asked():
    way, h, v, yaw, widest = 0.0, 0.005, 0.2, 0.0, 0.0
    while way < 0.3 - 1e-9:
        yaw += swing_rate(way + 0.5 * v * h, 0.3, 0.2, v) * h
        way += v * h
        widest = max(widest, abs(yaw))
    assert widest == pytest.approx(0.2, rel=1e-3)
    assert yaw == pytest.approx(0.0, abs=1e-3)


def test_the_way_back_waits_goes_waits_and_ends():
    assert backing_up(0.0, 0.0, False, 0.3, 0.5, 0.01, -1.0) == 0.0
    assert backing_up(0.5, 0.0, False, 0.3, 0.5, 0.01, -1.0) == 1.0
    assert backing_up(1.0, 0.1, True, 0.3, 0.5, 0.01, -1.0) == -1.0
    assert backing_up(2.0, 0.3, False, 0.3, 0.5, 0.01, -1.0) == 0.0
    assert backing_up(2.2, 0.3, False, 0.3, 0.5, 0.01, 2.0) == 0.0
    assert backing_up(2.5, 0.3, False, 0.3, 0.5, 0.01, 2.0) == -1.0
