import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from knotwork.core import geometry as g

number = st.floats(-50.0, 50.0)
angle = st.floats(-10.0, 10.0)
pose = st.tuples(number, number, angle)


def matrix(p):
    x, y, yaw = p
    return np.array([[math.cos(yaw), -math.sin(yaw), x], [math.sin(yaw), math.cos(yaw), y], [0, 0, 1]])


def assert_same(p, m):
    np.testing.assert_allclose(matrix(p), m, atol=1e-10)
    assert -math.pi < p[2] <= math.pi


def test_rotation_has_the_sign_of_the_errata():
    assert g.compose((1.0, 2.0, math.pi / 2), (1.0, 0.0, 0.0)) == pytest.approx((1.0, 3.0, math.pi / 2))


@given(pose, pose)
def test_group_agrees_with_homogeneous_matrices(a, b):
    assert_same(g.compose(a, b), matrix(a) @ matrix(b))
    assert_same(g.inverse(a), np.linalg.inv(matrix(a)))
    assert_same(g.relative(a, b), np.linalg.inv(matrix(a)) @ matrix(b))


@given(st.tuples(number, number, st.one_of(st.floats(-3.1, 3.1), st.floats(-1e-3, 1e-3))))
def test_exp_agrees_with_the_matrix_exponential_and_log_inverts_it(twist):
    vx, vy, w = twist
    assert_same(g.exp(twist), expm(np.array([[0, -w, vx], [w, 0, vy], [0, 0, 0]])))
    np.testing.assert_allclose(g.log(g.exp(twist)), twist, atol=1e-10)


def test_log_of_half_a_turn():
    np.testing.assert_allclose(g.log((0.0, 2.0, math.pi)), (math.pi, 0.0, math.pi), atol=1e-12)


@given(st.floats(-1e4, 1e4))
def test_wrap(a):
    w = g.wrap(a)
    assert -math.pi < w <= math.pi
    assert math.cos(w - a) == pytest.approx(1.0, abs=1e-12)


def test_wrap_takes_the_upper_end():
    assert g.wrap(-math.pi) == math.pi
    assert g.wrap(math.pi) == math.pi
    assert g.wrap(-3 * math.pi) == pytest.approx(math.pi)


def test_interpolate_is_exact_at_the_ends_and_turns_on_an_arc():
    a, b = (1.0, 0.0, 0.0), (0.0, 1.0, math.pi / 2)
    assert g.interpolate(a, b, 0.0) == a
    assert g.interpolate(a, b, 1.0) == b
    # A quarter of the unit circle: half of it is at 45 degrees.
    half = g.interpolate((1.0, 0.0, math.pi / 2), (0.0, 1.0, math.pi), 0.5)
    assert half == pytest.approx((math.sqrt(0.5), math.sqrt(0.5), 0.75 * math.pi))


@given(pose, pose)
def test_jacobians_agree_with_finite_differences(a, b):
    by_a, by_b = g.compose_jacobians(a, b)
    h = 1e-6
    for k in range(3):
        d = np.zeros(3)
        d[k] = h
        for jacobian, plus, minus in (
            (by_a, g.compose(np.array(a) + d, b), g.compose(np.array(a) - d, b)),
            (by_b, g.compose(a, np.array(b) + d), g.compose(a, np.array(b) - d)),
        ):
            change = np.subtract(plus, minus)
            change[2] = g.wrap(change[2])
            np.testing.assert_allclose(jacobian[:, k], change / (2 * h), atol=1e-6)


def test_transform_points_agrees_with_compose():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(20, 2))
    out = g.transform_points(np.array([1.0, -2.0, 0.7]), points)
    expected = [g.compose((1.0, -2.0, 0.7), (x, y, 0.0))[:2] for x, y in points]
    np.testing.assert_allclose(out, expected, atol=1e-12)
