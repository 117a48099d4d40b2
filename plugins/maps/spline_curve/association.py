"""Data association: which stretch of which cluster lies on which curve, and with what offset."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import kernel
from knotwork.core.messages import F64
from knotwork.plugins.maps.spline_curve.lookup import Lookup, any_nearest, candidates
from knotwork.plugins.maps.spline_curve.piece import foot, place
from knotwork.plugins.maps.spline_curve.segmentation import Clusters
from knotwork.plugins.maps.spline_curve.store import PER_SCAN, CurveStore

Array = NDArray[Any]

_LEAST = 5  # points of a run
_SKIP = 3  # points in a row that may be missing inside a run
_TURNED = 0.2  # sine of the largest angle between their normals that counts
_FORWARD = 0.5  # cosine of the largest angle between a cluster and its curve


@dataclass(frozen=True, slots=True)
class Association:
    """Runs: stretches of clusters that lie on one curve, at the pose where they were looked up.

    Attributes
    ----------
    run : int32, shape (m,)
        Of each clustered point: its run; -1 where no curve is known, -2 where a curve says that nothing is.
    feet : shape (m,)
        Parameter of the nearest curve point [knot intervals], for points of a run.
    runs : shape (r, 6)
        First point, last point + 1, curve, offset from the cluster's length to the curve's parameter
        [knot intervals], cluster, trust in the curve there in (0, 1).
    heading
        Yaw at which the normals of the beams lie on those of the curves [rad].
    """

    run: NDArray[np.int32]
    feet: F64
    runs: F64
    heading: float


def associate(
    store: CurveStore, lookup: Lookup, clusters: Clusters, pose: F64, gate: float, proven: float = 0.0
) -> Association:
    """Look up the points of `clusters`, taken at robot `pose` (3,); `gate` [m] is the largest distance.

    A curve that n scans have seen is trusted n^2 / (n^2 + proven^2).
    """
    m = len(clusters.points)
    run, feet = np.empty(m, np.int32), np.empty(m)
    runs = np.empty((m // _LEAST + 1, 6))
    count = find_runs(
        store.control, store.table, store.step, lookup.cells, lookup.x0, lookup.y0, lookup.cell, lookup.samples,
        clusters.points, clusters.chord, clusters.starts, pose, gate, run, feet, runs,
    )  # fmt: skip
    fill_trust(store.weight, store.table, run, feet, proven * PER_SCAN, runs[:count])
    heading = heading_of(store.control, store.table, clusters.points, run, feet, runs[:count], pose[2])
    return Association(run, feet, runs[:count], heading)


@kernel
def fill_trust(weight: Array, table: Array, run: Array, feet: Array, proven: float, runs: Array) -> None:
    """Fill column 5 of `runs`: the mean over its points of w^2 / (w^2 + proven^2), w the weight of their piece."""
    for j in range(runs.shape[0]):
        number = int(runs[j, 2])
        start, count, first = int(table[number, 0]), int(table[number, 1]), int(table[number, 2])
        total = 0.0
        n = 0
        for i in range(int(runs[j, 0]), int(runs[j, 1])):
            if run[i] == j:
                k = start + min(max(math.floor(feet[i]) - first, 3), count - 1)
                w = 0.25 * (float(weight[k - 3]) + weight[k - 2] + weight[k - 1] + weight[k])
                total += w * w / (w * w + proven * proven)
                n += 1
        runs[j, 5] = total / n


@kernel
def heading_of(control: Array, table: Array, points: Array, run: Array, feet: Array, runs: Array, yaw: float) -> float:
    """Return the yaw near `yaw` at which the normals of the beams lie on those of the curves, on the mean."""
    c = math.cos(yaw)
    s = math.sin(yaw)
    cosine = sine = 0.0
    for i in range(points.shape[0]):
        if run[i] < 0 or (points[i, 4] == 0.0 and points[i, 5] == 0.0):
            continue
        number = int(runs[run[i], 2])
        _, _, dx, dy, _, _ = place(
            control, int(table[number, 0]), int(table[number, 1]), int(table[number, 2]), feet[i]
        )
        nx = c * points[i, 4] - s * points[i, 5]
        ny = s * points[i, 4] + c * points[i, 5]
        size = math.hypot(dx, dy) + 1e-12
        aligned = (nx * dy - ny * dx) / size
        turned = (nx * dx + ny * dy) / size
        if abs(turned) < _TURNED:
            cosine += abs(aligned)
            sine += turned if aligned < 0.0 else -turned
    return yaw + math.atan2(sine, cosine) if cosine > 0.0 else yaw


@kernel
def find_runs(
    control: Array, table: Array, step: float, cells: Array, x0: float, y0: float, cell: float, samples: Array,
    points: Array, chord: Array, starts: Array, pose: Array, gate: float, run: Array, feet: Array, runs: Array,
) -> int:  # fmt: skip
    """Fill `run`, `feet`, `runs`; return the number of runs."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    m = points.shape[0]
    curve = np.empty(m, np.int64)
    for i in range(m):
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        tx = c * points[i, 2] - s * points[i, 3]
        ty = s * points[i, 2] + c * points[i, 3]
        found = -1
        nearest = math.inf
        for sample in candidates(cells, x0, y0, cell, x, y, tx, ty):
            if sample < 0:
                continue
            number = int(samples[sample, 2])
            start, count, first = int(table[number, 0]), int(table[number, 1]), int(table[number, 2])
            q, signed, beyond = foot(control, start, count, first, samples[sample, 3], x, y)
            distance = abs(signed)
            if beyond > 0.25 * step or distance >= nearest or distance > gate:
                continue
            _, _, dx, dy, _, _ = place(control, start, count, first, q)
            if dx * tx + dy * ty < _FORWARD * math.hypot(dx, dy):
                continue
            found = number
            nearest = distance
            feet[i] = q
        curve[i] = found
        run[i] = -1
        if found < 0:
            sample = any_nearest(cells, samples, x0, y0, cell, x, y)
            if sample >= 0:
                number = int(samples[sample, 2])
                start, count, first = int(table[number, 0]), int(table[number, 1]), int(table[number, 2])
                _, signed, beyond = foot(control, start, count, first, samples[sample, 3], x, y)
                if signed < -gate and beyond == 0.0:
                    run[i] = -2
    jump = 2.0 * gate / step + 1.0
    total = 0
    for k in range(starts.shape[0] - 1):
        i = starts[k]
        while i < starts[k + 1]:
            if curve[i] < 0:
                i += 1
                continue
            first_point = i
            last = i
            count = 1
            offset = feet[i] - chord[i] / step
            sum_offset = offset
            j = i + 1
            while j < starts[k + 1] and j - last <= _SKIP + 1:
                if curve[j] == curve[i]:
                    here = feet[j] - chord[j] / step
                    if abs(here - offset) > jump:
                        break
                    offset = here
                    sum_offset += here
                    count += 1
                    last = j
                elif curve[j] >= 0 and j + 1 < starts[k + 1] and curve[j + 1] == curve[j]:
                    break
                j += 1
            if count >= _LEAST:
                for n in range(first_point, last + 1):
                    if curve[n] == curve[i]:
                        run[n] = total
                runs[total, 0] = first_point
                runs[total, 1] = last + 1
                runs[total, 2] = curve[i]
                runs[total, 3] = sum_offset / count
                runs[total, 4] = k
                total += 1
            i = last + 1
    return total
