"""What a planner asks of curves."""

from dataclasses import dataclass

import numpy as np

from knotwork.core.kernel import kernel
from knotwork.core.messages import F64
from knotwork.core.splines.basis import Array
from knotwork.plugins.maps.spline_curve.piece import foot, place
from knotwork.plugins.maps.spline_curve.store import DEGREE, PER_SCAN, CurveStore

_DENSE = 4  # samples in a knot interval


@dataclass(frozen=True, slots=True)
class Nearest:
    """The nearest obstacle of each of n points.

    Attributes
    ----------
    distance : shape (n,)
        Metres, negative in front of the obstacle (where it was seen from), positive behind it; inf without one.
    point : shape (n, 2)
        Where [m]; NaN without one.
    curve : shape (n,)
        Number of the curve; -1 without one.
    evidence : shape (n,)
        Of the curve there [scans].
    beside : shape (n,)
        False where the nearest place is an end of the curve and the point lies beyond it.
    """

    distance: F64
    point: F64
    curve: F64
    evidence: F64
    beside: F64


class Nearby:
    """Answers for the curves of a level as they are now.

    Parameters
    ----------
    store
        The level.
    """

    def __init__(self, store: CurveStore) -> None:
        from scipy.spatial import cKDTree

        self._store = store
        total = int((store.table[:, 1] - DEGREE).sum()) * _DENSE + len(store)
        self._samples = np.empty((total, 4))
        sample_all(store.control, store.table, _DENSE, self._samples)
        self._tree = cKDTree(self._samples[:, :2]) if total else None

    def nearest(self, points: F64, reach: float = np.inf) -> Nearest:
        """Return the nearest obstacle of map points (n, 2), none farther than `reach` [m]."""
        n = len(points)
        out = np.empty((n, 6))
        if self._tree is None or not n:
            index = np.full(n, len(self._samples))
        else:
            _, index = self._tree.query(points, distance_upper_bound=reach + self._store.step)
        fill_nearest(
            self._store.control, self._store.weight, self._store.table, self._samples,
            np.ascontiguousarray(points, np.float64), np.asarray(index, np.int64), reach, out,
        )  # fmt: skip
        return Nearest(out[:, 0], out[:, 1:3], out[:, 3], out[:, 4], out[:, 5])


def outlines(store: CurveStore) -> list[F64]:
    """Return the curves as polylines (n, 2) [m], a point each quarter of a knot interval."""
    samples = np.empty((int((store.table[:, 1] - DEGREE).sum()) * _DENSE + len(store), 4))
    sample_all(store.control, store.table, _DENSE, samples)
    cuts = np.cumsum((store.table[:, 1] - DEGREE) * _DENSE + 1)[:-1]
    return [part[:, :2].copy() for part in np.split(samples, cuts)] if len(store) else []


def hulls(store: CurveStore) -> list[F64]:
    """Return for each knot interval of each curve a convex polygon (k, 2) [m] that holds it, counter-clockwise.

    It is the hull of the control points that act there; two points where they lie on a line.
    """
    out = []
    for start, count, _ in store.table.tolist():
        for i in range(start, start + count - DEGREE):
            out.append(convex(store.control[i : i + DEGREE + 1].astype(np.float64)))
    return out


def convex(points: F64) -> F64:
    """Return the convex hull (k, 2) of points (n, 2), counter-clockwise (monotone chain)."""
    rows = sorted(set(map(tuple, points.tolist())))
    if len(rows) < 3:
        return np.array(rows)
    chains = []
    for ordered in (rows, rows[::-1]):
        chain: list[tuple[float, ...]] = []
        for p in ordered:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2], chain[-1]
                if (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax) > 0.0:
                    break
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


@kernel
def sample_all(control: Array, table: Array, dense: int, samples: Array) -> None:
    """Fill samples (x, y, curve, parameter) of all curves, `dense` in a knot interval."""
    used = 0
    for curve in range(table.shape[0]):
        start, count, first = int(table[curve, 0]), int(table[curve, 1]), int(table[curve, 2])
        for k in range(dense * (count - 3) + 1):
            q = first + 3.0 + k / dense
            samples[used, 0], samples[used, 1], _, _, _, _ = place(control, start, count, first, q)
            samples[used, 2] = curve
            samples[used, 3] = q
            used += 1


@kernel
def fill_nearest(
    control: Array, weight: Array, table: Array, samples: Array, points: Array, index: Array, reach: float, out: Array
) -> None:
    """Fill signed distance, x, y, curve, evidence, beside for each point, starting from its nearest sample."""
    for k in range(points.shape[0]):
        out[k, 0] = np.inf
        out[k, 1] = np.nan
        out[k, 2] = np.nan
        out[k, 3] = -1.0
        out[k, 4] = 0.0
        out[k, 5] = 0.0
        if index[k] >= samples.shape[0]:
            continue
        curve = int(samples[index[k], 2])
        start, count, first = int(table[curve, 0]), int(table[curve, 1]), int(table[curve, 2])
        q, signed, beyond = foot(control, start, count, first, samples[index[k], 3], points[k, 0], points[k, 1])
        x, y, _, _, _, _ = place(control, start, count, first, q)
        distance = np.hypot(points[k, 0] - x, points[k, 1] - y)
        if distance > reach:
            continue
        out[k, 0] = distance if signed > 0.0 else -distance
        out[k, 1] = x
        out[k, 2] = y
        out[k, 3] = curve
        middle = min(max(round(q - first - 2.0), 0), count - 1)
        out[k, 4] = weight[start + middle] / PER_SCAN
        out[k, 5] = 1.0 if beyond == 0.0 else 0.0
