import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from knotwork.core.geometry import compose, compose_jacobians
from knotwork.plugins.observers.ekf import filter as f

RNG = np.random.default_rng(7)


def covariance(rng, scale):
    a = rng.normal(size=(3, 3)) * scale
    return a @ a.T + 1e-3 * scale**2 * np.eye(3)


@given(st.integers(0, 10_000), st.floats(-3, 3))
def test_prediction_is_f_p_f_and_g_q_g(seed, yaw):
    rng = np.random.default_rng(seed)
    pose = (1.0, -2.0, yaw)
    motion = tuple(rng.normal(size=3))
    p, q = covariance(rng, 0.3), covariance(rng, 0.1)
    mean, out = f.predict(pose, f.to_triangle(p), motion, f.to_triangle(q))
    by_pose, by_motion = compose_jacobians(pose, motion)
    np.testing.assert_allclose(mean, compose(pose, motion), atol=1e-12)
    np.testing.assert_allclose(f.to_matrix(out), by_pose @ p @ by_pose.T + by_motion @ q @ by_motion.T, atol=1e-12)


def test_predicted_covariance_agrees_with_monte_carlo():
    rng = np.random.default_rng(11)
    n = 100_000
    motions = [(0.1, 0.0, 0.05), (0.2, 0.0, -0.3), (0.1, 0.02, 0.2), (0.3, 0.0, 0.1)]
    q = covariance(rng, 0.01)
    p = covariance(rng, 0.01)
    start = (3.0, 1.0, 2.0)
    samples = rng.multivariate_normal(start, p, n)
    mean, triangle = start, f.to_triangle(p)
    for motion in motions:
        mean, triangle = f.predict(mean, triangle, motion, f.to_triangle(q))
        noisy = rng.multivariate_normal(motion, q, n)
        c, s = np.cos(samples[:, 2]), np.sin(samples[:, 2])
        samples += np.c_[c * noisy[:, 0] - s * noisy[:, 1], s * noisy[:, 0] + c * noisy[:, 1], noisy[:, 2]]
    sampled = np.cov(samples.T)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    assert np.abs((f.to_matrix(triangle) - sampled) / scale).max() < 0.02


@given(st.integers(0, 10_000))
def test_correction_is_the_weighted_mean_of_two_gaussians(seed):
    rng = np.random.default_rng(seed)
    p, r = covariance(rng, 0.3), covariance(rng, 0.2)
    pose, measured = rng.normal(size=3), rng.normal(size=3) * 0.5
    assume(abs(pose[2] - measured[2]) < np.pi)  # else the nearer way round is the other one
    p_inv, r_inv = np.linalg.inv(p), np.linalg.inv(r)
    posterior = np.linalg.inv(p_inv + r_inv)
    mean = posterior @ (p_inv @ pose + r_inv @ measured)
    for got, triangle in (
        f.correct(tuple(pose), f.to_triangle(p), tuple(measured), f.to_triangle(r)),
        f.correct_information(tuple(pose), f.to_triangle(p), tuple(measured), r_inv),
    ):
        np.testing.assert_allclose(got[:2], mean[:2], rtol=1e-6, atol=1e-9)
        assert math.cos(got[2] - mean[2]) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(f.to_matrix(triangle), posterior, rtol=1e-6, atol=1e-9)
    e = measured - pose
    e[2] = math.remainder(e[2], math.tau)
    away = math.sqrt(e @ np.linalg.inv(p + r) @ e)
    assert f.distance(tuple(pose), f.to_triangle(p), tuple(measured), f.to_triangle(r)) == pytest.approx(away, rel=1e-6)
    assert f.information_distance(tuple(pose), f.to_triangle(p), tuple(measured), r_inv) == pytest.approx(
        away, rel=1e-5
    )


def test_a_corridor_corrects_across_it_only():
    # A wall along x says y and yaw, nothing of x.
    information = np.diag([0.0, 1e6, 1e6])
    prior = f.diagonal(0.1, 0.1)
    pose, triangle = f.correct_information((5.0, 0.3, 0.1), prior, (9.0, 0.0, 0.0), information)
    np.testing.assert_allclose(pose, (5.0, 0.0, 0.0), atol=1e-4)
    np.testing.assert_allclose(np.diag(f.to_matrix(triangle)), (0.01, 1e-6, 1e-6), rtol=1e-3)


@pytest.mark.parametrize("form", ["covariance", "information"])
def test_the_innovation_is_wrapped_at_half_a_turn(form):
    near = math.pi - 0.01
    p, r = f.diagonal(0.1, 0.1), np.diag([0.01, 0.01, 0.01])
    if form == "covariance":
        pose, _ = f.correct((0.0, 0.0, near), p, (0.0, 0.0, -near), f.to_triangle(r))
    else:
        pose, _ = f.correct_information((0.0, 0.0, near), p, (0.0, 0.0, -near), np.linalg.inv(r))
    assert abs(pose[2]) == pytest.approx(math.pi, abs=1e-12)


def test_rotated_agrees_with_matrices():
    q = covariance(RNG, 0.5)
    c, s = math.cos(0.8), math.sin(0.8)
    r = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(f.to_matrix(f.rotated(f.to_triangle(q), 0.8)), r @ q @ r.T, atol=1e-12)


def test_positive_means_positive_definite_and_finite():
    for scale in (1e-8, 1.0, 1e8):
        for _ in range(50):
            a = RNG.standard_normal((3, 3))
            q = scale * (a + a.T)
            assert f.is_positive(f.to_triangle(q)) == (np.linalg.eigvalsh(q)[0] > 0.0)
            assert f.is_positive(f.to_triangle(scale * (a @ a.T + 1e-6 * np.eye(3))))
    for k in range(6):
        for bad in (math.nan, math.inf, -math.inf):
            entries = [1.0, 0.1, 0.1, 1.0, 0.1, 1.0]
            entries[k] = bad
            assert not f.is_positive(tuple(entries))
    assert not f.is_positive((1.0, 1.0, 0.0, 1.0, 0.0, 1.0))
