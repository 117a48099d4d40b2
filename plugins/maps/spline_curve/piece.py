"""One place on one of many packed curves.

Parameters q are in knot intervals: control point k of a curve whose first knot is `first` acts on
[first + k, first + k + 4), the curve lives on [first + 3, first + count]. Beyond, it goes on straight.
"""

import math
from typing import Any

from numpy.typing import NDArray

from knotwork.core.kernel import inlined
from knotwork.core.splines.basis import cubic, cubic_bend, cubic_slope

Array = NDArray[Any]
Point = tuple[float, float, float, float, float, float]


@inlined
def place(control: Array, start: int, count: int, first: int, q: float) -> Point:
    """Return x, y and their first and second derivatives with respect to q."""
    u = q - first
    beyond = 0.0
    if u < 3.0:
        beyond = u - 3.0
        u = 3.0
    elif u > count:
        beyond = u - count
        u = float(count)
    j = math.floor(u)
    if j > count - 1:
        j = count - 1
    t = u - j
    i = start + j - 3
    a0, a1, a2, a3 = cubic(t)
    b0, b1, b2, b3 = cubic_slope(t)
    x0, x1, x2, x3 = control[i, 0], control[i + 1, 0], control[i + 2, 0], control[i + 3, 0]
    y0, y1, y2, y3 = control[i, 1], control[i + 1, 1], control[i + 2, 1], control[i + 3, 1]
    x = a0 * x0 + a1 * x1 + a2 * x2 + a3 * x3
    y = a0 * y0 + a1 * y1 + a2 * y2 + a3 * y3
    dx = b0 * x0 + b1 * x1 + b2 * x2 + b3 * x3
    dy = b0 * y0 + b1 * y1 + b2 * y2 + b3 * y3
    if beyond != 0.0:
        return x + beyond * dx, y + beyond * dy, dx, dy, 0.0, 0.0
    c0, c1, c2, c3 = cubic_bend(t)
    return x, y, dx, dy, c0 * x0 + c1 * x1 + c2 * x2 + c3 * x3, c0 * y0 + c1 * y1 + c2 * y2 + c3 * y3


@inlined
def foot(
    control: Array, start: int, count: int, first: int, q: float, px: float, py: float
) -> tuple[float, float, float]:
    """Return the parameter near `q` of the curve point nearest to (px, py), its signed distance, and what is beyond.

    The distance is positive on the right of the curve, behind what was seen. `beyond` says how far the
    point lies past an end of the curve, along it [m]; 0 beside the curve.
    """
    low = first + 3.0
    high = float(first + count)
    for _ in range(4):
        x, y, dx, dy, _, _ = place(control, start, count, first, q)
        q += min(max(((px - x) * dx + (py - y) * dy) / (dx * dx + dy * dy + 1e-12), -1.0), 1.0)
        q = min(max(q, low), high)
    x, y, dx, dy, _, _ = place(control, start, count, first, q)
    speed = math.hypot(dx, dy) + 1e-12
    along = ((px - x) * dx + (py - y) * dy) / speed
    across = ((px - x) * dy - (py - y) * dx) / speed
    if (q <= low and along < 0.0) or (q >= high and along > 0.0):
        return q, across, abs(along)
    distance = math.hypot(px - x, py - y)
    return q, distance if across > 0.0 else -distance, 0.0
