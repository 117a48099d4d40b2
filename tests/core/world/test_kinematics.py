"""Arcs against a numerical integration of the unicycle; limits and ramps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from knotwork.core.geometry import wrap
from knotwork.core.world import kinematics as k
from knotwork.core.world.motion import Leg, Motion

finite = st.floats(-10, 10)
pose = st.tuples(finite, finite, st.floats(-3.1, 3.1))


def same_pose(a, b, tolerance):
    assert a[0] == pytest.approx(b[0], abs=tolerance)
    assert a[1] == pytest.approx(b[1], abs=tolerance)
    assert wrap(a[2] - b[2]) == pytest.approx(0.0, abs=tolerance)


def integrated(start, length, turn):
    """The unicycle driven at constant speed and yaw rate for one second."""

    def rate(_, q):
        return length * np.cos(q[2]), length * np.sin(q[2]), turn

    return solve_ivp(rate, (0, 1), start, rtol=1e-12, atol=1e-13).y[:, -1]


@settings(max_examples=40, deadline=None)
@given(pose, st.floats(-3, 3), st.floats(-6, 6))
def test_arc_is_the_integral(start, length, turn):
    same_pose(k.arc(start, length, turn), integrated(start, length, turn), 1e-9)


@given(pose, st.floats(-1, 1), st.floats(-0.004, 0.004))
def test_two_half_arcs_are_the_arc(start, length, turn):
    """Also across the border between the series and the closed form."""
    half = k.arc(start, length / 2, turn / 2)
    same_pose(k.arc(half, length / 2, turn / 2), k.arc(start, length, turn), 1e-13)


@given(st.floats(-2, 2), st.floats(-10, 10))
def test_limit_keeps_the_curvature(v, w):
    left, right = k.wheel_speeds(v, w, 0.16)
    assert k.body_twist(left, right, 0.16) == pytest.approx((v, w), abs=1e-12)
    slow = k.limited(left, right, 0.2097)
    assert max(map(abs, slow)) <= 0.2097 * (1 + 1e-12)
    vl, wl = k.body_twist(*slow, 0.16)
    assert vl * w == pytest.approx(wl * v, abs=1e-9)
    assert vl * v >= 0
    if max(abs(left), abs(right)) <= 0.2097:
        assert slow == (left, right)


def test_ramp_speeds_up_brakes_and_stops_before_it_turns_round():
    assert k.ramped(0.0, 0.2, 0.02, 0.03) == pytest.approx(0.02)
    assert k.ramped(0.1, 0.0, 0.02, 0.03) == pytest.approx(0.07)
    assert k.ramped(0.02, -0.2, 0.02, 0.03) == 0.0
    assert k.ramped(-0.2, 0.2, 0.02, 0.03) == pytest.approx(-0.17)
    assert k.ramped(0.19, 0.2, 0.02, 0.03) == 0.2


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_motion_gives_the_pose_of_any_instant(seed):
    """Legs of random speeds; against a numerical integration, forwards and backwards in time."""
    rng = np.random.default_rng(seed)
    motion, start, here = Motion(), 3_000_000_000, (1.0, -2.0, 0.5)
    begin = [here]
    speeds = rng.uniform((-0.3, -2), (0.3, 2), (5, 2))
    for i, (v, w) in enumerate(speeds):
        leg = Leg(start + i * 20_000_000, start + (i + 1) * 20_000_000, here, v, w)
        motion.append(leg)
        here = tuple(integrated(here, v * 0.02, w * 0.02))
        begin.append(here)
    times = rng.permutation(np.linspace(0, 0.0999, 37))
    for t, got in zip(times, motion.poses(start, times), strict=True):
        i = int(t // 0.02)
        v, w = speeds[i]
        expected = integrated(begin[i], v * (t - 0.02 * i), w * (t - 0.02 * i))
        same_pose(got, expected, 1e-9)
        same_pose(motion.pose(start + round(t * 1e9)), expected, 1e-9)


def test_forget_keeps_what_is_still_asked_for():
    motion = Motion()
    for i in range(4):
        motion.append(Leg(i * 10, i * 10 + 10, (float(i), 0.0, 0.0), 0.0, 0.0))
    motion.forget(20)
    assert motion.pose(20)[0] == 2.0
    motion.forget(1000)
    assert motion.pose(1000)[0] == 3.0
