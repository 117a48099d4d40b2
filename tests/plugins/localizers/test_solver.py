"""The solver against SciPy's least squares, on residuals of closed form."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from knotwork.core.contracts import Alignment, NormalEquations
from knotwork.core.robust import CODES, loss_terms
from knotwork.plugins.localizers.gauss_newton.solver import Settings, prior_cost, solve
from knotwork.plugins.localizers.gauss_newton.starts import around

PRIOR = np.array([0.1, -0.2, 0.3])
INFORMATION = np.array([[40.0, 3.0, 1.0], [3.0, 30.0, -2.0], [1.0, -2.0, 90.0]])


class Points(Alignment):
    """Points of the robot's frame to be brought onto their partners: residuals in units of 5 cm."""

    levels = 1

    def __init__(self, points, partners):
        self.points, self.partners = points, partners

    def rows(self, pose):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        turned = self.points @ np.array([[c, s], [-s, c]])
        r = (turned + pose[:2] - self.partners) / 0.05
        J = np.zeros((*r.shape, 3))
        J[:, 0, 0] = J[:, 1, 1] = 1 / 0.05
        J[:, 0, 2], J[:, 1, 2] = -turned[:, 1] / 0.05, turned[:, 0] / 0.05
        return r.ravel(), J.reshape(-1, 3)

    def normal_equations(self, pose, level, loss="none", scale=1.0):
        r, J = self.rows(pose)
        terms = np.array([loss_terms(CODES[loss], v * v, scale) for v in r])
        weighted = J * terms[:, 1:]
        return NormalEquations(J.T @ weighted, weighted.T @ r, float(terms[:, 0].sum()), len(r), len(r))

    def costs(self, poses, level, loss="none", scale=1.0):
        return np.array([self.normal_equations(p, level, loss, scale).cost for p in poses])

    def residuals(self, pose, level):
        return self.rows(pose)

    def inliers(self, pose, level):
        return 1.0


def problem(seed, outliers):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-4, 4, (60, 2))
    true = np.array([0.25, -0.1, 0.4])
    c, s = np.cos(true[2]), np.sin(true[2])
    partners = points @ np.array([[c, s], [-s, c]]) + true[:2] + rng.normal(0, 0.05, points.shape)
    partners[:outliers] += rng.uniform(0.5, 1.0, (outliers, 2))
    return Points(points, partners)


@pytest.mark.parametrize(("loss", "outliers"), [("none", 0), ("cauchy", 15), ("huber", 15)])
@pytest.mark.parametrize("seed", range(4))
def test_it_ends_where_scipy_ends(loss, outliers, seed):
    alignment, scale = problem(seed, outliers), 3.0
    root = np.linalg.cholesky(INFORMATION).T

    def cost(pose):
        return alignment.normal_equations(pose, 0, loss, scale).cost + prior_cost(pose, PRIOR, INFORMATION)

    # SciPy has one loss for all rows: the prior's go in by hand, as the robust cost's square root would not
    best = least_squares(
        lambda x: np.concatenate([[np.sqrt(alignment.normal_equations(x, 0, loss, scale).cost)], root @ (x - PRIOR)]),
        PRIOR, xtol=1e-12, ftol=1e-12, gtol=1e-12,
    )  # fmt: skip
    settings = Settings(loss, scale, 60, 1e-12, (1e-9, 1e-9), 0.5)
    solution = solve(alignment, 0, PRIOR, PRIOR, INFORMATION, settings)
    assert solution.cost == pytest.approx(cost(solution.pose), rel=1e-12)
    assert solution.cost <= cost(best.x) * (1 + 1e-9)
    np.testing.assert_allclose(solution.pose, best.x, atol=2e-5)
    assert list(solution.costs) == sorted(solution.costs, reverse=True)


def test_few_steps_do_where_gauss_newton_overshoots():
    """A residual that is large where its gradient vanishes, like the ridge of a wall in a map of log-odds."""

    class Ridge(Points):
        calls = 0

        def rows(self, pose):
            d = pose - PRIOR - 0.3
            return 5.0 - 4.0 / (1.0 + d * d), np.diag(8.0 * d / (1.0 + d * d) ** 2)

        def normal_equations(self, pose, level, loss="none", scale=1.0):
            Ridge.calls += 1
            r, J = self.rows(pose)
            return NormalEquations(J.T @ J, J.T @ r, float(r @ r), 3, 3)

    ridge = Ridge(np.zeros((0, 2)), np.zeros((0, 2)))
    settings = Settings("none", 1.0, 30, 1e-9, (1e-4, 1e-4), 0.5)
    solution = solve(ridge, 0, PRIOR, PRIOR, np.zeros((3, 3)), settings)
    np.testing.assert_allclose(solution.pose, PRIOR + 0.3, atol=2e-4)
    assert Ridge.calls <= 20


def test_starts_cover_disc_and_headings():
    starts = around(np.array([1.0, 2.0, 0.5]), 0.3, 0.8, 400)
    np.testing.assert_allclose(starts[0], [1.0, 2.0, 0.5], atol=1e-12)
    r = np.hypot(starts[:, 0] - 1.0, starts[:, 1] - 2.0)
    assert r.max() <= 0.3 + 1e-12
    for inner, outer in ((0.0, 0.15), (0.15, 0.3)):  # evenly: as many as the ring has area
        share = ((r >= inner) & (r < outer)).mean()
        assert share == pytest.approx((outer**2 - inner**2) / 0.09, abs=0.02)
    turns = np.sort(starts[:, 2] - 0.5)
    assert np.abs(turns).max() <= 0.8
    assert np.diff(turns).max() < 0.02
