"""Rough routes, judged by dense sampling and by known shortest ways."""

from itertools import pairwise

import numpy as np
import pytest

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.path_planning import Obstacle, clearance_of, plan_path
from knotwork.core.route_search import find_route
from knotwork.core.world.files import parse_world


def wall(x0, y0, x1, y1):
    return Obstacle(np.array([[x0, y0], [x1, y1]]))


def dense(route):
    shares = np.linspace(0, 1, 200)[:, None]
    return np.vstack([a + shares * (b - a) for a, b in pairwise(route)])


def distance_to_wall(points, a, b):
    a, b = np.array(a), np.array(b)
    share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(points - a - share[:, None] * (b - a), axis=1)


def test_with_nothing_in_the_way_it_is_the_straight_line():
    np.testing.assert_array_equal(find_route([0, 0], [3, 1], [], 0.2), [[0, 0], [3, 1]])


def test_it_goes_round_the_end_of_a_wall_by_the_shorter_side():
    route = find_route([0, 0], [2, 0], [wall(1, -5, 1, 0.5)], 0.2)
    points = dense(route)
    assert distance_to_wall(points, (1, -5), (1, 0.5)).min() > 0.2 - 0.05
    assert points[:, 1].max() < 1.1
    length = np.linalg.norm(np.diff(route, axis=0), axis=1).sum()
    assert 2 * np.hypot(1.0, 0.5 + 0.2) - 0.3 < length < 2 * np.hypot(1.0, 0.5 + 0.2) + 0.5


def test_a_smooth_path_among_the_shapes_of_a_world_keeps_clear():
    world = parse_world(
        "boxes: [[0, 0, 6, 4]]\n"
        "segments: [[2, 0, 2, 2.6], [4, 4, 4, 1.4]]\n"
        "circles: [[3, 2, 0.3]]\narcs: [[1, 1, 0.4, 0, 3.14]]\n"
    )
    shapes = world.obstacles()
    path = plan_path(find_route([1, 0.5], [5, 3.5], shapes, 0.2), shapes, 0.2, spacing=0.25)
    points = path(np.linspace(*path.domain, 3000))
    assert clearance_of(path, shapes) >= 0.2 - 1e-6
    assert (np.linalg.norm(points - [3, 2], axis=1) - 0.3).min() >= 0.2 - 1e-6
    upper = points[points[:, 1] >= 1.0]
    assert (abs(np.linalg.norm(upper - [1, 1], axis=1) - 0.4)).min() >= 0.2 - 1e-6
    for a, b in (((2, 0), (2, 2.6)), ((4, 4), (4, 1.4))):
        assert distance_to_wall(points, a, b).min() >= 0.2 - 1e-6
    np.testing.assert_allclose(path(list(path.domain)), [[1, 0.5], [5, 3.5]], atol=1e-8)


def test_what_cannot_be_is_said():
    room = parse_world("boxes: [[0, 0, 2, 2]]").obstacles()
    with pytest.raises(KnotworkError, match="no way"):
        find_route([1, 1], [5, 1], room, 0.2)
    with pytest.raises(InputError, match=r"0\.10 m from an obstacle"):
        find_route([1, 1], [1.9, 1], room, 0.2)
    with pytest.raises(InputError, match="cells"):
        find_route([1, 1], [1e5, 1], room, 0.2)
