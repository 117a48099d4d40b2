"""Removal of pieces of curves that later scans look through."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import kernel
from knotwork.core.messages import F64
from knotwork.core.splines import Curve
from knotwork.plugins.maps.spline_curve.piece import place
from knotwork.plugins.maps.spline_curve.store import DEGREE, CurveStore

Array = NDArray[Any]

_BINS = 360  # of bearing
_STEEP = 0.4  # sine of the flattest angle at which a beam's passing counts
_KEEP = 0.8  # of its evidence a control point keeps when a scan looks through it, less one scan


def remove_stale(store: CurveStore, rays: F64, pose: F64, margin: float) -> int:
    """Take evidence from pieces of curves that `rays` (k, 6) of a scan at `pose` (3,) passed; drop those without.

    Returns the number of control points dropped. A piece is passed if its middle lies more than `margin`
    [m] before the ends of all beams that point there.
    """
    if not len(store) or not len(rays):
        return 0
    ends = np.full(_BINS, np.inf)
    origin = np.empty(2)
    reach = bearings(rays, pose, ends, origin)
    numbers = store.near(origin[0] - reach, origin[1] - reach, origin[0] + reach, origin[1] + reach)
    marks = np.zeros(len(store.control), np.uint8)
    if not passed(store.control, store.table, numbers, ends, origin, margin, marks):
        return 0
    dropped = 0
    replaced: dict[int, list[Curve]] = {}
    for number in numbers.tolist():
        start, count, _ = store.table[number].tolist()
        marked = marks[start : start + count] > 0
        if not marked.any():
            continue
        curve = store.curve(number)
        curve.weights = np.where(marked, _KEEP * curve.weights - 1.0, curve.weights)
        kept = curve.weights > 0.0
        replaced[number] = spans(curve, kept)
        dropped += count - sum(len(part.control) for part in replaced[number])
    store.change(replaced, [])
    return dropped


def spans(curve: Curve, kept: NDArray[np.bool_]) -> list[Curve]:
    """Return the curves that are left of one with only the control points `kept`; too short ones are lost."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], kept.astype(np.int8), [0]))))
    out = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if end - begin > DEGREE:
            origin = curve.basis.origin + begin * curve.basis.step
            out.append(
                Curve(curve.control[begin:end], step=curve.basis.step, origin=origin, weights=curve.weights[begin:end])
            )
    return out


@kernel
def bearings(rays: Array, pose: Array, ends: Array, origin: Array) -> float:
    """Fill the shortest range of the beams around each bearing (inf: none); return the longest.

    `origin` (2,) becomes the sensor's place in the map, the mean over the scan. A beam without return says
    nothing: glass and black things give none.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    bins = ends.shape[0]
    n = rays.shape[0]
    origin[:] = 0.0
    for k in range(n):
        origin[0] += rays[k, 0] / n
        origin[1] += rays[k, 1] / n
    ox, oy = origin[0], origin[1]
    origin[0] = pose[0] + c * ox - s * oy
    origin[1] = pose[1] + s * ox + c * oy
    longest = 0.0
    seen = np.zeros(bins, np.bool_)
    least = np.full(bins, np.inf)
    for k in range(n):
        bearing = math.atan2(rays[k, 3], rays[k, 2]) + pose[2]
        b = math.floor(bearing * bins / (2.0 * math.pi)) % bins
        if rays[k, 5] > 0.0:
            seen[b] = True
            least[b] = min(least[b], rays[k, 4])
            longest = max(longest, rays[k, 4])
        else:
            least[b] = -1.0
    for b in range(bins):
        if seen[b]:
            ends[b] = min(least[b], min(least[(b - 1) % bins], least[(b + 1) % bins]))
    return longest


@kernel
def passed(
    control: Array, table: Array, numbers: Array, ends: Array, origin: Array, margin: float, marks: Array
) -> int:
    """Mark the control points of pieces that were looked through; return the number of such pieces."""
    bins = ends.shape[0]
    count = 0
    for n in range(numbers.shape[0]):
        start, size, first = int(table[numbers[n], 0]), int(table[numbers[n], 1]), int(table[numbers[n], 2])
        for j in range(3, size):
            x, y, dx, dy, _, _ = place(control, start, size, first, first + j + 0.5)
            rx = x - origin[0]
            ry = y - origin[1]
            distance = math.hypot(rx, ry)
            b = math.floor(math.atan2(ry, rx) * bins / (2.0 * math.pi)) % bins
            if not (distance + margin < ends[b]) or ends[b] == math.inf or distance < margin:
                continue
            if abs(rx * dy - ry * dx) < _STEEP * distance * math.hypot(dx, dy):
                continue
            count += 1
            marks[start + j - 2] = 1
            marks[start + j - 1] = 1
    return count
