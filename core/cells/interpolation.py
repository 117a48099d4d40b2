"""A function known at cell centres, in between: its value and its slopes.

Cell (i, j) has its centre at ((i + 1/2) step, (j + 1/2) step). Cells come as `TiledArray.arrays()`; values
are in stored units, slopes in stored units a cell. Cells that hold `unknown` are counted.

nearest: the cell's own value; the slopes are central differences of its neighbours, (c[i+1] - c[i-1]) / 2,
since the derivative of a step function helps nobody. bilinear: Hector SLAM's choice (Kohlbrecher et al.
2011). bicubic: cubic convolution (Keys 1981, a = -1/2), Cartographer's choice (Hess et al. 2016); both with
their exact derivatives.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.cells.config import Interpolation
from knotwork.core.kernel import inlined, kernel
from knotwork.core.splines.tiles import MASK, in_one_tile, slot_of

Array = NDArray[Any]
Four = tuple[float, float, float, float]

NEAREST, BILINEAR, BICUBIC = 0, 1, 2
CODES: dict[Interpolation, int] = {"nearest": NEAREST, "bilinear": BILINEAR, "bicubic": BICUBIC}
WIDTH = {NEAREST: 3, BILINEAR: 2, BICUBIC: 4}  # cells in a row that act at a place


@inlined
def at(pool: Array, directory: Array, oi: int, oj: int, i: int, j: int) -> float:
    """Return cell (i, j)."""
    slot = np.uint64(slot_of(directory, oi, oj, i, j))
    return float(pool[slot, np.uint64(i & MASK), np.uint64(j & MASK)])


@inlined
def _convolution(t: float) -> Four:
    """Return the weights of cells -1, 0, 1, 2 at t in [0, 1) between cells 0 and 1."""
    u = 1.0 - t
    return -0.5 * t * u * u, 1.0 + t * t * (1.5 * t - 2.5), 1.0 + u * u * (1.5 * u - 2.5), -0.5 * u * t * t


@inlined
def _convolution_slope(t: float) -> Four:
    """Return the derivatives of those weights with respect to t."""
    u = 1.0 - t
    return -0.5 * u * (1.0 - 3.0 * t), t * (4.5 * t - 5.0), -u * (4.5 * u - 5.0), 0.5 * t * (1.0 - 3.0 * u)


@inlined
def _bilinear(
    pool: Array, directory: Array, oi: int, oj: int, x: float, y: float, unknown: float
) -> tuple[float, float, float, int]:
    fi = math.floor(x)
    fj = math.floor(y)
    i = int(fi)
    j = int(fj)
    tx = x - fi
    ty = y - fj
    if in_one_tile(i, j, 2):
        slot = np.uint64(slot_of(directory, oi, oj, i, j))
        a = np.uint64(i & MASK)
        b = np.uint64(j & MASK)
        one = np.uint64(1)
        c00 = float(pool[slot, a, b])
        c01 = float(pool[slot, a, b + one])
        c10 = float(pool[slot, a + one, b])
        c11 = float(pool[slot, a + one, b + one])
    else:
        c00 = at(pool, directory, oi, oj, i, j)
        c01 = at(pool, directory, oi, oj, i, j + 1)
        c10 = at(pool, directory, oi, oj, i + 1, j)
        c11 = at(pool, directory, oi, oj, i + 1, j + 1)
    low = c00 + ty * (c01 - c00)
    high = c10 + ty * (c11 - c10)
    missing = int(c00 == unknown) + int(c01 == unknown) + int(c10 == unknown) + int(c11 == unknown)
    slope_y = (1.0 - tx) * (c01 - c00) + tx * (c11 - c10)
    return low + tx * (high - low), high - low, slope_y, missing


@inlined
def _row(
    pool: Array, directory: Array, oi: int, oj: int, i: int, j: int, whole: bool, slot: int, wy: Four, sy: Four,
    unknown: float,
) -> tuple[float, float, int]:  # fmt: skip
    """Return the weighted sums of cells (i, j) ... (i, j + 3) and how many are unknown."""
    if whole:
        k = np.uint64(slot)
        a = np.uint64(i & MASK)
        b = np.uint64(j & MASK)
        c0 = float(pool[k, a, b])
        c1 = float(pool[k, a, b + np.uint64(1)])
        c2 = float(pool[k, a, b + np.uint64(2)])
        c3 = float(pool[k, a, b + np.uint64(3)])
    else:
        c0 = at(pool, directory, oi, oj, i, j)
        c1 = at(pool, directory, oi, oj, i, j + 1)
        c2 = at(pool, directory, oi, oj, i, j + 2)
        c3 = at(pool, directory, oi, oj, i, j + 3)
    missing = int(c0 == unknown) + int(c1 == unknown) + int(c2 == unknown) + int(c3 == unknown)
    value = wy[0] * c0 + wy[1] * c1 + wy[2] * c2 + wy[3] * c3
    slope = sy[0] * c0 + sy[1] * c1 + sy[2] * c2 + sy[3] * c3
    return value, slope, missing


@inlined
def _bicubic(
    pool: Array, directory: Array, oi: int, oj: int, x: float, y: float, unknown: float
) -> tuple[float, float, float, int]:
    fi = math.floor(x)
    fj = math.floor(y)
    i = int(fi) - 1
    j = int(fj) - 1
    wx = _convolution(x - fi)
    sx = _convolution_slope(x - fi)
    wy = _convolution(y - fj)
    sy = _convolution_slope(y - fj)
    whole = in_one_tile(i, j, 4)
    slot = slot_of(directory, oi, oj, i, j)
    v0, d0, n0 = _row(pool, directory, oi, oj, i, j, whole, slot, wy, sy, unknown)
    v1, d1, n1 = _row(pool, directory, oi, oj, i + 1, j, whole, slot, wy, sy, unknown)
    v2, d2, n2 = _row(pool, directory, oi, oj, i + 2, j, whole, slot, wy, sy, unknown)
    v3, d3, n3 = _row(pool, directory, oi, oj, i + 3, j, whole, slot, wy, sy, unknown)
    return (
        wx[0] * v0 + wx[1] * v1 + wx[2] * v2 + wx[3] * v3,
        sx[0] * v0 + sx[1] * v1 + sx[2] * v2 + sx[3] * v3,
        wx[0] * d0 + wx[1] * d1 + wx[2] * d2 + wx[3] * d3,
        n0 + n1 + n2 + n3,
    )


@inlined
def _nearest(
    pool: Array, directory: Array, oi: int, oj: int, x: float, y: float, unknown: float
) -> tuple[float, float, float, int]:
    i = math.floor(x + 0.5)
    j = math.floor(y + 0.5)
    value = at(pool, directory, oi, oj, i, j)
    left, right = at(pool, directory, oi, oj, i - 1, j), at(pool, directory, oi, oj, i + 1, j)
    below, above = at(pool, directory, oi, oj, i, j - 1), at(pool, directory, oi, oj, i, j + 1)
    missing = (
        int(value == unknown)
        + int(left == unknown)
        + int(right == unknown)
        + int(below == unknown)
        + int(above == unknown)
    )
    return value, 0.5 * (right - left), 0.5 * (above - below), missing


@inlined
def sample(
    pool: Array, directory: Array, oi: int, oj: int, code: int, x: float, y: float, unknown: float
) -> tuple[float, float, float, int]:
    """Return value, slopes and how many of the cells that were read are unknown.

    `x` and `y` are in cells from the centre of cell (0, 0).
    """
    if code == BILINEAR:
        return _bilinear(pool, directory, oi, oj, x, y, unknown)
    if code == BICUBIC:
        return _bicubic(pool, directory, oi, oj, x, y, unknown)
    return _nearest(pool, directory, oi, oj, x, y, unknown)


@kernel
def samples(
    pool: Array, directory: Array, oi: int, oj: int, step: float, code: int, unknown: float, points: Array
) -> tuple[Array, Array]:
    """Return values (n,) and gradients (n, 2), a metre, at map `points` (n, 2)."""
    values = np.empty(points.shape[0])
    gradients = np.empty((points.shape[0], 2))
    for k in range(points.shape[0]):
        x = points[k, 0] / step - 0.5
        y = points[k, 1] / step - 0.5
        values[k], gx, gy, _ = sample(pool, directory, oi, oj, code, x, y, unknown)
        gradients[k, 0] = gx / step
        gradients[k, 1] = gy / step
    return values, gradients


@kernel
def lookup(pool: Array, directory: Array, oi: int, oj: int, step: float, points: Array) -> Array:
    """Return the cells (n,) in which map `points` (n, 2) lie."""
    values = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        i = math.floor(points[k, 0] / step)
        j = math.floor(points[k, 1] / step)
        values[k] = at(pool, directory, oi, oj, i, j)
    return values
