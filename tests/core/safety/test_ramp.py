import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from knotwork.core.safety.ramp import WheelRamp, wheel_goal

SEPARATION = 0.16
FASTEST = 0.2097
UP, DOWN = 1.0, 1.5

speed = st.floats(-2.0, 2.0, allow_subnormal=False)
rim = st.floats(-FASTEST, FASTEST, allow_subnormal=False)
limit = st.none() | st.floats(0.05, 3.0)


@given(v=speed, w=st.floats(-8.0, 8.0, allow_subnormal=False), v_max=limit, w_max=limit)
def test_limits_hold_and_the_curvature_is_kept(v, w, v_max, w_max):
    left, right = wheel_goal(v, w, SEPARATION, FASTEST, v_max, w_max)
    slow_v, slow_w = (left + right) / 2, (right - left) / SEPARATION
    assert max(abs(left), abs(right)) <= FASTEST * (1 + 1e-12)
    assert v_max is None or abs(slow_v) <= v_max * (1 + 1e-9)
    assert w_max is None or abs(slow_w) <= w_max * (1 + 1e-9)
    # the same curve: v : w as asked, and in the same sense
    assert slow_v * w == pytest.approx(slow_w * v, abs=1e-12)
    assert slow_v * v >= 0
    assert slow_w * w >= 0


@given(v=st.floats(-0.1, 0.1), w=st.floats(-1.0, 1.0))
def test_a_twist_within_the_limits_is_not_changed(v, w):
    assume(abs(v) + abs(w) * SEPARATION / 2 <= FASTEST)
    left, right = wheel_goal(v, w, SEPARATION, FASTEST, None, None)
    assert (left, right) == pytest.approx((v - w * SEPARATION / 2, v + w * SEPARATION / 2), abs=1e-15)


@given(start=st.tuples(rim, rim), goal=st.tuples(rim, rim), period=st.floats(1e-3, 0.05))
def test_no_rim_changes_faster_than_its_limit_and_both_arrive_together(start, goal, period):
    ramp = WheelRamp(UP, DOWN)
    ramp.left, ramp.right = start
    steps = 0
    while (ramp.left, ramp.right) != goal:
        before = ramp.left, ramp.right
        after = ramp.step(*goal, period)
        for a, b, g in zip(before, after, goal, strict=True):
            most = DOWN if abs(g) < abs(a) and g * a >= 0 else UP
            assert abs(b - a) <= most * period * (1 + 1e-9) + 1e-15
            assert abs(g - b) <= abs(g - a) + 1e-15  # never away from the goal
        # on the straight line between start and goal in the plane of rim speeds
        cross = (after[0] - start[0]) * (goal[1] - start[1]) - (after[1] - start[1]) * (goal[0] - start[0])
        assert abs(cross) < 1e-12
        steps += 1
        assert steps < 2000


def test_a_stop_from_full_speed_takes_speed_over_deceleration():
    ramp = WheelRamp(UP, DOWN)
    ramp.left = ramp.right = FASTEST
    period = 0.001
    steps = 0
    while not ramp.standing:
        ramp.step(0.0, 0.0, period)
        steps += 1
    assert steps == math.ceil(FASTEST / DOWN / period)


def test_stopping_in_a_curve_keeps_the_curve():
    ramp = WheelRamp(UP, DOWN)
    ramp.left, ramp.right = 0.05, 0.2
    while not ramp.standing:
        ramp.step(0.0, 0.0, 0.02)
        assert ramp.left * 0.2 == pytest.approx(ramp.right * 0.05, abs=1e-12)
