"""Poses to start from cover what they are spread over: position and heading together."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from knotwork.plugins.localizers.gauss_newton.starts import around

POSE = np.array([3.0, -2.0, 0.7])


@pytest.mark.parametrize(("radius", "turn", "count"), [(1.5, 1.0, 3000), (5.0, np.pi, 4000), (0.3, 0.8, 100)])
def test_every_pose_within_has_a_start_near(radius, turn, count):
    """As near as in a grid of as many poses, whose widest gap is half its cell's diagonal."""
    rng = np.random.default_rng(0)
    r, bearing = radius * np.sqrt(rng.random(2000)), rng.uniform(-np.pi, np.pi, 2000)
    poses = np.column_stack((r * np.cos(bearing), r * np.sin(bearing), rng.uniform(-turn, turn, 2000)))
    scale = np.array([radius, radius, turn])
    starts = (around(POSE, radius, turn, count) - POSE) / scale
    cell = (2.0 * np.pi / count) ** (1 / 3)
    gaps, _ = cKDTree(starts).query(poses / scale)
    assert gaps.max() < 2.0 * np.sqrt(3.0) / 2.0 * cell
    assert np.median(gaps) < 0.7 * cell


def test_they_stay_within_and_begin_with_the_pose():
    starts = around(POSE, 1.5, 1.0, 500)
    np.testing.assert_array_equal(starts[0], POSE)
    assert np.hypot(*(starts[:, :2] - POSE[:2]).T).max() <= 1.5
    assert np.abs(starts[:, 2] - POSE[2]).max() <= 1.0
    np.testing.assert_array_equal(around(POSE, 1.5, 1.0, 1), POSE[None])
