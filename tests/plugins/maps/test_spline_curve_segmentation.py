"""A scan cut into clusters (Algorithm 5, mended)."""

import numpy as np
import pytest

from knotwork.plugins.maps.spline_curve.segmentation import clusters_of


def rows(xy):
    """Points (n, 2) as `Beams` has them, without normals."""
    return np.column_stack([xy, np.zeros_like(xy)]).astype(float)


def sizes(points, gap=0.3, line=0.0, relative=3.0, least=8, closed=False):
    return np.diff(clusters_of(points, gap, line, relative, least, closed).starts).tolist()


def test_clusters_are_those_that_were_put_in_and_the_last_is_kept():
    """The errata's example: the printed Algorithm 5 returns sizes {0, 25}."""
    x = np.concatenate([start + 0.05 * np.arange(n) for start, n in ((0, 21), (3, 4), (6, 21), (9, 21))])
    assert sizes(rows(np.column_stack([x, np.ones_like(x)]))) == [21, 21, 21]


def test_gaps_that_grow_slowly_end_a_cluster_too():
    x = np.cumsum(0.01 * 2.9 ** np.arange(10))
    x = np.concatenate([x[0] - 0.01 * np.arange(10, 0, -1), x])
    assert sizes(rows(np.column_stack([x, np.ones_like(x)])), gap=0.3) == [14]


def test_a_repeated_point_does_not_split_a_cluster():
    x = 0.05 * np.arange(20)
    x = np.insert(x, 10, x[10])
    assert sizes(rows(np.column_stack([x, np.ones_like(x)]))) == [20]


def test_the_first_and_last_cluster_of_a_full_turn_are_one():
    angle = np.deg2rad(np.delete(np.arange(360.0), np.arange(100, 120)))
    points = rows(2.0 * np.column_stack([np.cos(angle), np.sin(angle)]))
    assert sizes(points, closed=False) == [100, 240]
    assert sizes(points, closed=True) == [340]


def test_a_wall_seen_in_dots_is_one_cluster_if_its_dots_lie_on_a_line():
    x = 0.7 * np.arange(12)
    points = np.column_stack([x, np.ones(12), np.zeros(12), np.ones(12)])
    assert sizes(points, line=1.0) == [12]
    assert sizes(points, line=0.5) == []
    points[:, 2:] = np.sqrt(0.5)  # the beams' normals say otherwise
    assert sizes(points, line=1.0) == []


def test_the_length_of_a_cluster_does_not_grow_with_noise():
    rng = np.random.default_rng(0)
    x = 0.02 * np.arange(200)
    y = 2.0 + 0.01 * rng.standard_normal(200)
    chord = clusters_of(rows(np.column_stack([x, y])), 0.3, 0.0, 3.0, 8, False).chord
    plain = np.hypot(np.diff(x), np.diff(y)).sum()
    assert plain > 1.15 * x[-1]
    assert chord[-1] == pytest.approx(x[-1], rel=0.03)
