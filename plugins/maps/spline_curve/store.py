"""The curves of one level, packed: 9 bytes a control point and 12 a curve; and their spatial index."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.splines import Curve, UniformBasis
from knotwork.plugins.maps.spline_curve.index import BoxIndex

PER_SCAN = 5  # stored units of weight that one scan gives
DEGREE = 3


class CurveStore:
    """Cubic curves with knots at whole multiples of `step`.

    A curve's parameter is its length along the obstacle [m], roughly; the robot saw it on its left.

    Attributes
    ----------
    control : float32, shape (n, 2)
        Control points of all curves [m].
    weight : uint8, shape (n,)
        Their evidence, in fifths of a scan.
    table : int32, shape (c, 3)
        Of each curve: first row in `control`, number of rows, first knot in steps.
    """

    def __init__(self, step: float) -> None:
        self.step = step
        self.control = np.empty((0, 2), np.float32)
        self.weight = np.empty(0, np.uint8)
        self.table = np.empty((0, 3), np.int32)
        self.version = 0  # counts changes
        self._keys: list[int] = []  # of each curve, in the index
        self._boxes: dict[int, tuple[float, float, float, float]] = {}
        self._index = BoxIndex()
        self._next = 0

    def __len__(self) -> int:
        return len(self.table)

    @property
    def nbytes(self) -> int:
        """Memory of control points, weights and table [bytes]; the index can be built from them."""
        return self.control.nbytes + self.weight.nbytes + self.table.nbytes

    def curve(self, number: int) -> Curve:
        """Return a copy of a curve, in float64, weights in scans."""
        start, count, first = self.table[number].tolist()
        rows = slice(start, start + count)
        basis = UniformBasis(DEGREE, first * self.step, self.step)
        return Curve(self.control[rows].astype(np.float64), basis, weights=self.weight[rows] / PER_SCAN)

    def near(self, x0: float, y0: float, x1: float, y1: float) -> NDArray[np.int64]:
        """Return the numbers of the curves whose boxes meet a box [m], ascending."""
        places = {key: number for number, key in enumerate(self._keys)}
        return np.array(sorted(places[key] for key in self._index.meeting((x0, y0, x1, y1))), np.int64)

    def change(self, replaced: dict[int, list[Curve]], added: list[Curve]) -> None:
        """Put any number of curves in the place of some, and add others at the end."""
        if not replaced and not added:
            return
        controls: list[NDArray[Any]] = []
        weights: list[NDArray[Any]] = []
        rows: list[NDArray[Any]] = []
        keys: list[int] = []
        start = kept = 0

        def keep(until: int) -> None:
            """Copy the unchanged curves from `kept` on in one piece."""
            nonlocal start
            if until <= kept:
                return
            a, b = int(self.table[kept, 0]), int(self.table[until - 1, :2].sum())
            controls.append(self.control[a:b])
            weights.append(self.weight[a:b])
            block = self.table[kept:until].copy()
            block[:, 0] += start - a
            rows.append(block)
            keys.extend(self._keys[kept:until])
            start += b - a

        def put(curve: Curve) -> None:
            nonlocal start
            n = len(curve.control)
            controls.append(curve.control.astype(np.float32))
            weights.append(np.clip(np.rint(curve.weights * PER_SCAN), 1, 255).astype(np.uint8))
            rows.append(np.array([[start, n, round(curve.basis.origin / self.step)]], np.int32))
            start += n
            keys.append(self._next)
            self._boxes[self._next] = box_of(controls[-1])
            self._index.insert(self._next, self._boxes[self._next])
            self._next += 1

        for number in sorted(replaced):
            keep(number)
            key = self._keys[number]
            self._index.remove(key, self._boxes.pop(key))
            for curve in replaced[number]:
                put(curve)
            kept = number + 1
        keep(len(self.table))
        for curve in added:
            put(curve)
        self.control = np.concatenate(controls) if controls else np.empty((0, 2), np.float32)
        self.weight = np.concatenate(weights) if weights else np.empty(0, np.uint8)
        self.table = np.concatenate(rows) if rows else np.empty((0, 3), np.int32)
        self._keys = keys
        self.version += 1

    @classmethod
    def of_arrays(cls, step: float, control: Any, weight: Any, table: Any) -> "CurveStore":
        """Build from the three arrays; ValueError if they do not fit each other."""
        counts = table[:, 1] if table.ndim == 2 and table.shape[1] == 3 else None
        whole = (
            counts is not None
            and control.dtype == np.float32
            and control.ndim == 2
            and control.shape[1] == 2
            and weight.dtype == np.uint8
            and weight.shape == (len(control),)
            and table.dtype == np.int32
            and bool(np.all(counts > DEGREE))
            and np.array_equal(table[:, 0], np.concatenate(([0], np.cumsum(counts)[:-1]))[: len(table)])
            and int(counts.sum()) == len(control)
            and bool(np.isfinite(control).all())
        )
        if not whole:
            raise ValueError(f"curves of shapes {control.shape}, {weight.shape}, {table.shape} do not fit each other")
        store = cls(step)
        store.control, store.weight, store.table = control, weight, table
        for start, count, _ in table.tolist():
            store._boxes[store._next] = box_of(control[start : start + count])
            store._index.insert(store._next, store._boxes[store._next])
            store._keys.append(store._next)
            store._next += 1
        store.version = 1
        return store


def box_of(points: NDArray[Any]) -> tuple[float, float, float, float]:
    """Return x0, y0, x1, y1 around points (n, 2); a curve lies in the box of its control points."""
    x0, y0 = points.min(axis=0).tolist()
    x1, y1 = points.max(axis=0).tolist()
    return x0, y0, x1, y1
