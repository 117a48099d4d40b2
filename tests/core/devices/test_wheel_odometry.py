import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knotwork.core.devices.wheel_odometry import WheelOdometry

RADIUS, SEPARATION, TICKS, FASTEST = 0.033, 0.16, 4096, 0.2097
TICK = 2 * math.pi / TICKS
MS = 1_000_000


def odometer(**options):
    return WheelOdometry(RADIUS, SEPARATION, TICK, FASTEST, **{"gyro": False, "covariance": True} | options)


def wrapped(count):
    return (count + 2**31) % 2**32 - 2**31


@settings(max_examples=60)
@given(
    start=st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1)),
    left=st.integers(-80, 80),
    right=st.integers(-80, 80),
    steps=st.integers(1, 60),
)
def test_constant_wheel_speeds_make_the_circle_of_the_closed_form(start, left, right, steps):
    """Also where the 32-bit counts wrap."""
    odometry = odometer()
    for k in range(steps + 1):
        counts = wrapped(start[0] + k * left), wrapped(start[1] + k * right)
        found = odometry.update(k * 20 * MS + 1, counts, (0.0, 0.0), None)
        assert found is not None
    rim = TICK * RADIUS * steps
    length, turn = rim * (left + right) / 2, rim * (right - left) / SEPARATION
    x, y, yaw = found[0].pose
    if abs(turn) > 1e-9:
        assert (x, y) == pytest.approx((length / turn * math.sin(turn), length / turn * (1 - math.cos(turn))), abs=1e-9)
    else:
        assert (x, y) == pytest.approx((length, 0.0), abs=1e-9)
    assert math.remainder(yaw - turn, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert found[1].angle == pytest.approx([TICK * steps * left, TICK * steps * right])


def test_a_single_impossible_count_is_left_out():
    odometry = odometer()
    odometry.update(1, (0, 0), (0, 0), None)
    assert odometry.update(20 * MS, (100_000, 0), (0, 0), None) is None
    found = odometry.update(40 * MS, (10, 10), (0, 0), None)
    assert found[0].pose[0] == pytest.approx(10 * TICK * RADIUS)
    assert not found[0].discontinuity
    assert (odometry.rejected, odometry.restarts) == (1, 0)


def test_two_damaged_counts_that_contradict_each_other_are_both_left_out():
    odometry = odometer()
    odometry.update(1, (0, 0), (0, 0), None)
    assert odometry.update(20 * MS, (100_000, 0), (0, 0), None) is None
    assert odometry.update(40 * MS, (-100_000, 0), (0, 0), None) is None
    assert not odometry.update(60 * MS, (5, 5), (0, 0), None)[0].discontinuity
    assert odometry.rejected == 2


def test_encoders_that_restart_go_on_from_the_same_pose_and_say_so():
    odometry = odometer()
    odometry.update(1, (50_000, 70_000), (0, 0), None)
    before = odometry.update(20 * MS, (50_050, 70_050), (0, 0), None)[0].pose
    assert odometry.update(40 * MS, (2_000, 3_000), (0, 0), None) is None
    found = odometry.update(60 * MS, (2_010, 3_010), (0, 0), None)
    assert found[0].discontinuity
    assert found[1].discontinuity
    assert found[0].pose.tolist() == before.tolist()
    after = odometry.update(80 * MS, (2_060, 3_060), (0, 0), None)
    assert not after[0].discontinuity
    assert after[0].pose[0] - before[0] == pytest.approx(50 * TICK * RADIUS)
    assert odometry.restarts == 1


def test_a_board_that_showed_old_counts_for_a_moment_has_not_restarted():
    odometry = odometer()
    odometry.update(1, (90_000, 90_000), (0, 0), None)
    odometry.update(300 * MS, (90_000, 90_000), (0, 0), None)
    assert odometry.update(320 * MS, (91_000, 91_000), (0, 0), None) is None
    found = odometry.update(340 * MS, (91_080, 91_080), (0, 0), None)
    assert not found[0].discontinuity
    assert found[0].pose[0] == pytest.approx(1_080 * TICK * RADIUS)


def test_a_host_that_paused_does_not_take_a_fast_wheel_for_a_restart():
    odometry = odometer()
    odometry.update(1, (0, 0), (0, 0), None)
    odometry.update(500 * MS, (0, 0), (0, 0), None, within=400 * MS)  # read before the pause, stamped after it
    found = odometry.update(520 * MS, (1_500, 1_500), (0, 0), None)
    assert found is not None
    assert not found[0].discontinuity


def test_the_gyro_gives_the_heading():
    odometry = odometer(gyro=True)
    odometry.update(1, (0, 0), (0, 0), None)
    found = odometry.update(100 * MS, (100, 100), (0, 0), 0.3)
    assert found[0].pose[2] == pytest.approx(0.3)
    assert np.hypot(*found[0].pose[:2]) == pytest.approx(100 * TICK * RADIUS, rel=0.01)
