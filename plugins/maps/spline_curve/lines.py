"""The normal of what each beam hit, from the longest straight stretch around it."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import inlined, kernel
from knotwork.core.messages import F64

Array = NDArray[Any]

_REACH = (0.15, 1.0)  # m: how far the neighbours a line begins with may be, at least and at most
_STRETCH = 2.2  # and in spacings of the points there
_FLAT = 0.1  # largest ratio of the variances across and along those
_NEAR = 0.05  # m: a point this near to the line so far prolongs it
_LONG = 1.5  # m: but not one farther from the beam's own
_WIDE = 0.3  # m: a point speaks for the stretch around it, not for more than this


def line_normals(points: F64) -> F64:
    """Return a copy of `points` (n, 4) of `Beams` with normals of whole stretches of wall.

    The few neighbours within centimetres that give a normal of `Beams` leave it 0.1 rad of noise on a wall
    half a metre away, where beams are dense: as many such beams as a corridor has state more of the
    motion along it than odometry knows. Here a line goes on as long as the points lie on it, or until its
    direction is known. The point itself takes no part, so that its error is no part of its normal's.
    """
    out = points.copy()
    fill_line_normals(out)
    return out


@inlined
def _line(n: float, sx: float, sy: float, sxx: float, sxy: float, syy: float) -> tuple[float, float, float, float]:
    """Return the normal of the line through points, and the sums of squares along and across it."""
    cxx = sxx - sx * sx / n
    cxy = sxy - sx * sy / n
    cyy = syy - sy * sy / n
    d = 0.5 * (cxx - cyy)
    half = math.sqrt(d * d + cxy * cxy)
    mean = 0.5 * (cxx + cyy)
    if d > 0.0:
        nx, ny = -cxy, half + d
    else:
        nx, ny = half - d, -cxy
    size = math.hypot(nx, ny)
    if size <= 0.0:
        return 0.0, 0.0, mean + half, mean - half
    return nx / size, ny / size, mean + half, mean - half


@kernel
def fill_line_normals(points: Array) -> None:
    """Fill columns 2 and 3 of points (n, 4), in the order of the beams; (0, 0) where they lie on no line."""
    n = points.shape[0]
    gap = np.empty(n)  # to the next point
    for k in range(n):
        m = (k + 1) % n
        gap[k] = math.hypot(points[m, 0] - points[k, 0], points[m, 1] - points[k, 1])
    share = np.empty(n)
    for k in range(n):
        share[k] = 0.5 * (min(gap[k - 1], _WIDE) + min(gap[k], _WIDE)) + 1e-6
    ends = np.zeros(2, np.int64)
    for k in range(n):
        px = points[k, 0]
        py = points[k, 1]
        reach = min(max(_REACH[0], _STRETCH * min(gap[k - 1], gap[k])), _REACH[1])
        count = 0
        total = sx = sy = sxx = sxy = syy = 0.0
        for side in range(2):
            m = k
            for taken in range(n - 1):
                m = (m + 2 * side - 1) % n
                ends[side] = taken
                dx = points[m, 0] - px
                dy = points[m, 1] - py
                if dx * dx + dy * dy > reach * reach:
                    break
                w = share[m]
                count += 1
                total += w
                sx += w * dx
                sy += w * dy
                sxx += w * dx * dx
                sxy += w * dx * dy
                syy += w * dy * dy
        points[k, 2] = 0.0
        points[k, 3] = 0.0
        if count < 2 or count >= n - 1:
            continue
        _, _, along, across = _line(total + share[k], sx, sy, sxx, sxy, syy)  # with the point itself, at (0, 0)
        if not across < _FLAT * along:
            continue
        nx, ny, along, across = _line(total, sx, sy, sxx, sxy, syy)
        going = 3
        while going and count < n - 1:
            for side in range(2):
                if not going & (1 << side):
                    continue
                step = 2 * side - 1
                last = (k + step * ends[side]) % n
                m = (last + step) % n
                between = gap[last] if side else gap[m]
                dx = points[m, 0] - px
                dy = points[m, 1] - py
                off = nx * (dx - sx / total) + ny * (dy - sy / total)
                if between > _REACH[1] or abs(off) > _NEAR or dx * dx + dy * dy > _LONG * _LONG:
                    going &= ~(1 << side)
                    continue
                w = share[m]
                ends[side] += 1
                count += 1
                total += w
                sx += w * dx
                sy += w * dy
                sxx += w * dx * dx
                sxy += w * dx * dy
                syy += w * dy * dy
                nx, ny, along, across = _line(total, sx, sy, sxx, sxy, syy)
        points[k, 2] = nx
        points[k, 3] = ny
