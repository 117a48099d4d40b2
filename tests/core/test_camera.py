import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from knotwork.core.camera import (
    Pinhole,
    excitation,
    interaction,
    j_l,
    move_image,
    move_points,
    project,
    rigid_step,
)
from knotwork.core.errors import InputError

small = st.floats(-1.0, 1.0)
vector = st.tuples(small, small, small).map(np.array)


def step(v, w, h):
    rotation, shift = np.eye(3), np.zeros(3)
    rigid_step(v, w, h, rotation, shift)
    return rotation, shift


@settings(deadline=None, max_examples=60)
@given(vector, vector, st.sampled_from([1e-6, 1e-3, 0.05, 1.0, 3.0]))
def test_a_rigid_step_is_the_matrix_exponential_of_its_twist(v, w, h):
    twist = np.zeros((4, 4))
    twist[:3, :3] = [[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]
    twist[:3, 3] = v
    expected = expm(h * twist)
    rotation, shift = step(v, w, h)
    np.testing.assert_allclose(rotation, expected[:3, :3], atol=1e-12)
    np.testing.assert_allclose(shift, expected[:3, 3], atol=1e-12)


@settings(deadline=None, max_examples=60)
@given(st.tuples(small, small, st.floats(0.3, 3.0)).map(np.array), vector, vector)
def test_the_interaction_matrices_are_the_derivatives_of_the_image(q, v, w):
    s, chi = project(q)
    h = 1e-5
    after = []
    for sign in (-1, 1):
        moved = q[None].copy()
        move_points(moved, *step(sign * v, sign * w, h))
        after.append(project(moved))
    rate = (after[1][0] - after[0][0])[0] / (2 * h)
    chi_rate = (after[1][1] - after[0][1])[0] / (2 * h)
    np.testing.assert_allclose(interaction(s, chi) @ np.concatenate((v, w)), rate, atol=1e-6)
    np.testing.assert_allclose(chi[0] ** 2 * v[2] + chi[0] * (j_l(s) @ w)[0], chi_rate, atol=1e-5)
    lateral = interaction(s, np.ones(1))[:, :3] @ v
    assert excitation(s, v)[0] == pytest.approx(lateral @ lateral, abs=1e-12)


@settings(deadline=None, max_examples=60)
@given(st.tuples(small, small, st.floats(0.5, 3.0)).map(np.array), vector, vector)
def test_an_image_point_moves_as_the_point_it_is_of(q, v, w):
    rotation, shift = step(v, w, 0.1)
    s, chi = project(q)
    moved = q[None].copy()
    move_points(moved, rotation, shift)
    move_image(s, chi, rotation, shift, 0)
    expected = project(moved)
    np.testing.assert_allclose(s, expected[0], atol=1e-10)
    np.testing.assert_allclose(chi, expected[1], atol=1e-10)


def test_points_behind_the_camera_have_no_image():
    s, chi = project(np.array([(0.0, 0.0, 1.0), (1.0, 1.0, 0.0), (1.0, 1.0, -2.0)]))
    assert np.isfinite(s[0]).all()
    assert chi[0] == 1.0
    assert np.isnan(s[1:]).all()
    assert np.isnan(chi[1:]).all()


def test_pixels_and_normalised_coordinates_are_inverse_and_y_points_down():
    camera = Pinhole(500.0, 520.0, 320.0, 240.0)
    points = np.array([(0.15, -0.2), (0.0, 0.0)])
    np.testing.assert_allclose(camera.pixels(points), [(395.0, 136.0), (320.0, 240.0)])
    np.testing.assert_allclose(camera.normalised(camera.pixels(points)), points, atol=1e-15)


@pytest.mark.parametrize("numbers", [(0.0, 1.0, 0.0, 0.0), (-5.0, 1.0, 0.0, 0.0), (1.0, math.nan, 0.0, 0.0)])
def test_a_camera_that_cannot_be_is_refused(numbers):
    with pytest.raises(InputError, match=r"focal|finite"):
        Pinhole(*numbers)
