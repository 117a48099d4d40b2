"""Which beams would have to pass a wall of the map to end where they do."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import kernel
from knotwork.core.messages import F64
from knotwork.plugins.maps.spline_curve.piece import place
from knotwork.plugins.maps.spline_curve.store import PER_SCAN, CurveStore

Array = NDArray[Any]

_BINS = 360  # of bearing
_STEEP = 0.4  # sine of the flattest angle at which a wall counts
_SCANS = 5  # whose evidence makes a wall


def barred(store: CurveStore, points: F64, origin: F64, pose: F64, margin: float) -> NDArray[np.bool_]:
    """Return which of robot-frame `points` (m, >= 2), seen from `origin` (2,) there, lie behind a wall: shape (m,).

    A wall is a piece of a curve that several scans have seen; a beam passes it if it ends more than
    `margin` [m] behind it, and there is a wall at the neighbouring bearings as well.
    """
    out = np.zeros(len(points), np.bool_)
    if not len(points) or not len(store):
        return out
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = pose[0] + c * origin[0] - s * origin[1], pose[1] + s * origin[0] + c * origin[1]
    reach = float(np.hypot(points[:, 0] - origin[0], points[:, 1] - origin[1]).max())
    numbers = store.near(x - reach, y - reach, x + reach, y + reach)
    walls = np.full(_BINS, np.inf)
    fill_walls(store.control, store.weight, store.table, numbers, x, y, margin, _SCANS * PER_SCAN, walls)
    fill_barred(walls, points, origin, pose[2], margin, out)
    return out


@kernel
def fill_walls(
    control: Array, weight: Array, table: Array, numbers: Array, x: float, y: float, margin: float, least: int,
    walls: Array,
) -> None:  # fmt: skip
    """Fill the distance [m] of the nearest wall at each bearing from (x, y), inf for none."""
    bins = walls.shape[0]
    for n in range(numbers.shape[0]):
        start, size, first = int(table[numbers[n], 0]), int(table[numbers[n], 1]), int(table[numbers[n], 2])
        for j in range(3, size):
            i = start + j
            if min(weight[i - 3], weight[i - 2], weight[i - 1], weight[i]) < least:
                continue
            ax, ay, _, _, _, _ = place(control, start, size, first, float(first + j))
            bx, by, _, _, _, _ = place(control, start, size, first, first + j + 1.0)
            ax -= x
            ay -= y
            bx -= x
            by -= y
            near = math.hypot(ax, ay)
            far = math.hypot(bx, by)
            chord = math.hypot(bx - ax, by - ay)
            if min(near, far) < margin or abs(ax * by - ay * bx) < _STEEP * max(near, far) * chord:
                continue
            begin = math.atan2(ay, ax)
            span = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
            low = min(begin, begin + span) * bins / (2.0 * math.pi)
            high = max(begin, begin + span) * bins / (2.0 * math.pi)
            for b in range(math.floor(low), math.floor(high) + 1):
                walls[b % bins] = min(walls[b % bins], max(near, far))


@kernel
def fill_barred(walls: Array, points: Array, origin: Array, yaw: float, margin: float, out: Array) -> None:
    """Fill which points lie behind the walls."""
    bins = walls.shape[0]
    for i in range(points.shape[0]):
        dx = points[i, 0] - origin[0]
        dy = points[i, 1] - origin[1]
        b = math.floor((math.atan2(dy, dx) + yaw) * bins / (2.0 * math.pi))
        wall = max(walls[(b - 1) % bins], walls[b % bins], walls[(b + 1) % bins])
        out[i] = wall + margin < math.hypot(dx, dy)
