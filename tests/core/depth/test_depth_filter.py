import numpy as np

from knotwork.core.camera import move_image, move_points, project, rigid_step
from knotwork.core.depth.ekf import ekf_start, ekf_step

V, W = np.array((0.08, -0.05, 0.02)), np.array((0.05, -0.08, 0.1))


def predicted(x, rotation, shift):
    s, chi = x[None, :2].copy(), x[2:].copy()
    move_image(s, chi, rotation, shift, 0)
    return np.array((*s[0], chi[0]))


def test_one_step_is_that_of_a_textbook_filter_with_a_numeric_jacobian():
    rng = np.random.default_rng(0)
    rotation, shift = np.eye(3), np.zeros(3)
    rigid_step(V, W, 0.1, rotation, shift)
    n, sd, q_s, q_chi, h = 6, 2e-3, 1e-3, 0.1, 0.1
    state = np.column_stack((rng.uniform(-0.4, 0.4, (n, 2)), rng.uniform(0.3, 2, n)))
    root = rng.normal(size=(n, 3, 3)) * 0.05
    covariance = root @ root.transpose(0, 2, 1) + 1e-6 * np.eye(3)
    seen = np.array((1.0, 1, 1, 0, 1, 0))
    measured = state[:, :2] + rng.normal(size=(n, 2)) * 1e-2
    expected = []
    for i in range(n):
        x, p = state[i], covariance[i]
        jac = np.empty((3, 3))
        for k in range(3):
            d = np.zeros(3)
            d[k] = 1e-6
            jac[:, k] = (predicted(x + d, rotation, shift) - predicted(x - d, rotation, shift)) / 2e-6
        x = predicted(x, rotation, shift)
        p = jac @ p @ jac.T + np.diag((q_s**2 * h, q_s**2 * h, (q_chi * x[2]) ** 2 * h))
        if seen[i]:
            gain = p[:, :2] @ np.linalg.inv(p[:2, :2] + sd**2 * np.eye(2))
            x = x + gain @ (measured[i] - x[:2])
            p = p - gain @ p[:2, :]
        expected.append((x, p))
    ekf_step(state, covariance, measured, seen, rotation, shift, h, sd, q_s, q_chi)
    for i in range(n):
        np.testing.assert_allclose(state[i], np.clip(expected[i][0], (-9, -9, 0.05), (9, 9, 20)), atol=1e-7)
        np.testing.assert_allclose(covariance[i], expected[i][1], atol=1e-7)


def test_its_errors_are_as_large_as_it_says():
    rng = np.random.default_rng(1)
    n, h, sd = 400, 0.05, 1e-3
    points = np.column_stack((rng.uniform(-0.4, 0.4, (n, 2)), np.ones(n))) * rng.uniform(0.8, 2, (n, 1))
    s, chi = project(points)
    state, covariance = np.zeros((n, 3)), np.zeros((n, 3, 3))
    for i in range(n):
        x, y = s[i] + sd * rng.normal(size=2)
        ekf_start(state, covariance, i, x, y, chi[i] + 0.3 * rng.normal(), sd, 0.3)
    rotation, shift = np.eye(3), np.zeros(3)
    rigid_step(V, W, h, rotation, shift)
    for _ in range(60):
        move_points(points, rotation, shift)
        s, chi = project(points)
        ekf_step(state, covariance, s + sd * rng.normal(size=s.shape), np.ones(n), rotation, shift, h, sd, 0.0, 0.0)
    wrong = state[:, 2] - chi
    normalised = wrong**2 / covariance[:, 2, 2]
    assert 0.8 < normalised.mean() < 1.25
    assert np.abs(wrong).max() < 0.06
    assert (np.linalg.eigvalsh(covariance) > 0).all()
