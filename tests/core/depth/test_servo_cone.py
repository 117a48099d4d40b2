import math

import numpy as np
import pytest
from scipy.optimize import minimize

from knotwork.core.camera import interaction
from knotwork.core.depth.servo import excitation_direction, relaxed_bounds, servo_problem, servo_terms, solve_cone

V, W = 0.1, 0.15


def problem(rng, kind):
    n = int(rng.integers(3, 10))
    s = rng.uniform(-0.4, 0.4, (n, 2))
    chi = rng.uniform(0.2, 5, n)
    goal = s + rng.normal(0, 10 ** rng.uniform(-4, -0.5), (n, 2))
    hessian, gradient = np.empty((6, 6)), np.empty(6)
    servo_terms(s, chi, goal, 1.0, hessian, gradient)
    rho = np.zeros(n) if kind == "closed" else rng.uniform(0, 1, n)
    bounds, direction = np.empty(n), np.empty(2)
    c = relaxed_bounds(s, rho, V, W, bounds)
    excitation_direction(s, goal, np.zeros(2), direction)
    if kind == "passive":
        return hessian, gradient, s[:0], bounds[:0], math.inf, direction, -1.0
    return hessian, gradient, s, bounds, c, direction, 0.9 if kind == "exciting" else -1.0


def test_terms_are_those_of_the_stacked_interaction_matrix():
    rng = np.random.default_rng(0)
    s, chi, goal = rng.normal(size=(5, 2)), rng.uniform(0.3, 2, 5), rng.normal(size=(5, 2))
    hessian, gradient = np.empty((6, 6)), np.empty(6)
    error = servo_terms(s, chi, goal, 0.7, hessian, gradient)
    matrix, e = interaction(s, chi), (s - goal).ravel()
    np.testing.assert_allclose(hessian, matrix.T @ matrix, atol=1e-12)
    np.testing.assert_allclose(gradient, 0.7 * matrix.T @ e, atol=1e-12)
    assert error == pytest.approx(np.linalg.norm(e))


@pytest.mark.parametrize("kind", ["passive", "open", "closed", "exciting"])
def test_the_answer_is_feasible_and_no_general_solver_finds_a_better_one(kind):
    rng = np.random.default_rng(5)
    radii = np.repeat((V, W), 3)
    for _ in range(12):
        h, g, s, b, c, d, least = problem(rng, kind)
        u = np.empty(6)
        assert solve_cone(h, g, s, b, c, d, least, V, W, u)
        assert np.linalg.norm(u[:3]) <= V
        assert np.linalg.norm(u[3:]) <= W
        assert (s[:, 1] * u[3] - s[:, 0] * u[4] <= b + 1e-9).all()
        assert u[2] <= c + 1e-9
        assert d @ u[:2] >= least * V - 1e-9
        rows = [
            {"type": "ineq", "fun": lambda x: 1 - x[:3] @ x[:3]},
            {"type": "ineq", "fun": lambda x: 1 - x[3:] @ x[3:]},
        ]
        rows += [
            {"type": "ineq", "fun": lambda x, p=p, q=q: q / W - (p[1] * x[3] - p[0] * x[4])}
            for p, q in zip(s, b, strict=True)
        ]
        if c < math.inf:
            rows.append({"type": "ineq", "fun": lambda x, c=c: c / V - x[2]})
        if least >= 0:
            rows.append({"type": "ineq", "fun": lambda x, d=d, least=least: d @ x[:2] - least})
        hs, gs = radii[:, None] * h * radii, radii * g
        size = max(abs(hs).max(), abs(gs).max())

        def cost(x, hs=hs, gs=gs, size=size):
            return (0.5 * x @ hs @ x + gs @ x) / size

        other = minimize(
            cost, u / radii * 0.9, constraints=rows, method="SLSQP", options={"ftol": 1e-14, "maxiter": 500}
        )
        assert cost(u / radii) <= other.fun + 1e-6 * max(1.0, abs(other.fun))


def test_the_corners_of_a_centred_square_forbid_to_pan_and_tilt():
    s = np.array([(x, y) for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
    h, g, u = np.empty((6, 6)), np.empty(6), np.empty(6)
    servo_terms(s, np.ones(4), s + 0.1, 1.0, h, g)
    assert solve_cone(h, g, s, np.zeros(4), 0.0, np.zeros(2), -1.0, V, W, u)
    assert np.abs(u[3:5]).max() < 1e-8


def test_numbers_that_are_none_give_a_stop():
    h, g, s, b, c, d, least = problem(np.random.default_rng(0), "open")
    u = np.ones(6)
    h[2, 3] = math.nan
    assert not solve_cone(h, g, s, b, c, d, least, V, W, u)
    assert not u.any()


def test_release_is_latched_and_the_direction_follows_the_last_motion():
    s = np.array([(0.1, 0.0), (0.0, 0.2)])
    goal, released = s - 0.1, np.zeros(2)
    h, g, b, d = np.empty((6, 6)), np.empty(6), np.empty(2), np.empty(2)

    def go(rho, lateral):
        rho, lateral = np.array(rho), np.array(lateral)
        return servo_problem(s, np.ones(2), goal, rho, released, lateral, 1.0, V, W, 0.9, h, g, b, d)

    assert go((0.0, 0.99), (0.0, 0.0))[2] == 0.9
    np.testing.assert_allclose(d, np.array((1, 1)) / math.sqrt(2))  # the mean error
    error, c, least = go((1.0, 0.5), (0.0, -0.3))
    assert (least, c) == (0.9, 0.05)
    np.testing.assert_allclose(d, (0, -1))
    np.testing.assert_allclose(b, (W * 0.1, 0.5 * W * 0.2))
    assert error == pytest.approx(0.2)
    assert go((0.3, 1.0), (0.0, 0.0))[2] == -1.0  # the first was certain once
    np.testing.assert_array_equal(released, 1.0)
