"""Against SciPy: map_coordinates for order 0 and 1, cubic Hermite splines for the cubic convolution."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import map_coordinates

from knotwork.core.cells.interpolation import BICUBIC, BILINEAR, NEAREST, lookup, samples
from knotwork.core.splines import TiledArray

STEP = 0.2
FIRST = -50  # the array lies across tile borders, on both sides of zero
RNG = np.random.default_rng(5)
VALUES = RNG.integers(-127, 128, (120, 110)).astype(np.int8)


@pytest.fixture(scope="module")
def cells():
    tiled = TiledArray(np.int8)
    tiled.write_block(FIRST, FIRST, VALUES)
    return tiled


def points(n=400):
    return (RNG.uniform(4, 100, (n, 2)) + FIRST) * STEP


def indices(at):
    """Places in the array, in cells from the centre of its first."""
    return (at / STEP - 0.5 - FIRST).T


@pytest.mark.parametrize(("code", "order"), [(NEAREST, 0), (BILINEAR, 1)])
def test_nearest_and_bilinear_are_scipys(cells, code, order):
    at = points()
    found, _ = samples(*cells.arrays(), STEP, code, 0.0, at)
    assert found == pytest.approx(map_coordinates(VALUES.astype(float), indices(at), order=order), abs=1e-9)


def test_bicubic_is_a_hermite_spline_with_central_slopes_in_both_directions(cells):
    at = points(100)
    found, _ = samples(*cells.arrays(), STEP, BICUBIC, 0.0, at)

    def along(row, t):
        return CubicHermiteSpline(np.arange(1, len(row) - 1), row[1:-1], (row[2:] - row[:-2]) / 2)(t)

    for (x, y), value in zip(indices(at).T, found, strict=True):
        i, j = int(x) - 3, int(y) - 3
        block = VALUES[i : i + 9, j : j + 9].astype(float)
        assert along(np.array([along(row, y - j) for row in block]), x - i) == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize("code", [BILINEAR, BICUBIC])
def test_gradients_are_derivatives(cells, code):
    at = points()
    at = at[np.all(np.abs(indices(at) % 1) > 1e-3, axis=0)]
    _, gradient = samples(*cells.arrays(), STEP, code, 0.0, at)
    h = 1e-6
    for axis, shift in enumerate(np.eye(2) * h):
        after, before = (samples(*cells.arrays(), STEP, code, 0.0, at + s)[0] for s in (shift, -shift))
        assert gradient[:, axis] == pytest.approx((after - before) / (2 * h), rel=1e-4, abs=1e-2)


def test_the_slope_of_nearest_is_the_central_difference_of_the_neighbours(cells):
    at = points()
    _, gradient = samples(*cells.arrays(), STEP, NEAREST, 0.0, at)
    i, j = np.rint(indices(at)).astype(int)
    v = VALUES.astype(float)
    assert gradient[:, 0] == pytest.approx((v[i + 1, j] - v[i - 1, j]) / (2 * STEP))
    assert gradient[:, 1] == pytest.approx((v[i, j + 1] - v[i, j - 1]) / (2 * STEP))


def test_every_kind_gives_the_cells_at_their_centres(cells):
    i, j = RNG.integers(3, 100, (2, 50))
    centres = np.column_stack([i + FIRST + 0.5, j + FIRST + 0.5]) * STEP
    for code in (NEAREST, BILINEAR, BICUBIC):
        assert samples(*cells.arrays(), STEP, code, 0.0, centres)[0] == pytest.approx(VALUES[i, j], abs=1e-6)
    assert lookup(*cells.arrays(), STEP, centres + 0.49 * STEP) == pytest.approx(VALUES[i, j])
