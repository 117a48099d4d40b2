"""Loops over points of a tiled surface. Cubic loops are fused; the others serve degrees 1 to 5.

All take the tiled control points (`TiledArray.arrays`), the first knots (ox, oy) and the knot intervals
(sx, sy) [m]; `points` is (n, 2) float64 [m].
"""

import numpy as np

from knotwork.core.kernel import kernel
from knotwork.core.splines.basis import Array, fill_derivative, locate
from knotwork.core.splines.patch import cubic_add, cubic_norm, cubic_value, cubic_value_gradient
from knotwork.core.splines.tiles import MASK, slot_of


@kernel
def cubic_values(
    pool: Array, directory: Array, oi: int, oj: int, ox: float, oy: float, sx: float, sy: float, points: Array
) -> Array:
    """Return the values (n,)."""
    n = points.shape[0]
    values = np.empty(n)
    for k in range(n):
        mx, tx = locate(points[k, 0], ox, sx)
        my, ty = locate(points[k, 1], oy, sy)
        values[k] = cubic_value(pool, directory, oi, oj, mx - 3, my - 3, tx, ty)
    return values


@kernel
def cubic_at(
    pool: Array, directory: Array, oi: int, oj: int, ox: float, oy: float, sx: float, sy: float, x: float, y: float
) -> tuple[float, float, float]:
    """Return value and partial derivatives at one point."""
    mx, tx = locate(x, ox, sx)
    my, ty = locate(y, oy, sy)
    value, gx, gy = cubic_value_gradient(pool, directory, oi, oj, mx - 3, my - 3, tx, ty)
    return value, gx / sx, gy / sy


@kernel
def cubic_update(
    pool: Array, directory: Array, oi: int, oj: int, ox: float, oy: float, sx: float, sy: float,
    points: Array, amounts: Array, low: float, high: float,
) -> None:  # fmt: skip
    """Raise the surface by `amounts` (n,) at claimed points, (7.14), control points kept in [low, high]."""
    for k in range(points.shape[0]):
        mx, tx = locate(points[k, 0], ox, sx)
        my, ty = locate(points[k, 1], oy, sy)
        amount = amounts[k] / cubic_norm(tx, ty)
        cubic_add(pool, directory, oi, oj, mx - 3, my - 3, tx, ty, amount, low, high, 0.0)


@kernel
def jets(
    pool: Array, directory: Array, oi: int, oj: int, ox: float, oy: float, sx: float, sy: float,
    degree: int, order: int, points: Array,
) -> Array:  # fmt: skip
    """Return all partial derivatives up to `order`: (n, 1), (n, 3) or (n, 6): s, s_x, s_y, s_xx, s_xy, s_yy."""
    n = points.shape[0]
    width = degree + 1
    out = np.empty((n, (order + 1) * (order + 2) // 2))
    along = np.empty((order + 1, width))
    across = np.empty((order + 1, width))
    row = np.empty(order + 1)
    sums = np.empty((order + 1, order + 1))
    for k in range(n):
        mx, tx = locate(points[k, 0], ox, sx)
        my, ty = locate(points[k, 1], oy, sy)
        for p in range(order + 1):
            fill_derivative(tx, degree, p, along[p])
            fill_derivative(ty, degree, p, across[p])
        sums[:] = 0.0
        for a in range(width):
            i = mx - degree + a
            row[:] = 0.0
            for b in range(width):
                j = my - degree + b
                point = np.float64(
                    pool[np.uint64(slot_of(directory, oi, oj, i, j)), np.uint64(i & MASK), np.uint64(j & MASK)]
                )
                for q in range(order + 1):
                    row[q] += across[q, b] * point
            for p in range(order + 1):
                for q in range(order + 1 - p):
                    sums[p, q] += along[p, a] * row[q]
        column = 0
        for total in range(order + 1):
            for q in range(total + 1):
                p = total - q
                out[k, column] = sums[p, q] / (sx**p * sy**q)
                column += 1
    return out


@kernel
def update(
    pool: Array, directory: Array, oi: int, oj: int, ox: float, oy: float, sx: float, sy: float,
    degree: int, points: Array, amounts: Array, low: float, high: float,
) -> None:  # fmt: skip
    """Do as `cubic_update` for any degree."""
    width = degree + 1
    along = np.empty(width)
    across = np.empty(width)
    for k in range(points.shape[0]):
        mx, tx = locate(points[k, 0], ox, sx)
        my, ty = locate(points[k, 1], oy, sy)
        fill_derivative(tx, degree, 0, along)
        fill_derivative(ty, degree, 0, across)
        amount = amounts[k] / (np.sum(along * along) * np.sum(across * across))
        for a in range(width):
            i = mx - degree + a
            for b in range(width):
                j = my - degree + b
                slot = np.uint64(slot_of(directory, oi, oj, i, j))
                r, c = np.uint64(i & MASK), np.uint64(j & MASK)
                pool[slot, r, c] = min(max(pool[slot, r, c] + amount * along[a] * across[b], low), high)


@kernel
def patches(ox: float, oy: float, sx: float, sy: float, degree: int, points: Array) -> Array:
    """Return the first control point (n, 2) int64 that acts at each point."""
    first = np.empty((points.shape[0], 2), np.int64)
    for k in range(points.shape[0]):
        first[k, 0] = locate(points[k, 0], ox, sx)[0] - degree
        first[k, 1] = locate(points[k, 1], oy, sy)[0] - degree
    return first
