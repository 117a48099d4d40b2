"""Which curve is near a point, by its direction: a raster of samples around a scan."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import kernel
from knotwork.core.messages import F64
from knotwork.plugins.maps.spline_curve.piece import place
from knotwork.plugins.maps.spline_curve.store import CurveStore

Array = NDArray[Any]

CELL = 0.2  # m
_MOST = 4_000_000  # cells, in all four layers
PER_KNOT = 2  # samples in a knot interval
FRONT = 1.5  # m: so far in front of a curve it is known that nothing is
_FAR = 8  # each so manieth sample reaches as far
_ROOM = 1.0  # m around the box that was asked for


@dataclass(frozen=True, slots=True)
class Lookup:
    """Nearest samples of curves; one layer for each quadrant of the curves' direction: walls have two sides.

    Attributes
    ----------
    cells : int32, shape (4, rows, columns)
        Number of the sample nearest to the cell's centre, -1 for none within reach; beyond the reach, up to
        `FRONT`, one of the nearest.
    x0, y0, cell
        Corner and side of the raster [m].
    samples : shape (s, 4)
        x, y [m], curve, parameter in knot intervals.
    """

    cells: NDArray[np.int32]
    x0: float
    y0: float
    cell: float
    samples: F64


def lookup_of(store: CurveStore, box: tuple[float, float, float, float], reach: float) -> Lookup:
    """Return the lookup of all curves in a box (x0, y0, x1, y1) [m], valid up to `reach` from them [m]."""
    x0, y0, x1, y1 = box
    numbers = store.near(*box)
    cell = max(CELL, math.sqrt(4.0 * (x1 - x0) * (y1 - y0) / _MOST))
    columns, rows = int((x1 - x0) / cell) + 1, int((y1 - y0) / cell) + 1
    cells = np.full((4, rows, columns), -1, np.int32)
    most = int((store.table[numbers, 1] - 3).sum()) * PER_KNOT + len(numbers)
    samples = np.empty((most, 4))
    distances = np.full((4, rows, columns), np.inf, np.float32)
    used = splat(store.control, store.table, numbers, x0, y0, cell, reach, cells, distances, samples)
    return Lookup(cells, x0, y0, cell, samples[:used])


@kernel
def splat(
    control: Array, table: Array, numbers: Array, x0: float, y0: float, cell: float, reach: float,
    cells: Array, distances: Array, samples: Array,
) -> int:  # fmt: skip
    """Fill raster and samples; return the number of samples."""
    rows, columns = cells.shape[1], cells.shape[2]
    near = math.ceil(reach / cell)
    far = math.ceil(FRONT / cell)
    used = 0
    for n in range(numbers.shape[0]):
        curve = numbers[n]
        start, count, first = int(table[curve, 0]), int(table[curve, 1]), int(table[curve, 2])
        for k in range(PER_KNOT * (count - 3) + 1):
            q = first + 3.0 + k / PER_KNOT
            x, y, dx, dy, _, _ = place(control, start, count, first, q)
            column = math.floor((x - x0) / cell)
            row = math.floor((y - y0) / cell)
            span = far if used % _FAR == 0 else near
            if column < -span or row < -span or column >= columns + span or row >= rows + span:
                continue
            samples[used, 0] = x
            samples[used, 1] = y
            samples[used, 2] = curve
            samples[used, 3] = q
            layer = quadrant(math.atan2(dy, dx))
            for i in range(max(row - span, 0), min(row + span + 1, rows)):
                for j in range(max(column - span, 0), min(column + span + 1, columns)):
                    cx = x0 + (j + 0.5) * cell - x
                    cy = y0 + (i + 0.5) * cell - y
                    square = cx * cx + cy * cy
                    if square < distances[layer, i, j]:
                        distances[layer, i, j] = square
                        cells[layer, i, j] = used
            used += 1
    return used


@kernel
def quadrant(angle: float) -> int:
    """Return which quarter of the circle an angle lies in, 0 to 3."""
    number: int = math.floor(angle * (2.0 / math.pi)) & 3
    return number


@kernel
def any_nearest(cells: Array, samples: Array, x0: float, y0: float, cell: float, x: float, y: float) -> int:
    """Return the sample nearest to the point, of all directions."""
    column = math.floor((x - x0) / cell)
    row = math.floor((y - y0) / cell)
    found = -1
    if column < 0 or row < 0 or column >= cells.shape[2] or row >= cells.shape[1]:
        return found
    least = math.inf
    for layer in range(4):
        sample = cells[layer, row, column]
        if sample >= 0:
            square = (samples[sample, 0] - x) ** 2 + (samples[sample, 1] - y) ** 2
            if square < least:
                least = square
                found = sample
    return found


@kernel
def candidates(
    cells: Array, x0: float, y0: float, cell: float, x: float, y: float, tx: float, ty: float
) -> tuple[int, int]:
    """Return the samples nearest to the point's cell, of the two quadrants within 45 degrees of its direction."""
    column = math.floor((x - x0) / cell)
    row = math.floor((y - y0) / cell)
    if column < 0 or row < 0 or column >= cells.shape[2] or row >= cells.shape[1]:
        return -1, -1
    angle = math.atan2(ty, tx)
    a = quadrant(angle - 0.25 * math.pi)
    b = quadrant(angle + 0.25 * math.pi)
    return cells[a, row, column], cells[b, row, column]


class LookupCache:
    """The lookup of a store, made again when the curves changed or a place outside is asked for."""

    def __init__(self, store: CurveStore, reach: float) -> None:
        self._store = store
        self._reach = reach
        self._box = (0.0, 0.0, 0.0, 0.0)
        self._version = -1
        self._lookup: Lookup | None = None

    def covering(self, box: tuple[float, float, float, float]) -> Lookup:
        """Return a lookup that covers `box` (x0, y0, x1, y1) [m]."""
        have = self._box
        inside = have[0] <= box[0] and have[1] <= box[1] and have[2] >= box[2] and have[3] >= box[3]
        if self._lookup is None or self._version != self._store.version or not inside:
            self._box = (box[0] - _ROOM, box[1] - _ROOM, box[2] + _ROOM, box[3] + _ROOM)
            self._lookup = lookup_of(self._store, self._box, self._reach)
            self._version = self._store.version
        return self._lookup
