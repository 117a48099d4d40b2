"""Each solver of `visual-servo` gives the same answer, and it holds every bound."""

import math

import numpy as np
import pytest

from knotwork.core.depth.servo import servo_problem
from knotwork.core.messages import Depths
from knotwork.plugins.policies.visual_servo import Config, tangent_cuts
from knotwork.plugins.policies.visual_servo.policy import VisualServo
from knotwork.plugins.policies.visual_servo.program import Program
from knotwork.plugins.policies.visual_servo.solvers import compiled, solver
from knotwork.plugins.policies.visual_servo.tangent_cuts import polygon_sides

V, W = 0.1, 0.15
SQUARE = 0.07 * np.array([(x, y) for x in (-1.0, 1.0) for y in (-1.0, 1.0)])


def program(s, chi, goal, rho, *, beta=-1.0, constrained=True):
    n = len(s)
    hessian, gradient, bounds, direction = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(2)
    _, c, least = servo_problem(
        s, chi, goal, rho, np.zeros(n), np.zeros(2), 1.0, V, W, beta, hessian, gradient, bounds, direction
    )
    rows = s if constrained else s[:0]
    return Program(hessian, gradient, rows, bounds[: len(rows)], c if constrained else math.inf, direction, least, V, W)


def programs(rng):
    """Yield programs of all phases: far from the goal and near it, with bounds that meet at a point or a sliver."""
    for k in range(60):
        n = int(rng.integers(3, 10))
        s, chi = rng.uniform(-0.35, 0.35, (n, 2)), rng.uniform(0.2, 5, n)
        goal = s + rng.normal(0, 10 ** rng.uniform(-4, -0.5), (n, 2))
        rho = np.zeros(n) if k % 3 == 0 else rng.choice([0.0, 0.3, 1.0], n)
        yield program(s, chi, goal, rho, beta=0.9 if k % 2 else -1.0, constrained=k % 5 > 0)
    for lean in (0.0, 1e-5, 1e-3):
        s = SQUARE + lean * rng.normal(size=(4, 2))
        goal = 1.4 * s + 0.02
        yield program(s, rng.uniform(0.3, 2, 4), goal, np.zeros(4))
        yield program(s, rng.uniform(0.3, 2, 4), goal, np.array((0.0, 0.4, 0.4, 0.0)))
    yield program(SQUARE[:1], np.ones(1), SQUARE[:1] + 0.05, np.zeros(1))  # one point: most directions cost nothing


@pytest.mark.parametrize("name", ["clarabel", "osqp", "quadprog", "daqp", "piqp", "scs", "qpalm"])
def test_solvers_agree_and_hold_every_bound(name):
    pytest.importorskip(name)
    solve = solver(name)
    for one in programs(np.random.default_rng(7)):
        exact, u = compiled(one), solve(one)
        assert u is not None
        assert max(np.linalg.norm(u[:3]), np.linalg.norm(u[3:])) <= 1 + 1e-6
        rows, limits = one.planes()
        assert (rows @ u <= limits + 1e-6).all()
        hessian, gradient = one.scaled()
        cost = [0.5 * x @ hessian @ x + gradient @ x for x in (exact, u)]
        assert cost[1] == pytest.approx(cost[0], rel=1e-6, abs=1e-7)
        if np.linalg.eigvalsh(hessian)[0] > 1e-9:  # else the best motion is not one
            assert np.abs(u - exact).max() < 2e-3


def test_a_solver_that_does_not_end_is_a_counted_stop(context, monkeypatch):
    pytest.importorskip("osqp")
    pytest.importorskip("qpsolvers")
    monkeypatch.setitem(tangent_cuts._FIRST_ORDER["osqp"], "max_iter", 2)
    goal = {0: (0.1, 0.0), 1: (0.0, 0.1), 2: (-0.1, 0.0)}
    node = VisualServo(context(Config(goal=goal, solver="osqp")))
    s = np.array([(0.3, 0.1), (0.1, 0.3), (-0.2, 0.1)])
    for stamp in (0, 50_000_000):
        node.on_depths(Depths(stamp=stamp, ids=np.arange(3), points=s, chi=np.ones(3), uncertainty=np.full(3, np.inf)))
    sent = [message for port, message in node.context.emitted if port == "twist"]
    assert len(sent) == 2
    assert not any(message.v.any() or message.w.any() for message in sent)
    assert node.context.counts["failed_solves"] == 2
    assert [level for level, _ in node.context.reports] == ["warning"]


@pytest.mark.parametrize("seed", range(6))
def test_dropped_sides_bound_nothing(seed):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-math.pi, math.pi, 9)
    rows, limits = np.column_stack((np.cos(angle), np.sin(angle))), rng.choice([0.0, 0.2, 0.5], 9, p=(0.1, 0.5, 0.4))
    sides, ends, equal, level = polygon_sides(rows, limits, 1e-6)
    points = rng.uniform(-1, 1, (20000, 2))
    inside = (points @ rows.T <= limits).all(axis=1)
    kept = (points @ sides.T <= ends).all(axis=1) & (np.abs(points @ equal.T - level) < 1e-6).all(axis=1)
    np.testing.assert_array_equal(kept, inside)
    if len(sides) and not len(equal):
        for i in range(len(sides)):  # and none of those kept can be left out
            others = np.arange(len(sides)) != i
            assert ((points @ sides[others].T <= ends[others]).all(axis=1) & ~inside).any()


def test_a_thin_polygon_is_its_longest_diagonal_and_a_point_is_a_point():
    wedge = np.array([(0.01, 1.0), (0.01, -1.0), (-1.0, 0.0)])  # |y| <= 0.01 (1 - x)/1, x >= 0
    wedge /= np.linalg.norm(wedge, axis=1, keepdims=True)
    limits = np.array((0.01, 0.01, 0.0)) / math.sqrt(1 + 1e-4)
    sides, ends, equal, level = polygon_sides(wedge, limits, 0.05)
    assert (sides.shape, equal.shape) == ((2, 2), (1, 2))
    for share in (0.0, 0.5, 1.0):
        on = ends[0] + share * (-ends[1] - ends[0])
        point = on * sides[0] + level[0] * equal[0]
        assert (wedge @ point <= limits + 1e-8).all()
    assert ends[0] + ends[1] == pytest.approx(1.0, abs=1e-3)
    square = np.array([(y, -x) for x, y in SQUARE]) / np.linalg.norm(SQUARE, axis=1, keepdims=True)
    sides, ends, equal, level = polygon_sides(square, np.zeros(4), 1e-6)
    assert len(sides) == 0
    np.testing.assert_allclose(np.linalg.solve(equal, level), 0.0, atol=1e-8)
