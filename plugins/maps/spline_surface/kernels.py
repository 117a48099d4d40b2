"""Loops over the beams of a scan against one level: cost, normal equations, update.

A level is a cubic B-spline surface with the knot interval `step` [m] and first knots at the origin; its
control points come as `TiledArray.arrays()`. They, `clamp`, `hit` and `free` are whole or real numbers of one
unit of log-odds. Residual of a beam that ends at tau: r = (1 - s(tau) / clamp) / sigma, its Jacobian with
respect to the robot's pose (7.21), mended. `weight` is the effective-beam factor.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.beams import across
from knotwork.core.kernel import inlined, kernel
from knotwork.core.robust import CAUCHY, loss_terms
from knotwork.core.splines.basis import locate
from knotwork.core.splines.patch import cubic_add, cubic_norm, cubic_value, cubic_value_gradient
from knotwork.core.splines.tiles import claim_patch, in_one_tile, slot_of

Array = NDArray[Any]

_LARGE = 1e200
_KNOWN = 1.25e-4  # of clamp: nothing has been said of a place whose value is nearer to zero
# Two steps of an even spread in the square (R2 sequence, after the plastic number): by beam and by sample.
_BY_BEAM = 0.7548776662466927
_BY_SAMPLE = 0.5698402909980532


@kernel
def normal_equations(
    pool: Array, directory: Array, oi: int, oj: int, step: float, points: Array, pose: Array,
    clamp: float, sigma: float, weight: float, loss: int, scale: float, out: Array,
) -> tuple[float, int]:  # fmt: skip
    """Fill `out` (4, 3): rows of H, then g; return cost and number of beams that met the map."""
    x, y = pose[0], pose[1]
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    per_sigma = 1.0 / sigma
    per_value = per_sigma / clamp
    slope = -per_value / step
    known = _KNOWN * clamp
    h00 = h01 = h02 = h11 = h12 = h22 = g0 = g1 = g2 = cost = 0.0
    used = 0
    product = 1.0
    per_scale2 = 1.0 / (scale * scale)
    for k in range(points.shape[0]):
        rx = c * points[k, 0] - s * points[k, 1]
        ry = s * points[k, 0] + c * points[k, 1]
        mx, tx = locate(x + rx, 0.0, step)
        my, ty = locate(y + ry, 0.0, step)
        value, gx, gy = cubic_value_gradient(pool, directory, oi, oj, mx - 3, my - 3, tx, ty)
        r = per_sigma - value * per_value
        if loss == CAUCHY:  # one logarithm of a product instead of one a beam
            ratio = 1.0 + r * r * per_scale2
            product *= ratio
            w = 1.0 / ratio
            if product > _LARGE:
                cost += math.log(product)
                product = 1.0
        else:
            rho, w = loss_terms(loss, r * r, scale)
            cost += rho
        if abs(value) > known:
            used += 1
        gx, gy = across(points, k, c, s, gx, gy)
        jx = gx * slope
        jy = gy * slope
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
    if loss == CAUCHY:
        cost = scale * scale * (cost + math.log(product))
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
    pool: Array, directory: Array, oi: int, oj: int, step: float, points: Array, poses: Array,
    clamp: float, sigma: float, weight: float, loss: int, scale: float,
) -> Array:  # fmt: skip
    """Return the cost at each pose (k, 3)."""
    per_sigma = 1.0 / sigma
    per_value = per_sigma / clamp
    per_scale2 = 1.0 / (scale * scale)
    out = np.empty(poses.shape[0])
    for p in range(poses.shape[0]):
        x, y = poses[p, 0], poses[p, 1]
        c = math.cos(poses[p, 2])
        s = math.sin(poses[p, 2])
        cost = 0.0
        product = 1.0
        for k in range(points.shape[0]):
            mx, tx = locate(x + c * points[k, 0] - s * points[k, 1], 0.0, step)
            my, ty = locate(y + s * points[k, 0] + c * points[k, 1], 0.0, step)
            r = per_sigma - cubic_value(pool, directory, oi, oj, mx - 3, my - 3, tx, ty) * per_value
            if loss == CAUCHY:
                product *= 1.0 + r * r * per_scale2
                if product > _LARGE:
                    cost += math.log(product)
                    product = 1.0
            else:
                cost += loss_terms(loss, r * r, scale)[0]
        if loss == CAUCHY:
            cost = scale * scale * (cost + math.log(product))
        out[p] = weight * cost
    return out


@kernel
def jacobian(
    pool: Array, directory: Array, oi: int, oj: int, step: float, points: Array, pose: Array,
    clamp: float, sigma: float, weight: float, residuals: Array, rows: Array,
) -> None:  # fmt: skip
    """Fill whitened residuals (n,) and their Jacobian (n, 3)."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    factor = math.sqrt(weight) / sigma
    for k in range(points.shape[0]):
        rx = c * points[k, 0] - s * points[k, 1]
        ry = s * points[k, 0] + c * points[k, 1]
        mx, tx = locate(pose[0] + rx, 0.0, step)
        my, ty = locate(pose[1] + ry, 0.0, step)
        value, gx, gy = cubic_value_gradient(pool, directory, oi, oj, mx - 3, my - 3, tx, ty)
        gx, gy = across(points, k, c, s, gx, gy)
        jx = -gx * factor / (clamp * step)
        jy = -gy * factor / (clamp * step)
        residuals[k] = factor * (1.0 - value / clamp)
        rows[k, 0] = jx
        rows[k, 1] = jy
        rows[k, 2] = rx * jy - ry * jx


@kernel
def explained(
    pool: Array, directory: Array, oi: int, oj: int, step: float, points: Array, pose: Array, threshold: float
) -> int:
    """Return how many points lie where the surface is above `threshold`."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    count = 0
    for k in range(points.shape[0]):
        mx, tx = locate(pose[0] + c * points[k, 0] - s * points[k, 1], 0.0, step)
        my, ty = locate(pose[1] + s * points[k, 0] + c * points[k, 1], 0.0, step)
        if cubic_value(pool, directory, oi, oj, mx - 3, my - 3, tx, ty) > threshold:
            count += 1
    return count


@inlined
def _missing(directory: Array, oi: int, oj: int, i: int, j: int) -> bool:
    """Return whether the 4 x 4 patch at (i, j) touches a tile that nobody has claimed."""
    if in_one_tile(i, j, 4):
        return slot_of(directory, oi, oj, i, j) == 0
    return (
        slot_of(directory, oi, oj, i, j) == 0
        or slot_of(directory, oi, oj, i, j + 3) == 0
        or slot_of(directory, oi, oj, i + 3, j) == 0
        or slot_of(directory, oi, oj, i + 3, j + 3) == 0
    )


@kernel
def fuse(
    pool: Array, directory: Array, oi: int, oj: int, step: float, rays: Array, pose: Array,
    hit: float, free: float, clamp: float, nearest: float, free_step: float, margin: float, no_return: float,
    dither: float, first: int, sample: int, used: int,
) -> tuple[int, int, int]:  # fmt: skip
    """Fuse rays: first what is free along all of them, then where they ended.

    Changes are rounded to whole units up or down, see `cubic_add`; another `dither` for each scan.

    The directory covers them all. Tiles are claimed from the pool's reserve; when it runs out, the return
    value `(first, sample, used)` says where to go on; done when `first` is 2 k.
    """
    k = rays.shape[0]
    capacity = pool.shape[0]
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    for number in range(first, 2 * k):
        row = number if number < k else number - k
        ended = rays[row, 5] > 0.0
        ox = pose[0] + c * rays[row, 0] - s * rays[row, 1]
        oy = pose[1] + s * rays[row, 0] + c * rays[row, 1]
        ux = c * rays[row, 2] - s * rays[row, 3]
        uy = s * rays[row, 2] + c * rays[row, 3]
        length = rays[row, 4]
        if number < k:
            limit = length - margin if ended else min(length, no_return)
            samples = int((limit - nearest) / free_step) + 1 if limit >= nearest else 0
            for n in range(sample, samples):
                d = nearest + n * free_step
                mx, tx = locate(ox + d * ux, 0.0, step)
                my, ty = locate(oy + d * uy, 0.0, step)
                if _missing(directory, oi, oj, mx - 3, my - 3):
                    used = claim_patch(directory, oi, oj, mx - 3, my - 3, 4, used)
                    if used > capacity:
                        return number, n, used
                amount = -free / cubic_norm(tx, ty)
                share = dither + number * _BY_BEAM + n * _BY_SAMPLE
                cubic_add(pool, directory, oi, oj, mx - 3, my - 3, tx, ty, amount, -clamp, clamp, share)
            sample = 0
        elif ended:
            mx, tx = locate(ox + length * ux, 0.0, step)
            my, ty = locate(oy + length * uy, 0.0, step)
            used = claim_patch(directory, oi, oj, mx - 3, my - 3, 4, used)
            if used > capacity:
                return number, 0, used
            room = clamp - cubic_value(pool, directory, oi, oj, mx - 3, my - 3, tx, ty)
            if room > 0.0:  # a wall that is certain does not get thicker
                amount = min(hit, room) / cubic_norm(tx, ty)
                share = dither + number * _BY_BEAM
                cubic_add(pool, directory, oi, oj, mx - 3, my - 3, tx, ty, amount, -clamp, clamp, share)
    return 2 * k, 0, used
