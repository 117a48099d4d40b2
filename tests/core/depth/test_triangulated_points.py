import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from knotwork.core.depth.triangulation import from_projections, from_rays


def views(k, rng, q):
    positions = rng.uniform(-0.5, 0.5, (k, 3))
    rotations = Rotation.random(k, rng).as_matrix()
    for i in range(k):  # turned so that the point is in front
        z = (q - positions[i]) / np.linalg.norm(q - positions[i])
        x = np.cross(z, rng.normal(size=3))
        x /= np.linalg.norm(x)
        rotations[i] = (
            np.column_stack((x, np.cross(z, x), z)) @ Rotation.from_rotvec(rng.normal(size=3) * 0.1).as_matrix()
        )
    local = np.einsum("kji,kj->ki", rotations, q - positions)
    return positions, rotations, local[:, :2] / local[:, 2:]


@pytest.mark.parametrize("method", [from_rays, from_projections])
@pytest.mark.parametrize("k", [2, 3, 8])
def test_exact_views_give_the_point(method, k):
    rng = np.random.default_rng(k)
    for _ in range(20):
        q = np.array((0.2, -0.1, 2.0)) + rng.normal(size=3) * 0.3
        found, condition = method(*views(k, rng, q))
        np.testing.assert_allclose(found, q, atol=1e-8)
        assert condition >= 1.0


def test_two_noisy_rays_meet_in_the_middle_of_their_shortest_segment():
    rng = np.random.default_rng(0)
    for _ in range(20):
        positions, rotations, s = views(2, rng, np.array((0.0, 0.0, 2.0)))
        s = s + rng.normal(size=s.shape) * 0.01
        d = np.einsum("kij,kj->ki", rotations, np.column_stack((s, np.ones(2))))
        # (8.3) with the second ray turned into the first frame
        matrix = np.array([[d[0] @ d[0], -d[1] @ d[0]], [d[0] @ d[1], -d[1] @ d[1]]])
        far = np.linalg.solve(matrix, [(positions[1] - positions[0]) @ d[0], (positions[1] - positions[0]) @ d[1]])
        ends = positions + far[:, None] * d
        np.testing.assert_allclose(from_rays(positions, rotations, s)[0], ends.mean(axis=0), atol=1e-9)


@pytest.mark.parametrize("method", [from_rays, from_projections])
def test_a_camera_that_only_rotates_shows_no_depth(method):
    positions = np.zeros((2, 3))
    rotations = np.stack((np.eye(3), Rotation.from_euler("y", 0.1).as_matrix()))
    q = np.array((0.1, 0.2, 1.5))
    local = np.einsum("kji,j->ki", rotations, q)
    found, condition = method(positions, rotations, local[:, :2] / local[:, 2:])
    assert math.isinf(condition)
    assert np.isnan(found).all()


def test_the_condition_says_how_far_apart_the_views_are():
    rotations = np.stack((np.eye(3), np.eye(3)))
    conditions = []
    for baseline in (0.01, 0.1, 1.0):
        positions = np.array([(0.0, 0.0, 0.0), (baseline, 0.0, 0.0)])
        s = np.array([(0.0, 0.0), (-baseline / 2.0, 0.0)])
        conditions.append(from_rays(positions, rotations, s)[1])
    assert conditions[0] > 50 * conditions[1] > 50 * conditions[2]
