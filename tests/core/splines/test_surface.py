"""Surfaces against SciPy's tensor splines, finite differences and closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import NdBSpline, RectBivariateSpline

from knotwork.core.errors import InputError
from knotwork.core.splines import Surface, tiles


def random_surface(degree=3, dtype=np.float64, origin=(0.13, -0.4), step=(0.1, 0.25), first=(-20, 17), shape=(70, 45)):
    control = np.random.default_rng(5).normal(size=shape).astype(dtype)
    return Surface.from_control(control, step, first=first, origin=origin, degree=degree)


def inside_points(surface, box, n, seed=0):
    """Points over the whole domain, its borders and knots included."""
    rng = np.random.default_rng(seed)
    spline = surface.to_scipy(box)
    low = np.array([t[surface.degree] for t in spline.t])
    high = np.array([t[-1 - surface.degree] for t in spline.t])
    points = low + rng.uniform(size=(n, 2)) * (high - low)
    knots = [t[surface.degree : -1 - surface.degree] for t in spline.t]  # all but the last knot of the domain
    on_knots = np.column_stack([rng.choice(k, n // 4) for k in knots])
    return np.vstack((points, on_knots, low))


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 5),
    st.sampled_from([np.float32, np.float64]),
    st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
    st.tuples(st.integers(-500, 500), st.integers(-500, 500)),
    st.integers(0, 2**31),
)
def test_values_and_derivatives_equal_scipy(degree, dtype, origin, first, seed):
    surface = random_surface(degree, dtype, origin, first=first)
    box = (first[0], first[1], first[0] + 70, first[1] + 45)
    points = inside_points(surface, box, 40, seed)
    if degree <= 2:  # a derivative up to the second jumps at the knots: stay off them
        points = points[:40]
    spline = surface.to_scipy(box)
    assert isinstance(spline, NdBSpline)
    far = np.abs(origin).max() + 100
    slack = 200 * np.finfo(float).eps * far  # what one rounding of a coordinate may do [m]
    value, gradient, hessian = surface.with_hessian(points)
    np.testing.assert_allclose(value, spline(points), atol=1e-11 + slack / 0.1 * 10)
    for column, nu in enumerate(((1, 0), (0, 1))):
        np.testing.assert_allclose(gradient[:, column], spline(points, nu=nu), atol=1e-10 + slack / 0.1**2 * 20)
    if degree > 1:
        for (r, c), nu in (((0, 0), (2, 0)), ((0, 1), (1, 1)), ((1, 1), (0, 2))):
            bound = 1e-9 + slack / 0.1**3 * 50
            ours, theirs = hessian[:, r, c], spline(points, nu=nu)
            np.testing.assert_allclose(ours, theirs, atol=bound)
    np.testing.assert_allclose(hessian[:, 0, 1], hessian[:, 1, 0])
    again, first_partials = surface.with_gradient(points)
    np.testing.assert_allclose(again, value, atol=1e-12)
    np.testing.assert_allclose(first_partials, gradient, atol=1e-10)
    np.testing.assert_allclose(surface(points), value, atol=1e-12)
    x, y = points[3]
    np.testing.assert_allclose(surface.at(x, y), [value[3], *gradient[3]], atol=1e-10)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_patches_across_tile_borders_in_all_ways(dtype):
    surface = random_surface(3, dtype, origin=(0.0, 0.0), step=(1.0, 1.0), first=(-40, -40), shape=(80, 80))
    spline = surface.to_scipy((-40, -40, 40, 40))
    grid = np.stack(np.meshgrid(np.arange(-36, 36) + 0.31, np.arange(-36, 36) + 0.77), axis=-1).reshape(-1, 2)
    value, gradient = surface.with_gradient(grid)
    np.testing.assert_allclose(value, spline(grid), atol=1e-13)
    np.testing.assert_allclose(gradient[:, 0], spline(grid, nu=(1, 0)), atol=1e-13)
    np.testing.assert_allclose(gradient[:, 1], spline(grid, nu=(0, 1)), atol=1e-13)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("n", [0, 1, 2, 3, 5, 63, 64, 66, 131])
def test_a_batch_equals_its_points_one_by_one(dtype, n):
    surface = random_surface(dtype=dtype, origin=(0.0, 0.0), step=(0.1, 0.1), first=(0, 0), shape=(140, 140))
    rng = np.random.default_rng(n)
    points = rng.uniform(-1.0, 15.0, (n, 2))  # beyond its control points too
    points[n // 2 :] = 6.4 + rng.uniform(0.0, 0.4, (n - n // 2, 2))  # tiles meet here
    if n > 5:
        points[3] = np.nan, 0.2
    values, gradients = surface.with_gradient(points)
    alone = np.array([surface.at(x, y) for x, y in points]).reshape(-1, 3)
    np.testing.assert_allclose(values, alone[:, 0], atol=1e-13)
    np.testing.assert_allclose(gradients, alone[:, 1:], atol=1e-11)
    np.testing.assert_allclose(surface(points), alone[:, 0], atol=1e-13)


def test_derivatives_by_finite_differences():
    surface = random_surface()
    points = np.array([[-1.0, 7.0], [0.3, 5.1], [3.1, 9.9]])
    h = 1e-6
    _, gradient, hessian = surface.with_hessian(points)
    for axis, shift in enumerate(np.eye(2) * h):
        ahead, behind = surface.with_gradient(points + shift), surface.with_gradient(points - shift)
        np.testing.assert_allclose(gradient[:, axis], (ahead[0] - behind[0]) / (2 * h), atol=1e-7)
        np.testing.assert_allclose(hessian[:, axis], (ahead[1] - behind[1]) / (2 * h), atol=1e-4)


def test_untouched_plane_is_fill_and_nan_stays_nan():
    for degree in (3, 4):
        surface = Surface(0.05, degree=degree, fill=-2.5)
        points = np.array([[0.0, 0.0], [1e5, -1e9], [np.nan, 0.0], [0.0, np.inf], [1e300, 0.0]])
        value, gradient = surface.with_gradient(points)
        assert value[0] == value[1] == pytest.approx(-2.5, abs=1e-12)
        assert np.isnan(value[2])
        assert np.isnan(value[3])
        assert np.abs(gradient[:2]).max() < 1e-9
        assert surface.control.used == 1


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 5), st.sampled_from([np.float32, np.float64]), st.floats(-3, 3), st.integers(0, 10**6), st.booleans()
)
def test_update_moves_the_surface_by_the_amount_and_least(degree, dtype, amount, seed, far):
    surface = Surface((0.05, 0.1), degree=degree, dtype=dtype, origin=(0.01, 0.02))
    point = np.random.default_rng(seed).uniform(-5, 5, (1, 2)) + (1e4 if far else 0.0)
    surface.update(point, [0.7])
    before = surface.copy()
    surface.update(point, [amount])
    precision = 1e-5 if dtype == np.float32 else 1e-12
    assert surface(point)[0] == pytest.approx(0.7 + amount, abs=precision)
    # Minimum norm: the change of control points is amount phi / |phi|^2.
    i0, j0, i1, j1 = surface.control.bounds()
    change = (surface.control.block(i0, j0, i1, j1) - before.control.block(i0, j0, i1, j1)).astype(float)
    phi = np.outer(
        surface.along.matrix(point[:, 0] - i0 * 0.05, i1 - i0).toarray()[0],
        surface.across.matrix(point[:, 1] - j0 * 0.1, j1 - j0).toarray()[0],
    )
    np.testing.assert_allclose(change, amount * phi / np.sum(phi**2), atol=1e-6 if dtype == np.float32 else 1e-9)


@pytest.mark.parametrize("degree", [2, 3])
def test_updates_add_up_and_are_clamped(degree):
    points = np.random.default_rng(2).uniform(-3, 3, (400, 2))
    together, one_by_one = (Surface(0.1, degree=degree, dtype=np.float64) for _ in range(2))
    together.update(points, np.full(400, 0.5))
    for point in points:
        one_by_one.update(point[None], 0.5)
    np.testing.assert_allclose(together(points), one_by_one(points), atol=1e-12)
    together.update(points, 1000.0, -2.0, 3.0)
    assert together.control.pool.max() == 3.0
    together.update(points, -1e6, -2.0, 3.0)
    assert together.control.pool.min() == -2.0


@pytest.mark.parametrize("degree", range(1, 6))
@pytest.mark.parametrize("factor", [2, 3])
def test_refinement_keeps_the_function_and_coarsening_undoes_it(degree, factor):
    surface = Surface(0.5, degree=degree, dtype=np.float64, fill=1.5, origin=(0.2, 0.1))
    rng = np.random.default_rng(3)
    surface.update(rng.uniform(-25, 25, (60, 2)), rng.normal(size=60))
    fine = surface.refine(factor)
    points = rng.uniform(-30, 30, (500, 2))
    for ours, theirs in zip(fine.with_gradient(points), surface.with_gradient(points), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-11)
    back = fine.coarsen(factor)
    np.testing.assert_allclose(back(points), surface(points), atol=1e-8)


def test_roughness_against_quadrature():
    surface = Surface((0.5, 0.4), dtype=np.float64)
    surface.update([[0.3, 0.2], [1.0, 1.1]], [1.0, -2.0])
    step = 0.01
    x, y = (np.arange(-4, 5, step) + step / 2,) * 2
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    _, gradient, hessian = surface.with_hessian(points)
    assert surface.roughness(2) == pytest.approx(np.sum(hessian**2) * step**2, rel=1e-3)
    assert surface.roughness(1) == pytest.approx(np.sum(gradient**2) * step**2, rel=1e-3)
    assert Surface().roughness() == 0.0


def test_merge_is_the_weighted_mean_where_both_are_and_a_union_elsewhere():
    side, step = tiles.SIDE, 0.1
    knots = {"shape": (3 * side, side), "step": (step, step), "origin": (0.0, 0.0)}
    a, b = random_surface(first=(0, 0), **knots), random_surface(first=(side, 0), **knots)
    merged = a.copy()
    merged.merge(b, 3.0, 1.0)
    rng = np.random.default_rng(1)
    y = rng.uniform(4 * step, (side - 1) * step, 100)
    both = np.column_stack((rng.uniform((side + 4) * step, 3 * side * step, 100), y))
    only_a = np.column_stack((rng.uniform(4 * step, side * step, 100), y))
    only_b = np.column_stack((rng.uniform((3 * side + 4) * step, 4 * side * step, 100), y))
    np.testing.assert_allclose(merged(both), 0.75 * a(both) + 0.25 * b(both), atol=1e-12)
    np.testing.assert_allclose(merged(only_a), a(only_a), atol=1e-12)
    np.testing.assert_allclose(merged(only_b), b(only_b), atol=1e-12)


def test_merge_of_surfaces_with_shifted_first_knots():
    a = Surface(0.5, dtype=np.float64)
    b = Surface(0.5, dtype=np.float64, origin=(40.0, -3.5))
    a.update([[1.0, 1.0]], 1.0)
    b.update([[42.0, 1.0]], 1.0)
    a.merge(b)
    assert a([[1.0, 1.0]])[0] == pytest.approx(1.0)
    assert a([[42.0, 1.0]])[0] == pytest.approx(1.0)
    with pytest.raises(InputError, match="knots differ"):
        a.merge(Surface(0.5, origin=(0.1, 0.0)))
    with pytest.raises(InputError, match="knots differ"):
        a.merge(Surface(0.25))


@pytest.mark.parametrize("degree", range(1, 6))
def test_fit_recovers_a_spline_from_scattered_data(degree):
    truth = random_surface(degree, origin=(0.0, 0.0), step=(0.5, 0.5), first=(0, 0), shape=(14, 12))
    points = inside_points(truth, (0, 0, 14, 12), 1500)
    fitted = Surface.fit(points, truth(points), 0.5, degree=degree)
    np.testing.assert_allclose(fitted(points), truth(points), atol=1e-8)


def test_smooth_fit_of_noisy_data_with_a_hole():
    rng = np.random.default_rng(8)
    points = rng.uniform(0, 6, (3000, 2))
    points = points[np.linalg.norm(points - 3, axis=1) > 0.8]
    truth = lambda p: np.sin(p[:, 0]) * np.cos(0.7 * p[:, 1])  # noqa: E731
    noisy = truth(points) + rng.normal(0, 0.1, len(points))
    fitted = Surface.fit(points, noisy, 0.3, smoothness=0.05)
    probe = np.stack(np.meshgrid(*(np.linspace(0.5, 5.5, 30),) * 2), axis=-1).reshape(-1, 2)
    assert np.sqrt(np.mean((fitted(probe) - truth(probe)) ** 2)) < 0.04
    with pytest.raises(InputError, match="determine"):
        Surface.fit(points, noisy, 0.15)
    rougher = Surface.fit(points, noisy, 0.3, smoothness=0.005)
    assert rougher.roughness() > fitted.roughness()


def test_conversion_from_scipy_and_refusals():
    surface = random_surface(4)
    spline = surface.to_scipy((-20, 17, 50, 62))
    back = Surface.from_scipy(spline)
    points = np.random.default_rng(0).uniform([-0.5, 6.5], [4.0, 14.0], (50, 2))
    np.testing.assert_allclose(back(points), surface(points), atol=1e-12)
    knots = np.r_[0, 0, 0, 0, 1, 2, 3, 3, 3, 3.0]
    with pytest.raises(InputError, match="evenly"):
        Surface.from_scipy(NdBSpline((knots, knots), np.zeros((6, 6)), 3))
    with pytest.raises(InputError, match="two variables"):
        Surface.from_scipy(NdBSpline((np.arange(8.0),), np.zeros(4), 3))


def test_against_fitpack():
    # An independent library and storage order: RectBivariateSpline's coefficients on its own knots.
    x = np.linspace(0, 3, 25)
    z = np.sin(x)[:, None] * np.cos(2 * x)
    fitpack = RectBivariateSpline(x, x, z)
    points = np.random.default_rng(4).uniform(0.6, 2.4, (200, 2))
    fitted = Surface.fit(
        np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2), z.ravel(), 3 / 24, smoothness=1e-12
    )
    np.testing.assert_allclose(fitted(points), fitpack.ev(*points.T), atol=2e-5)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_files_keep_every_bit(tmp_path, dtype):
    surface = Surface((0.1, 0.2), origin=(0.3, 1e4), degree=4, dtype=dtype, fill=0.25)
    surface.update(np.random.default_rng(0).uniform(-9, 9, (50, 2)), 1.3)
    surface.save(tmp_path / "map.npz")
    loaded = Surface.load(tmp_path / "map.npz")
    assert loaded.control.dtype == dtype
    assert loaded.along == surface.along
    assert loaded.across == surface.across
    box = surface.control.bounds()
    np.testing.assert_array_equal(loaded.control.block(*box), surface.control.block(*box))
    assert loaded([[1e6, 1e6]])[0] == pytest.approx(0.25)


def test_wrong_files_are_named(tmp_path):
    text = tmp_path / "notes.txt"
    text.write_text("not a spline")
    whole = tmp_path / "whole.npz"
    Surface().save(whole)
    cut = tmp_path / "cut.npz"
    cut.write_bytes(whole.read_bytes()[:300])
    array = tmp_path / "array.npy"
    np.save(array, np.zeros(3))
    for path in (text, cut, array, tmp_path / "missing.npz"):
        with pytest.raises(InputError, match=path.name):
            Surface.load(path)


@pytest.mark.parametrize("points", [np.zeros(2), np.zeros((3, 3)), np.zeros((2, 3))])
def test_shapes_are_checked(points):
    with pytest.raises(InputError, match=r"expected \(n, 2\)"):
        Surface()(points)
    with pytest.raises(InputError, match="not finite"):
        Surface().update([[np.nan, 0.0]], 1.0)
    with pytest.raises(InputError, match="float32 or float64"):
        Surface(dtype=np.int32)
