import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from knotwork.core.camera import interaction
from knotwork.core.depth.single_point import (
    CONSTANT_DEPTH,
    NEAR_GOAL,
    SPICA14,
    VARYING_DEPTH,
    circle_goal,
    largest_share,
    single_point_command,
)

V, W = 0.1, 0.15
angle = st.floats(0, 2 * math.pi)


@settings(deadline=None, max_examples=150)
@given(angle, st.floats(1e-3, 1.0), angle, st.floats(0.01, 0.15))
def test_the_closed_form_is_the_optimum_of_theorem_9_1(a, size, c, r):
    b = W
    p, v = size * np.array((math.cos(a), math.sin(a))), np.array((math.cos(c), math.sin(c)))
    one, two = largest_share(*p, *v, r, b, 0.0, 0.0)
    assert 0 <= one <= 1
    assert abs(two) <= b * (1 + 1e-9)
    assert np.linalg.norm(one * p - two * v) == pytest.approx(r, abs=1e-9)
    # brute force over lambda_2: the largest lambda_1 on the circle
    grid = np.linspace(-b, b, 4001)
    half = grid * (p @ v)
    inside = half**2 - p @ p * (grid**2 - r * r)
    roots = np.where(inside >= 0, (half + np.sqrt(np.maximum(inside, 0))) / (p @ p), -np.inf)
    low = np.where(inside >= 0, (half - np.sqrt(np.maximum(inside, 0))) / (p @ p), np.inf)
    # at lambda_1 = 1 a root lies between the ends of some grid point's interval only if it changes side
    best = roots[roots <= 1].max(initial=0.0)
    reaches = ((low <= 1) & (roots >= 1)).any() and np.linalg.norm(p) > r
    assume(not reaches or one == 1.0 or best > 0)
    assert one >= best - 1e-6


@settings(deadline=None, max_examples=200)
@given(
    st.sampled_from([VARYING_DEPTH, CONSTANT_DEPTH]), angle, st.floats(0.01, 0.5), st.floats(0.1, 5.0), angle,
    st.floats(1e-6, 0.6), angle,
)  # fmt: skip
def test_bounds_hold_exactly_and_the_image_moves_along_pi(variant, a, size, chi, direction, speed, last):
    x, y = size * math.cos(a), size * math.sin(a)
    pi = speed * np.array((math.cos(direction), math.sin(direction)))
    u = np.empty(6)
    memory = 0.1 * np.array((math.cos(last), math.sin(last)))
    share = single_point_command(variant, x, y, chi, *pi, V, W, NEAR_GOAL, memory, u)
    assert np.linalg.norm(u[:3]) <= V
    assert np.linalg.norm(u[3:]) <= W
    assert u[2] == 0.0
    assert u[5] == 0.0
    fast = V if chi * V <= 0.9 * W else 0.9 * W / chi
    assert np.linalg.norm(u[:2]) == pytest.approx(fast, rel=1e-9)
    psi = y * u[3] - x * u[4]
    assert psi <= 1e-12
    if variant == CONSTANT_DEPTH:
        assert abs(psi) < 1e-12
    flow = interaction(np.array([(x, y)]), np.array([chi])) @ u
    np.testing.assert_allclose(flow, share * pi, atol=1e-9)


def test_the_older_controller_clips_its_rotation():
    u = np.empty(6)
    single_point_command(SPICA14, 0.2, 0.1, 1.0, 0.5, 0.5, V, W, NEAR_GOAL, np.zeros(2), u)
    assert np.linalg.norm(u[3:]) == pytest.approx(W)
    single_point_command(SPICA14, 0.2, 0.1, 1.0, 0.01, 0.02, V, W, NEAR_GOAL, np.zeros(2), u)
    np.testing.assert_allclose(interaction(np.array([(0.2, 0.1)]), np.ones(1)) @ u, (0.01, 0.02), atol=1e-12)


def test_near_the_goal_the_camera_keeps_its_direction():
    memory, u = np.zeros(2), np.empty(6)
    directions = []
    for k in range(50):
        tiny = 1e-4 * np.array((math.cos(k * 2.0), math.sin(k * 2.0)))
        single_point_command(VARYING_DEPTH, 0.2, 0.1, 1.0, *tiny, V, W, NEAR_GOAL, memory, u)
        directions.append(u[:2].copy())
    directions = np.array(directions)
    assert (np.einsum("ij,ij->i", directions[1:], directions[:-1]) > 0.009).all()


def test_the_goals_velocity_is_the_derivative_of_its_place():
    def at(t):
        goal, rate = np.empty(2), np.empty(2)
        circle_goal(t, 0.2, 0.1, 0.1, 10.0, goal, rate)
        return goal, rate

    for t in (0.0, 1.3, 7.7):
        np.testing.assert_allclose((at(t + 1e-6)[0] - at(t - 1e-6)[0]) / 2e-6, at(t)[1], atol=1e-9)
    np.testing.assert_allclose(at(0.0)[0], (0.3, 0.1))
