"""Basis weights against SciPy, and the identities that must hold."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from knotwork.core.errors import InputError
from knotwork.core.splines import UniformBasis, basis

DEGREES = st.integers(1, 5)
OFFSETS = st.floats(-1e4, 1e4)
STEPS = st.sampled_from([0.05, 0.1, 0.125, 0.3, 1.0, 7.3])


def reference(spline_basis: UniformBasis, tau: np.ndarray, n: int, order: int) -> np.ndarray:
    """Return the (len(tau), n) matrix of SciPy's basis functions."""
    spline = BSpline(spline_basis.knots(n), np.eye(n), spline_basis.degree)
    return (spline.derivative(order) if order else spline)(tau)


@settings(max_examples=150, deadline=None)
@given(DEGREES, OFFSETS, STEPS, st.integers(0, 3), st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_matrix_equals_scipy(degree, origin, step, order, shares):
    spline_basis = UniformBasis(degree, origin, step)
    n = degree + 6
    low, high = spline_basis.domain(n)
    tau = np.clip(low + np.array(shares) * (high - low), low, high)
    order = min(order, degree)
    if order == degree:  # SciPy and we may take either side of a knot where the derivative jumps
        phase = (tau - origin) / step
        tau = tau[np.abs(phase - np.round(phase)) > 1e-6]
    if not len(tau):
        return
    ours = spline_basis.matrix(tau, n, order).toarray() * step**order
    tolerance = 1e-9 + 50 * np.finfo(float).eps * abs(origin) / step
    np.testing.assert_allclose(ours, reference(spline_basis, tau, n, order) * step**order, atol=tolerance)


@settings(max_examples=100, deadline=None)
@given(DEGREES, st.floats(0, 1, exclude_max=True))
def test_partition_of_unity_and_positivity(degree, t):
    weights = np.empty((degree + 1, degree + 1))
    for order in range(degree + 1):
        basis.fill_derivative(t, degree, order, weights[order])
    assert weights[0].sum() == pytest.approx(1.0, abs=1e-14)
    assert (weights[0] >= 0).all()
    np.testing.assert_allclose(weights[1:].sum(axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize("degree", range(1, 6))
def test_derivatives_by_differences_and_beyond_the_degree(degree):
    h = 1e-6
    for t in (0.2, 0.5, 0.77):
        for order in range(1, degree + 2):
            rows = np.empty((3, degree + 1))
            basis.fill_derivative(t - h, degree, order - 1, rows[0])
            basis.fill_derivative(t + h, degree, order - 1, rows[1])
            basis.fill_derivative(t, degree, order, rows[2])
            np.testing.assert_allclose(rows[2], (rows[1] - rows[0]) / (2 * h), atol=2e-8)


@settings(deadline=None)
@given(st.floats(0, 1))
def test_cubic_closed_form_equals_recursion(t):
    row = np.empty(4)
    for order, function in enumerate((basis.cubic, basis.cubic_slope, basis.cubic_bend)):
        basis.fill_derivative(t, 3, order, row)
        np.testing.assert_allclose(function(t), row, atol=1e-14)


def test_errata_case_first_knot_not_a_multiple_of_the_interval():
    # t_1 = 0.05, D = 0.1: the printed (4.12) gets all four weights wrong.
    spline_basis = UniformBasis(3, 0.05, 0.1)
    first, weights = spline_basis.weights(0.48)
    assert first[0] == 1
    np.testing.assert_allclose(weights[0], reference(spline_basis, np.array([0.48]), 9, 0)[0, 1:5], atol=1e-14)


@settings(max_examples=60, deadline=None)
@given(OFFSETS, STEPS, st.integers(-(10**6), 10**6))
def test_index_and_local_coordinate_come_from_one_quotient(origin, step, knot):
    tau = origin + knot * step
    mu, t = basis.locate(tau, origin, step)
    assert 0 <= t < 1
    assert (mu + t) == pytest.approx((tau - origin) / step, rel=1e-15, abs=1e-9)


def test_gram_is_the_integral_of_products():
    for degree in range(1, 6):
        spline_basis = UniformBasis(degree, 0.3, 0.25)
        n = degree + 4
        low, high = spline_basis.domain(n)
        for order in range(degree + 1):
            spline = BSpline(spline_basis.knots(n), np.eye(n), degree)
            derivative = spline.derivative(order) if order else spline
            pieces = np.linspace(low, high, n - degree + 1)
            nodes, factors = np.polynomial.legendre.leggauss(8)
            expected = np.zeros((n, n))
            for a, b in pairwise(pieces):
                values = derivative(0.5 * (b - a) * (nodes + 1) + a)
                expected += 0.5 * (b - a) * np.einsum("k,ki,kj->ij", factors, values, values)
            ours = spline_basis.gram(n, order).toarray()
            np.testing.assert_allclose(ours, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(("degree", "step"), [(0, 1.0), (6, 1.0), (3, 0.0), (3, np.nan), (3, -1.0)])
def test_impossible_basis_is_refused(degree, step):
    with pytest.raises(InputError, match="expected"):
        UniformBasis(degree, 0.0, step)


def test_matrix_outside_the_domain_is_refused():
    with pytest.raises(InputError, match=r"1 of 2 parameters lie outside \[3, 5\]"):
        UniformBasis(3).matrix([4.0, 5.1], 5)
