"""Loops over the beams of a scan against one level of cells: cost, normal equations, residuals.

The whitened residual of a beam that ends at a place is affine in what the map holds there: r = offset +
gain * value. Where the map says nothing it is `beyond`, with no slope: in a `strict` map if any of the
cells that act there is `unknown`, in any other map an unknown cell is a value like others (0 log-odds).
`weight` is the effective-beam factor.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.beams import across
from knotwork.core.cells.interpolation import BICUBIC, BILINEAR, at, sample
from knotwork.core.kernel import inlined, kernel
from knotwork.core.robust import loss_terms

Array = NDArray[Any]


@inlined
def _residual(
    pool: Array, directory: Array, oi: int, oj: int, per_step: float, code: int, unknown: float, strict: bool,
    gain: float, offset: float, beyond: float, x: float, y: float,
) -> tuple[float, float, float, bool]:  # fmt: skip
    """Return the residual at (x, y) [m], its slopes [1/m] and whether the map says something there."""
    value, gx, gy, missing = sample(pool, directory, oi, oj, code, x * per_step - 0.5, y * per_step - 0.5, unknown)
    if strict:
        if missing > 0:
            return beyond, 0.0, 0.0, False
        known = True
    elif code == BILINEAR:
        known = missing < 4
    elif code == BICUBIC:
        known = missing < 16
    else:
        known = missing < 5
    slope = gain * per_step
    return offset + gain * value, slope * gx, slope * gy, known


@kernel
def normal_equations(
    pool: Array, directory: Array, oi: int, oj: int, step: float, code: int, unknown: float, strict: bool,
    gain: float, offset: float, beyond: float, points: Array, pose: Array, weight: float, loss: int, scale: float,
    out: Array,
) -> tuple[float, int]:  # fmt: skip
    """Fill `out` (4, 3): rows of H, then g; return cost and number of beams that met the map."""
    x, y = pose[0], pose[1]
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    per_step = 1.0 / step
    h00 = h01 = h02 = h11 = h12 = h22 = g0 = g1 = g2 = cost = 0.0
    used = 0
    for k in range(points.shape[0]):
        rx = c * points[k, 0] - s * points[k, 1]
        ry = s * points[k, 0] + c * points[k, 1]
        r, jx, jy, known = _residual(
            pool, directory, oi, oj, per_step, code, unknown, strict, gain, offset, beyond, x + rx, y + ry
        )
        rho, w = loss_terms(loss, r * r, scale)
        cost += rho
        if known:
            used += 1
        jx, jy = across(points, k, c, s, jx, jy)
        ja = rx * jy - ry * jx
        wx = w * jx
        wy = w * jy
        wa = w * ja
        h00 += wx * jx
        h01 += wx * jy
        h02 += wx * ja
        h11 += wy * jy
        h12 += wy * ja
        h22 += wa * ja
        g0 += wx * r
        g1 += wy * r
        g2 += wa * r
    out[0, 0] = weight * h00
    out[0, 1] = out[1, 0] = weight * h01
    out[0, 2] = out[2, 0] = weight * h02
    out[1, 1] = weight * h11
    out[1, 2] = out[2, 1] = weight * h12
    out[2, 2] = weight * h22
    out[3, 0] = weight * g0
    out[3, 1] = weight * g1
    out[3, 2] = weight * g2
    return weight * cost, used


@kernel
def costs(
    pool: Array, directory: Array, oi: int, oj: int, step: float, code: int, unknown: float, strict: bool,
    gain: float, offset: float, beyond: float, points: Array, poses: Array, weight: float, loss: int, scale: float,
) -> Array:  # fmt: skip
    """Return the cost at each pose (k, 3)."""
    per_step = 1.0 / step
    out = np.empty(poses.shape[0])
    for p in range(poses.shape[0]):
        c = math.cos(poses[p, 2])
        s = math.sin(poses[p, 2])
        cost = 0.0
        for k in range(points.shape[0]):
            x = poses[p, 0] + c * points[k, 0] - s * points[k, 1]
            y = poses[p, 1] + s * points[k, 0] + c * points[k, 1]
            r, _, _, _ = _residual(pool, directory, oi, oj, per_step, code, unknown, strict, gain, offset, beyond, x, y)
            cost += loss_terms(loss, r * r, scale)[0]
        out[p] = weight * cost
    return out


@kernel
def jacobian(
    pool: Array, directory: Array, oi: int, oj: int, step: float, code: int, unknown: float, strict: bool,
    gain: float, offset: float, beyond: float, points: Array, pose: Array, weight: float, residuals: Array, rows: Array,
) -> None:  # fmt: skip
    """Fill whitened residuals (n,) and their Jacobian (n, 3)."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    root = math.sqrt(weight)
    for k in range(points.shape[0]):
        rx = c * points[k, 0] - s * points[k, 1]
        ry = s * points[k, 0] + c * points[k, 1]
        r, jx, jy, _ = _residual(
            pool, directory, oi, oj, 1.0 / step, code, unknown, strict, gain, offset, beyond, pose[0] + rx, pose[1] + ry
        )
        jx, jy = across(points, k, c, s, root * jx, root * jy)
        residuals[k] = root * r
        rows[k, 0] = jx
        rows[k, 1] = jy
        rows[k, 2] = rx * jy - ry * jx


@kernel
def explained(
    pool: Array, directory: Array, oi: int, oj: int, step: float, unknown: float, strict: bool, points: Array,
    pose: Array, low: float, high: float,
) -> int:  # fmt: skip
    """Return how many points lie where the map is within [low, high].

    A strict map is interpolated bilinearly. In another the highest of the four cells around counts: what is
    next to a wall that was seen once is not less of a wall for lying between two cells.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    count = 0
    for k in range(points.shape[0]):
        x = (pose[0] + c * points[k, 0] - s * points[k, 1]) / step - 0.5
        y = (pose[1] + s * points[k, 0] + c * points[k, 1]) / step - 0.5
        if strict:
            value, _, _, missing = sample(pool, directory, oi, oj, BILINEAR, x, y, unknown)
            if missing > 0:
                continue
        else:
            i = math.floor(x)
            j = math.floor(y)
            value = max(
                at(pool, directory, oi, oj, i, j), at(pool, directory, oi, oj, i, j + 1),
                at(pool, directory, oi, oj, i + 1, j), at(pool, directory, oi, oj, i + 1, j + 1),
            )  # fmt: skip
        if low <= value <= high:
            count += 1
    return count
