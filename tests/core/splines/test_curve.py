"""Curves against SciPy, quadrature, brute force and the theorems they rest on."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import CubicSpline, make_interp_spline, make_smoothing_spline
from scipy.spatial import ConvexHull, Delaunay

from knotwork.core.errors import InputError
from knotwork.core.splines import Curve, UniformBasis

DEGREES = st.integers(1, 5)
SEEDS = st.integers(0, 2**31)


def random_curve(seed=0, n=14, dim=2, degree=3, origin=0.0, step=0.5, dtype=np.float64):
    control = np.cumsum(np.random.default_rng(seed).normal(size=(n, dim)), axis=0)
    return Curve(control.astype(dtype), step=step, origin=origin, degree=degree)


@settings(max_examples=120, deadline=None)
@given(
    DEGREES,
    SEEDS,
    st.integers(1, 4),
    st.floats(-1e4, 1e4),
    st.sampled_from([0.05, 0.1, 0.3, 2.0]),
    st.sampled_from([np.float32, np.float64]),
)
def test_points_and_derivatives_equal_scipy(degree, seed, dim, origin, step, dtype):
    curve = random_curve(seed, 12, dim, degree, origin, step, dtype)
    spline = curve.to_scipy()
    low, high = curve.domain
    rng = np.random.default_rng(seed)
    tau = np.concatenate((rng.uniform(low, high, 20), spline.t[degree : -degree - 1], [low, high]))
    slack = 1e-11 + 200 * np.finfo(float).eps * abs(origin) / step
    np.testing.assert_allclose(curve(tau), spline(tau), atol=slack * 10)
    point, slope = curve.with_derivative(tau[:20])
    np.testing.assert_allclose(point, spline(tau[:20]), atol=slack * 10)
    np.testing.assert_allclose(slope * step, spline.derivative()(tau[:20]) * step, atol=slack * 100)
    for order in range(1, degree + 1):
        off_knots = np.abs((tau[:20] - origin) / step % 1 - 0.5) < 0.499
        ours = curve.derivative(tau[:20], order)[off_knots]
        theirs = spline.derivative(order)(tau[:20])[off_knots]
        np.testing.assert_allclose(ours * step**order, theirs * step**order, atol=slack * 1000)
    assert not curve.derivative(tau, degree + 1).any()
    np.testing.assert_allclose(curve(tau[3]), curve(tau)[3], atol=slack)
    np.testing.assert_allclose(curve.with_derivative(tau[3])[1] * step, slope[3] * step, atol=slack)


def test_outside_the_domain_is_nan_and_its_ends_belong_to_it():
    for degree in (3, 4):
        curve = random_curve(degree=degree, origin=10_000.05, step=0.05)
        low, high = curve.domain
        assert np.isfinite(curve([low, high, low - 1e-12, high + 1e-12])).all()
        assert np.isnan(curve([low - 0.01, high + 0.01, np.nan, np.inf, -1e300])).all()
        assert np.isnan(curve.derivative(high + 0.01)).all()


@settings(max_examples=40, deadline=None)
@given(DEGREES, SEEDS)
def test_convex_hull_property(degree, seed):
    curve = random_curve(seed, degree + 1, 2, degree)
    points = curve(np.linspace(*curve.domain, 50))
    if degree == 1:
        a, b = curve.control
        off_line = (points - a) @ np.array([-(b - a)[1], (b - a)[0]])
        np.testing.assert_allclose(off_line, 0.0, atol=1e-12)
        return
    hull = ConvexHull(curve.control)
    assert (points @ hull.equations[:, :2].T + hull.equations[:, 2] < 1e-9).all()
    assert (Delaunay(curve.control).find_simplex(points[10:40], tol=1e-9) >= 0).all()


@pytest.mark.parametrize("degree", range(1, 6))
def test_arc_length_against_adaptive_quadrature(degree):
    curve = random_curve(3, degree=degree)
    low, high = curve.domain

    def speed(tau):
        return np.linalg.norm(curve.derivative(tau))

    def length(a, b):
        knots = [k for k in curve.basis.knots(14) if a < k < b]
        edges = [a, *knots, b]
        return sum(quad(speed, x, y, epsabs=1e-12, limit=200)[0] for x, y in pairwise(edges))

    assert curve.length() == pytest.approx(length(low, high), rel=1e-8)
    a, b = low + 0.31, high - 0.77
    assert curve.length(a, b) == pytest.approx(length(a, b), rel=1e-8)
    assert curve.length(b, a) == -curve.length(a, b)
    lengths = np.linspace(0, curve.length(), 7)
    for tau, wanted in zip(curve.at_length(lengths), lengths, strict=True):
        assert curve.length(low, min(tau, high)) == pytest.approx(wanted, abs=1e-4)


def test_arc_length_of_a_straight_line_and_of_a_circle():
    line = Curve(np.outer(np.arange(8.0), [3.0, 4.0]), step=0.1)
    assert line.length() == pytest.approx(25.0, rel=1e-12)
    angle = np.linspace(0, 2 * np.pi, 400)
    circle = Curve.fit(angle, np.column_stack((np.cos(angle), np.sin(angle))), 0.1)
    assert circle.length(0.0, 2 * np.pi) == pytest.approx(2 * np.pi, rel=1e-6)
    lengths = np.linspace(0, 6.2, 40)
    np.testing.assert_allclose(circle.at_length(lengths), lengths, atol=1e-5)
    for tau, wanted in zip(circle.at_length(lengths), lengths, strict=True):
        assert circle.length(0.0, tau) == pytest.approx(wanted, abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(DEGREES, SEEDS, st.integers(1, 3))
def test_nearest_point_against_brute_force(degree, seed, dim):
    curve = random_curve(seed, 10, dim, degree)
    queries = np.random.default_rng(seed + 1).normal(size=(6, dim)) * 4
    tau, distance = curve.nearest(queries)
    dense = np.linspace(*curve.domain, 40_001)
    for k, query in enumerate(queries):
        gaps = np.linalg.norm(curve(dense) - query, axis=1)
        assert distance[k] <= gaps.min() + 1e-12
        assert distance[k] >= gaps.min() - 2e-3
        assert np.linalg.norm(curve(tau[k]) - query) == pytest.approx(distance[k], abs=1e-9)


def test_nearest_point_is_stationary_or_an_end():
    curve = random_curve(11, 30)
    queries = curve(np.linspace(*curve.domain, 50)) + np.random.default_rng(0).normal(0, 0.05, (50, 2))
    tau, _ = curve.nearest(queries)
    point, slope = curve.with_derivative(tau)
    along = np.sum((point - queries) * slope, axis=1) / np.linalg.norm(slope, axis=1)
    inner = (tau > curve.domain[0]) & (tau < curve.domain[1])
    assert inner.sum() > 40
    assert np.abs(along[inner]).max() < 1e-9
    with pytest.raises(InputError, match=r"expected \(n, 2\)"):
        curve.nearest([[1.0, 2.0, 3.0]])


@pytest.mark.parametrize("degree", range(1, 6))
def test_roughness_against_quadrature(degree):
    curve = random_curve(2, degree=degree)
    for order in range(1, degree + 1):
        total = 0.0
        knots = curve.basis.knots(14)[degree : 14 + 1]
        for a, b in pairwise(knots):
            total += quad(lambda t, o=order: np.sum(curve.derivative(t, o) ** 2), a + 1e-12, b - 1e-12)[0]
        assert curve.roughness(order) == pytest.approx(total, rel=1e-8)


@settings(max_examples=40, deadline=None)
@given(DEGREES, SEEDS, st.sampled_from([np.float32, np.float64]))
def test_update_moves_the_curve_by_the_amount(degree, seed, dtype):
    curve = random_curve(seed, degree=degree, dtype=dtype)
    rng = np.random.default_rng(seed)
    tau, amount = rng.uniform(*curve.domain), rng.normal(size=2)
    before = curve.copy()
    curve.update([tau], [amount])
    precision = 2e-5 if dtype == np.float32 else 1e-12
    np.testing.assert_allclose(curve(tau), before(tau) + amount, atol=precision)
    row = before.basis.matrix(tau, 14).toarray()
    change = np.linalg.pinv(row) @ amount[None]  # the least change that does it
    np.testing.assert_allclose(curve.control - before.control, change, atol=precision)
    with pytest.raises(InputError, match="outside"):
        curve.update([curve.domain[1] + 1], [amount])


@settings(max_examples=60, deadline=None)
@given(DEGREES, SEEDS, st.integers(0, 9), st.floats(0.1, 9), st.floats(0.1, 9))
def test_merge_is_the_weighted_mean_on_the_overlap(degree, seed, shift, alpha, beta):
    # Theorem 6.1, mended: the whole overlap of the two domains, first interval included.
    n = degree + 10
    a = random_curve(seed, n, degree=degree, step=0.1, origin=0.3)
    b = random_curve(seed + 1, n, degree=degree, step=0.1, origin=0.3 + 0.1 * shift)
    a.weights[:], b.weights[:] = alpha, beta
    for first, second, low, high in (
        (a, b, b.domain[0], a.domain[1]),
        (b, a, b.domain[0], a.domain[1]),
    ):
        merged = first.merge(second)
        tau = np.linspace(low, high, 40)
        mean = (alpha * a(tau) + beta * b(tau)) / (alpha + beta)
        np.testing.assert_allclose(merged(tau), mean, atol=1e-9)
        assert merged.domain == pytest.approx((a.domain[0], b.domain[1]))
        tau = np.linspace(a.domain[0], a.basis.origin + shift * 0.1, 10)  # only a's control points act there
        tau = tau[tau >= a.domain[0]]
        if shift > degree:
            np.testing.assert_allclose(merged(tau), a(tau), atol=1e-9)
    assert merged.weights[shift:n].max() == pytest.approx(alpha + beta)


def test_merge_restores_a_curve_cut_in_two_for_every_overlap():
    whole = random_curve(4, 20, step=0.2)
    for cut in range(6, 15):
        for overlap in range(1, 7):
            left = Curve(whole.control[:cut], whole.basis)
            start = cut - overlap
            if len(whole.control) - start <= 3 or start < 0:
                continue
            right = Curve(whole.control[start:], step=0.2, origin=start * 0.2)
            merged = left.merge(right)
            np.testing.assert_allclose(merged.control, whole.control, atol=1e-14)


def test_repeated_merges_are_the_mean_and_the_limit_forgets():
    basis = UniformBasis(3, 0.0, 1.0)
    constant = lambda value: Curve(np.full((6, 1), float(value)), basis)  # noqa: E731
    mapped = constant(0)
    for value in (1, 2, 3, 4):
        mapped = mapped.merge(constant(value))
    np.testing.assert_allclose(mapped.control, 2.0)  # the printed recursion gives 2.5
    np.testing.assert_allclose(mapped.weights, 5.0)
    limited = constant(0).merge(constant(0), limit=2.0).merge(constant(3), limit=2.0)
    np.testing.assert_allclose(limited.control, 1.0)
    np.testing.assert_allclose(limited.weights, 2.0)


def test_merges_that_make_no_sense_are_refused():
    curve = random_curve()
    for other, message in (
        (random_curve(origin=0.1), "knots differ"),
        (random_curve(step=0.25), "knots differ"),
        (random_curve(degree=2), "knots differ"),
        (random_curve(dim=3), "dimensions differ"),
        (random_curve(origin=100.0), "no common part"),
    ):
        with pytest.raises(InputError, match=message):
            curve.merge(other)


@settings(max_examples=40, deadline=None)
@given(DEGREES, SEEDS, st.integers(1, 4), st.sampled_from([np.float32, np.float64]))
def test_refinement_keeps_the_curve_and_coarsening_undoes_it(degree, seed, factor, dtype):
    curve = random_curve(seed, degree=degree, origin=1.3, dtype=dtype)
    fine = curve.refine(factor)
    assert fine.domain == pytest.approx(curve.domain)
    assert fine.basis.step == pytest.approx(curve.basis.step / factor)
    tau = np.linspace(*curve.domain, 60)[1:-1]
    precision = 1e-5 if dtype == np.float32 else 1e-11
    np.testing.assert_allclose(fine(tau), curve(tau), atol=precision)
    back = fine.coarsen(factor)
    np.testing.assert_allclose(back.control, curve.control, atol=precision * 1000)
    assert back.basis.origin == pytest.approx(curve.basis.origin)


def test_coarsening_a_smooth_curve_stays_near_it():
    tau = np.linspace(0, 6, 300)
    fine = Curve.fit(tau, np.column_stack((np.cos(tau), np.sin(tau))), 0.1)
    coarse = fine.coarsen(4)
    low, high = fine.domain
    assert coarse.domain[0] == pytest.approx(low)
    assert coarse.domain[1] >= high - 1e-9
    inner = np.linspace(low, high, 200)
    assert np.abs(coarse(inner) - fine(inner)).max() < 2e-3


@pytest.mark.parametrize("degree", range(1, 6))
def test_extension_keeps_the_curve_where_it_was(degree):
    curve = random_curve(5, degree=degree)
    longer = curve.copy()
    longer.extend(before=3, after=2)
    tau = np.linspace(*curve.domain, 30)
    np.testing.assert_allclose(longer(tau), curve(tau), atol=1e-12)
    assert longer.domain == pytest.approx((curve.domain[0] - 1.5, curve.domain[1] + 1.0))
    np.testing.assert_array_equal(longer.weights[:3], 0.0)
    observed = random_curve(6, degree=degree, origin=-1.5)
    merged = longer.merge(observed)  # inserted control points carry no evidence
    np.testing.assert_allclose(merged.control[:3], observed.control[:3])


@settings(max_examples=30, deadline=None)
@given(DEGREES, SEEDS)
def test_fit_recovers_a_curve_from_scattered_data(degree, seed):
    curve = random_curve(seed, degree=degree)
    low, high = curve.domain
    tau = np.random.default_rng(seed).permutation(np.linspace(low, high, 200))
    fitted = Curve.fit(tau, curve(tau), 0.5, degree=degree)
    assert fitted.basis.degree == degree
    np.testing.assert_allclose(fitted.control, curve.control, atol=1e-8)


def test_smoothing_fit_against_the_exact_smoothing_spline():
    # With knots dense against the data the penalised fit is the smoothing spline of the same penalty.
    rng = np.random.default_rng(0)
    tau = np.linspace(0, 10, 40)
    noisy = np.sin(tau) + rng.normal(0, 0.2, 40)
    exact = make_smoothing_spline(tau, noisy, lam=0.05)
    fitted = Curve.fit(tau, noisy, 10 / 39 / 4, smoothness=0.05)
    np.testing.assert_allclose(fitted(tau)[:, 0], exact(tau), atol=1e-3)


def test_weighted_fit_equals_repeated_data():
    rng = np.random.default_rng(1)
    tau, values = rng.uniform(0, 3, 60), rng.normal(size=(60, 2))
    twice = np.arange(60) < 20
    domain = (0.0, 3.0)
    weighted = Curve.fit(tau, values, 0.5, domain=domain, smoothness=0.1, weights=1.0 + twice)
    doubled = Curve.fit(np.r_[tau, tau[twice]], np.r_[values, values[twice]], 0.5, domain=domain, smoothness=0.1)
    np.testing.assert_allclose(weighted.control, doubled.control, atol=1e-10)


def test_fits_that_cannot_be_are_refused():
    tau = np.r_[np.linspace(0, 1, 20), np.linspace(3, 4, 20)]
    with pytest.raises(InputError, match="smoothness above 0"):
        Curve.fit(tau, tau, 0.1)
    assert np.isfinite(Curve.fit(tau, tau, 0.1, smoothness=1e-6).control).all()
    with pytest.raises(InputError, match="not all finite"):
        Curve.fit(tau, np.where(tau > 3, np.nan, tau), 0.5)
    with pytest.raises(InputError, match="expected"):
        Curve.fit([], [], 0.5)
    with pytest.raises(InputError, match="outside"):
        Curve.fit(tau, tau, 0.5, domain=(0.0, 2.0))


def test_curve_through_points_is_the_natural_spline():
    points = np.random.default_rng(7).normal(size=(9, 2))
    curve = Curve.through(points, step=0.5)
    natural = CubicSpline(0.5 * np.arange(9), points, bc_type="natural")
    tau = np.linspace(0, 4, 100)
    np.testing.assert_allclose(curve(tau), natural(tau), atol=1e-10)
    for degree in (1, 2, 4, 5):
        np.testing.assert_allclose(Curve.through(points, degree=degree)(np.arange(9.0)), points, atol=1e-9)


@pytest.mark.parametrize("degree", range(1, 6))
def test_conversion_from_scipy_clamped_or_not(degree):
    curve = random_curve(9, degree=degree)
    same = Curve.from_scipy(curve.to_scipy())
    np.testing.assert_allclose(same.control, curve.control)
    knots = np.r_[[0.0] * degree, np.arange(8.0), [7.0] * degree] * 0.3 + 2.0
    rng = np.random.default_rng(0)
    from scipy.interpolate import BSpline

    clamped = BSpline(knots, rng.normal(size=(len(knots) - degree - 1, 3)), degree)
    ours = Curve.from_scipy(clamped)
    tau = np.linspace(2.0, 4.1, 100)
    np.testing.assert_allclose(ours(tau), clamped(tau), atol=1e-9)
    uneven = make_interp_spline([0, 1, 1.7, 4, 5, 7, 9, 12], rng.normal(size=8), k=degree)
    if degree < 5:
        with pytest.raises(InputError, match="evenly"):
            Curve.from_scipy(uneven)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_files_keep_every_bit(tmp_path, dtype):
    curve = random_curve(1, dim=3, degree=5, origin=1e4 + 0.1, dtype=dtype)
    curve.weights[3] = 7.25
    curve.save(tmp_path / "curve.npz")
    loaded = Curve.load(tmp_path / "curve.npz")
    assert loaded.basis == curve.basis
    assert loaded.control.dtype == dtype
    np.testing.assert_array_equal(loaded.control, curve.control)
    np.testing.assert_array_equal(loaded.weights, curve.weights)


def test_shapes_are_checked():
    with pytest.raises(InputError, match="n > degree 3"):
        Curve(np.zeros((3, 2)))
    with pytest.raises(InputError, match="expected"):
        Curve(np.zeros(9))
    with pytest.raises(InputError, match="parameters of shape"):
        random_curve()(np.zeros((2, 2)))
