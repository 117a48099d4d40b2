"""Clusters of a scan: stretches of neighbouring beams that hit one thing (Algorithm 5, mended)."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import inlined, kernel
from knotwork.core.messages import F64

Array = NDArray[Any]

_SMALL = 0.25  # of the widest gap: narrower ones never end a cluster, their ratio is noise
_FLAT = 0.15  # sine of the angle between a gap and the lines at its ends
_TURN = 2  # points to each side that give the direction of a cluster


@dataclass(frozen=True, slots=True)
class Clusters:
    """The points of a scan that lie in clusters, cluster after cluster, counter-clockwise as the beams.

    The sensor sees a cluster on its left.

    Attributes
    ----------
    points : shape (m, 6)
        x, y [m], unit direction of the cluster and the normal of `Beams` there, in the robot's frame.
    chord : shape (m,)
        Length along the cluster from its first point [m], the noise across it left out.
    starts : int64, shape (k + 1,)
        Cluster i holds the points starts[i] to starts[i + 1].
    """

    points: F64
    chord: F64
    starts: NDArray[np.int64]


def clusters_of(points: F64, gap: float, line: float, relative: float, least: int, closed: bool) -> Clusters:
    """Return the clusters of points (n, 4) as `Beams` has them.

    Parameters
    ----------
    gap, relative
        A gap wider than `gap` [m], or wider than `relative` times the one before it, ends a cluster.
    line
        But not a gap up to this [m] whose ends lie on one line, by their normals: a wall seen from far off.
    least
        A smaller cluster is left out.
    closed
        The scan is a full turn: the last cluster may go on as the first.
    """
    n = len(points)
    order = np.empty(n, np.int64)
    starts = np.empty(n + 1, np.int64)
    k = segment(points, gap, line, relative, least, closed, order, starts)
    m = int(starts[k])
    out, chord = np.empty((m, 6)), np.empty(m)
    measure(points, order, starts[: k + 1], out, chord)
    return Clusters(out, chord, starts[: k + 1].copy())


@inlined
def _on_line(points: Array, i: int, j: int) -> bool:
    """Return whether points i and j lie on one line, by the normals of both."""
    dx = points[j, 0] - points[i, 0]
    dy = points[j, 1] - points[i, 1]
    most = _FLAT * math.hypot(dx, dy)
    known = (points[i, 2] != 0.0 or points[i, 3] != 0.0) and (points[j, 2] != 0.0 or points[j, 3] != 0.0)
    first: float = abs(points[i, 2] * dx + points[i, 3] * dy)
    second: float = abs(points[j, 2] * dx + points[j, 3] * dy)
    return known and first < most and second < most


@kernel
def segment(
    points: Array, gap: float, line: float, relative: float, least: int, closed: bool, order: Array, starts: Array
) -> int:
    """Fill `order` with indices of points and `starts`; return the number of clusters."""
    n = points.shape[0]
    begins = np.empty(n + 1, np.int64)
    count = 0
    before = 0.0
    kept = np.empty(n, np.int64)  # without repeated points
    m = 0
    for i in range(n):
        d = 0.0
        if m > 0:
            last = kept[m - 1]
            d = math.hypot(points[i, 0] - points[last, 0], points[i, 1] - points[last, 1])
            if d < 1e-6:
                continue
        wide = d > gap or (before > 0.0 and d > relative * before and d > _SMALL * gap)
        if m == 0 or (wide and not (d <= line and _on_line(points, kept[m - 1], i))):
            begins[count] = m
            count += 1
            before = 0.0
        else:
            before = d
        kept[m] = i
        m += 1
    begins[count] = m
    first = 0
    wrapped = False
    if closed and count > 1:
        a, b = kept[m - 1], kept[0]
        d = math.hypot(points[b, 0] - points[a, 0], points[b, 1] - points[a, 1])
        wrapped = 1e-6 < d <= gap
        first = 1 if wrapped else 0
    out = 0
    clusters = 0
    starts[0] = 0
    for c in range(first, count):
        size = begins[c + 1] - begins[c]
        joined = wrapped and c == count - 1
        if size + (begins[1] if joined else 0) < least:
            continue
        for i in range(begins[c], begins[c + 1]):
            order[out] = kept[i]
            out += 1
        if joined:
            for i in range(begins[1]):
                order[out] = kept[i]
                out += 1
        clusters += 1
        starts[clusters] = out
    return clusters


@kernel
def measure(points: Array, order: Array, starts: Array, out: Array, chord: Array) -> None:
    """Fill points with directions and normals (m, 6) and chord lengths (m,).

    A chord is measured along the direction of the points around it: of noisy points the sum of plain
    distances is too long, by more the denser they lie.
    """
    for c in range(starts.shape[0] - 1):
        low, high = starts[c], starts[c + 1]
        for i in range(low, high):
            a = max(low, i - _TURN)
            b = min(high - 1, i + _TURN)
            dx = points[order[b], 0] - points[order[a], 0]
            dy = points[order[b], 1] - points[order[a], 1]
            size = math.hypot(dx, dy)
            out[i, 0] = points[order[i], 0]
            out[i, 1] = points[order[i], 1]
            out[i, 2] = dx / size if size > 0.0 else 1.0
            out[i, 3] = dy / size if size > 0.0 else 0.0
            out[i, 4] = points[order[i], 2]
            out[i, 5] = points[order[i], 3]
        chord[low] = 0.0
        for i in range(low + 1, high):
            tx = out[i - 1, 2] + out[i, 2]
            ty = out[i - 1, 3] + out[i, 3]
            size = math.hypot(tx, ty)
            along = 0.0
            if size > 1e-9:
                along = ((out[i, 0] - out[i - 1, 0]) * tx + (out[i, 1] - out[i - 1, 1]) * ty) / size
            chord[i] = chord[i - 1] + max(along, 1e-6)
