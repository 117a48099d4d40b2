"""Planned paths, judged by dense sampling and by an independent optimiser."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from knotwork.core import path_planning
from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.path_planning import Obstacle, clearance_of, plan_path
from knotwork.core.splines import Curve


def disc(x, y, radius):
    return Obstacle(np.array([[x, y]]), radius)


def wall(x0, y0, x1, y1):
    return Obstacle(np.array([[x0, y0], [x1, y1]]))


def sampled_clearance(curve: Curve, obstacles: list[Obstacle]) -> float:
    """Least distance of dense samples from the obstacles' edges (points outside assumed)."""
    points = curve(np.linspace(*curve.domain, 4000))
    least = np.inf
    for obstacle in obstacles:
        corners = obstacle.points
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            edge = b - a
            share = np.clip((points - a) @ edge / max(edge @ edge, 1e-12), 0, 1)
            least = min(least, np.linalg.norm(points - a - share[:, None] * edge, axis=1).min() - obstacle.radius)
    return least


def test_without_obstacles_it_is_the_straight_line():
    path = plan_path([[0, 0], [3, 4]], [], 0.2)
    assert path.length() == pytest.approx(5.0, rel=1e-6)
    np.testing.assert_allclose(path(list(path.domain)), [[0, 0], [3, 4]], atol=1e-9)


SLALOM = [wall(1, -1, 1, 0.4), wall(2.2, 2, 2.2, -0.2), disc(3.4, 0.1, 0.25)]


def test_slalom_keeps_clear_and_is_smooth():
    path = plan_path([[0, 0], [1, 1], [2.2, -0.8], [3.4, 0.9], [4.5, 0]], SLALOM, 0.15, spacing=0.25)
    assert sampled_clearance(path, SLALOM) >= 0.15 - 1e-6
    assert clearance_of(path, SLALOM) >= 0.15 - 1e-6
    np.testing.assert_allclose(path(list(path.domain)), [[0, 0], [4.5, 0]], atol=1e-8)
    assert path.length() < 6.5


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6))
def test_random_discs_are_cleared(seed):
    rng = np.random.default_rng(seed)
    obstacles = [disc(x, rng.uniform(-0.4, 0.4), rng.uniform(0.1, 0.4)) for x in (1.5, 3.2, 4.9)]
    path = plan_path([[0, 0], [6.5, 0.01]], obstacles, 0.1, spacing=0.3)
    sampled, certain = sampled_clearance(path, obstacles), clearance_of(path, obstacles)
    assert certain >= 0.1 - 1e-6
    assert sampled >= certain - 1e-9  # the hull is the safe side


@pytest.mark.parametrize("push", [np.inf, 30.0])
def test_quadratic_program_against_a_general_optimiser(push):
    way = np.array([[0.0, 0.0], [3.0, 0.5]])
    curve = path_planning._along(way, 0.5)
    n = len(curve.control)
    gram = path_planning._penalty(curve, 0.05)
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(12, 2 * n))
    right = rows @ (curve.control.ravel() + rng.normal(0, 0.3, 2 * n)) - 0.1  # some point satisfies them
    ours = path_planning._solve(curve, gram, way, rows, right, push)
    ends = curve.basis.matrix(list(curve.domain), n).toarray()

    def cost(x):
        points = x.reshape(n, 2)
        missing = np.maximum(right - rows @ x, 0.0) if np.isfinite(push) else np.zeros(1)
        return float(np.sum(points * (gram @ points)) + (push if np.isfinite(push) else 0.0) * missing @ missing)

    conditions = [{"type": "eq", "fun": lambda x: (ends @ x.reshape(n, 2) - way).ravel()}]
    if np.isinf(push):
        conditions.append({"type": "ineq", "fun": lambda x: rows @ x - right})
        assert (rows @ ours.ravel() - right).min() > -1e-8
    reference = minimize(
        cost, curve.control.ravel(), constraints=conditions, method="SLSQP", options={"maxiter": 1000, "ftol": 1e-12}
    )
    assert reference.success
    assert cost(ours.ravel()) == pytest.approx(reference.fun, rel=1e-5)


def test_what_cannot_be_is_said():
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
    cell = [wall(*a, *b) for a, b in pairwise(corners)]
    with pytest.raises(KnotworkError, match="no path"):
        plan_path([[0, 0], [2, 0]], cell, 0.1)
    with pytest.raises(InputError, match="nearer than"):
        plan_path([[0, 0], [2, 0]], [disc(0.1, 0, 0.2)], 0.1)
    with pytest.raises(InputError, match="expected finite points"):
        plan_path([[0, 0]], [], 0.1)
