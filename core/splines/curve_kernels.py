"""Loops over the parameters of a curve.

All take `control` (m, dim), the first knot `origin` and the knot interval `step`; `tau` is (n,) float64.
Outside [origin + degree step, origin + m step] a curve is not defined: NaN.
"""

import math

import numpy as np

from knotwork.core.kernel import inlined, kernel
from knotwork.core.splines.basis import Array, cubic, cubic_slope, fill_derivative
from knotwork.core.splines.curve_piece import plane_point


@inlined
def within(tau: float, origin: float, step: float, degree: int, m: int) -> tuple[int, float]:
    """Return (mu - degree, t); the last interval is closed, a billionth of an interval outside is forgiven."""
    quotient = (tau - origin) / step
    whole = np.floor(quotient)
    low, high = float(degree), float(m - 1)
    whole = whole if whole > low else low  # NaN too
    whole = whole if whole < high else high
    t = quotient - whole
    if not (-1e-9 <= t <= 1.0 + 1e-9):
        t = math.nan
    return int(whole) - degree, t


@kernel
def cubic_points(control: Array, origin: float, step: float, tau: Array, out: Array) -> None:
    """Write the points into `out` (n, dim); allocated by the caller, which Python does faster than Numba."""
    m, dim = control.shape
    if dim == 2:
        for k in range(tau.shape[0]):
            i, t = within(tau[k], origin, step, 3, m)
            out[k, 0], out[k, 1], _, _ = plane_point(control, i, t)
        return
    for k in range(tau.shape[0]):
        i, t = within(tau[k], origin, step, 3, m)
        b0, b1, b2, b3 = cubic(t)
        i0, i1, i2, i3 = np.uint64(i), np.uint64(i + 1), np.uint64(i + 2), np.uint64(i + 3)
        for c in range(dim):
            out[k, c] = b0 * control[i0, c] + b1 * control[i1, c] + b2 * control[i2, c] + b3 * control[i3, c]


@kernel
def cubic_slopes(control: Array, origin: float, step: float, tau: Array, out: Array, slopes: Array) -> None:
    """Write points and first derivatives into `out` and `slopes`, (n, dim) each."""
    m, dim = control.shape
    per_step = 1.0 / step
    if dim == 2:
        for k in range(tau.shape[0]):
            i, t = within(tau[k], origin, step, 3, m)
            out[k, 0], out[k, 1], dx, dy = plane_point(control, i, t)
            slopes[k, 0] = per_step * dx
            slopes[k, 1] = per_step * dy
        return
    for k in range(tau.shape[0]):
        i, t = within(tau[k], origin, step, 3, m)
        b0, b1, b2, b3 = cubic(t)
        d0, d1, d2, d3 = cubic_slope(t)
        i0, i1, i2, i3 = np.uint64(i), np.uint64(i + 1), np.uint64(i + 2), np.uint64(i + 3)
        for c in range(dim):
            p0, p1, p2, p3 = control[i0, c], control[i1, c], control[i2, c], control[i3, c]
            out[k, c] = b0 * p0 + b1 * p1 + b2 * p2 + b3 * p3
            slopes[k, c] = per_step * (d0 * p0 + d1 * p1 + d2 * p2 + d3 * p3)


@kernel
def derivatives(control: Array, origin: float, step: float, degree: int, order: int, tau: Array) -> Array:
    """Return the `order`-th derivative (n, dim), degrees 1 to 5."""
    m, dim = control.shape
    out = np.zeros((tau.shape[0], dim))
    weights = np.empty(degree + 1)
    scale = 1.0 / step**order
    for k in range(tau.shape[0]):
        i, t = within(tau[k], origin, step, degree, m)
        fill_derivative(t, degree, order, weights)
        if math.isnan(t):
            out[k, :] = math.nan
            continue
        for a in range(degree + 1):
            for c in range(dim):
                out[k, c] += scale * weights[a] * control[i + a, c]
    return out


@kernel
def add(control: Array, origin: float, step: float, degree: int, tau: Array, amounts: Array) -> None:
    """Move the curve by `amounts` (n, dim) at tau (within its domain), least change of control points (7.14)."""
    m, dim = control.shape
    weights = np.empty(degree + 1)
    for k in range(tau.shape[0]):
        i, t = within(tau[k], origin, step, degree, m)
        fill_derivative(t, degree, 0, weights)
        scale = 1.0 / np.sum(weights * weights)
        for a in range(degree + 1):
            for c in range(dim):
                control[i + a, c] += scale * weights[a] * amounts[k, c]


@kernel
def normal_bands(
    origin: float, step: float, degree: int, m: int, tau: Array, values: Array, weights: Array
) -> tuple[Array, Array]:
    """Return the normal equations of a least-squares fit: upper bands (degree + 1, m), right side (m, dim)."""
    bands = np.zeros((degree + 1, m))
    right = np.zeros((m, values.shape[1]))
    basis = np.empty(degree + 1)
    for k in range(tau.shape[0]):
        i, t = within(tau[k], origin, step, degree, m)
        fill_derivative(t, degree, 0, basis)
        for a in range(degree + 1):
            share = weights[k] * basis[a]
            for b in range(a, degree + 1):
                bands[degree - (b - a), i + b] += share * basis[b]
            for c in range(values.shape[1]):
                right[i + a, c] += share * values[k, c]
    return bands, right


_EQUAL = 1.0 + 1e-12


@kernel
def nearest(control: Array, origin: float, step: float, degree: int, points: Array) -> tuple[Array, Array]:
    """Return the parameters (n,) of the curve points nearest to `points` (n, dim), and the distances (n,).

    An interval is searched only if the box of its control points, which contains the curve (convex
    hull property), comes nearer than the best so far; inside, the best of nine samples starts Newton's
    method on the squared distance, kept between its neighbours by bisection.
    """
    m, dim = control.shape
    found = np.empty(points.shape[0])
    distance = np.empty(points.shape[0])
    w = np.empty((3, degree + 1))
    samples = 8
    for k in range(points.shape[0]):
        best, best_q = np.inf, np.nan
        for i in range(m - degree):
            bound = 0.0
            for c in range(dim):
                low, high = control[i, c], control[i, c]
                for a in range(1, degree + 1):
                    low, high = min(low, control[i + a, c]), max(high, control[i + a, c])
                gap = max(low - points[k, c], points[k, c] - high, 0.0)
                bound += gap * gap
            if bound >= best:
                continue
            local, local_t = np.inf, 0.0
            for s in range(samples + 1):
                square = _terms(control, i, degree, points[k], s / samples, w)[0]
                if square < local:
                    local, local_t = square, s / samples
            low, high = max(local_t - 1.0 / samples, 0.0), min(local_t + 1.0 / samples, 1.0)
            t = local_t
            for _ in range(60):
                square, slope, bend = _terms(control, i, degree, points[k], t, w)
                if square < local:
                    local, local_t = square, t
                if slope > 0.0:
                    high = t
                else:
                    low = t
                ahead = t - slope / bend if bend > 0.0 else low - 1.0
                t_next = ahead if low <= ahead <= high else 0.5 * (low + high)
                if abs(t_next - t) < 1e-14:
                    break
                t = t_next
            square = _terms(control, i, degree, points[k], t, w)[0]
            if square <= local * _EQUAL:  # around the minimum squares differ by rounding only: Newton knows better
                local, local_t = square, t
            if local < best:
                best, best_q = local, i + degree + local_t
        found[k] = origin + step * best_q
        distance[k] = math.sqrt(best)
    return found, distance


@kernel
def _terms(control: Array, i: int, degree: int, point: Array, t: float, w: Array) -> tuple[float, float, float]:
    """Return the squared distance and half its first two derivatives with respect to t."""
    for order in range(3):
        fill_derivative(t, degree, order, w[order])
    square, slope, bend = 0.0, 0.0, 0.0
    for c in range(control.shape[1]):
        gap, first, second = -point[c], 0.0, 0.0
        for a in range(degree + 1):
            value = control[i + a, c]
            gap += w[0, a] * value
            first += w[1, a] * value
            second += w[2, a] * value
        square += gap * gap
        slope += gap * first
        bend += first * first + gap * second
    return square, slope, bend
