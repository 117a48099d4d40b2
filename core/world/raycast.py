"""Ray casting and distances against segments and arcs; a uniform grid keeps a ray's work local."""

from math import ceil, floor, inf, sqrt

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import kernel
from knotwork.core.messages import F64
from knotwork.core.world.scene import World

I32 = NDArray[np.int32]

_CELL = 0.5  # m; grows when the world would need more cells than this
_MAX_CELLS = 1_000_000


class RayCaster:
    """Answers what a sensor and a bumper want to know of a world.

    Parameters
    ----------
    world
        Its obstacles are indexed once; it must not change afterwards.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self._segments = np.ascontiguousarray(world.segments)
        self._arcs = _arc_rows(world.arcs)
        x1, y1, x2, y2 = world.bounds()
        cell = max(_CELL, sqrt((x2 - x1) * (y2 - y1) / _MAX_CELLS), max(x2 - x1, y2 - y1) / _MAX_CELLS)
        self._grid = np.array([x1, y1, cell])
        shape = (max(1, ceil((x2 - x1) / cell)), max(1, ceil((y2 - y1) / cell)))
        self._shape = np.array(shape, dtype=np.int32)
        self._starts, self._items = _index(self._segments, self._arcs, self._grid, self._shape)

    def cast(self, origins: F64, directions: F64, range_max: float = inf) -> F64:
        """Return the distance along each ray to the first obstacle, `inf` without one.

        Parameters
        ----------
        origins, directions : shape (n, 2)
            World frame; directions of length 1.
        range_max
            Obstacles farther away are not looked for [m].

        Returns
        -------
        shape (n,) [m]
        """
        return _cast(
            origins, directions, range_max, self._segments, self._arcs,
            self._grid, self._shape, self._starts, self._items,
        )  # fmt: skip

    def clearance(self, x: float, y: float) -> float:
        """Return the distance from a point to the nearest obstacle [m]."""
        return _clearance(x, y, self._segments, self._arcs)

    def clearances(self, points: F64) -> F64:
        """Return the distance from each of `points` (n, 2) to the nearest obstacle: shape (n,) [m]."""
        return np.array([self.clearance(x, y) for x, y in np.asarray(points, dtype=np.float64).tolist()])

    def collides(self, x: float, y: float, radius: float) -> bool:
        """Return True when a disc at (x, y) touches an obstacle."""
        return self.clearance(x, y) <= radius


def _arc_rows(arcs: F64) -> F64:
    """Rows of centre, radius, unit vector to the middle, cosine of half the sweep, both ends: (m, 10)."""
    x, y, radius, first, sweep = arcs.T
    middle = first + 0.5 * sweep
    half = np.abs(0.5 * sweep)
    # A full circle has no ends: no cosine is below -2.
    bound = np.where(half >= np.pi - 1e-9, -2.0, np.cos(half))
    x0, y0 = x + radius * np.cos(first), y + radius * np.sin(first)
    x1, y1 = x + radius * np.cos(first + sweep), y + radius * np.sin(first + sweep)
    return np.column_stack((x, y, radius, np.cos(middle), np.sin(middle), bound, x0, y0, x1, y1))


@kernel
def _overlaps_segment(x0: float, y0: float, h: float, segment: F64) -> bool:
    """Separating axes of the square (x0, y0) to (x0 + h, y0 + h) and a segment."""
    ax, ay, bx, by = segment[0], segment[1], segment[2], segment[3]
    slack = 1e-9 * (1.0 + h)
    if max(ax, bx) < x0 - slack or min(ax, bx) > x0 + h + slack:
        return False
    if max(ay, by) < y0 - slack or min(ay, by) > y0 + h + slack:
        return False
    ex, ey = bx - ax, by - ay
    off = abs(ex * (y0 + 0.5 * h - ay) - ey * (x0 + 0.5 * h - ax))
    return bool(off <= 0.5 * h * (abs(ex) + abs(ey)) + slack * (abs(ex) + abs(ey)))


@kernel
def _overlaps_circle(x0: float, y0: float, h: float, arc: F64) -> bool:
    """Whether the circle's line passes through the square."""
    dx, dy = abs(x0 + 0.5 * h - arc[0]), abs(y0 + 0.5 * h - arc[1])
    nx, ny = max(dx - 0.5 * h, 0.0), max(dy - 0.5 * h, 0.0)
    fx, fy = dx + 0.5 * h, dy + 0.5 * h
    slack = 1e-9 * (1.0 + arc[2])
    return bool(sqrt(nx * nx + ny * ny) <= arc[2] + slack and sqrt(fx * fx + fy * fy) >= arc[2] - slack)


@kernel
def _cell_range(low: float, high: float, origin: float, h: float, n: int) -> tuple[int, int]:
    """First and last cell that [low, high] may touch, one to spare on each side for rounding."""
    first = min(max(floor((low - origin) / h) - 1, 0), n - 1)
    last = min(max(floor((high - origin) / h) + 1, 0), n - 1)
    return first, last


@kernel
def _visit(segments: F64, arcs: F64, grid: F64, shape: I32, counts: I32, items: I32, fill: bool) -> None:
    """Count the obstacles of each cell, or with `fill` write them where `counts` says."""
    h = grid[2]
    n = segments.shape[0]
    for k in range(n + arcs.shape[0]):
        if k < n:
            s = segments[k]
            xl, xh, yl, yh = min(s[0], s[2]), max(s[0], s[2]), min(s[1], s[3]), max(s[1], s[3])
        else:
            a = arcs[k - n]
            xl, xh, yl, yh = a[0] - a[2], a[0] + a[2], a[1] - a[2], a[1] + a[2]
        i0, i1 = _cell_range(xl, xh, grid[0], h, shape[0])
        j0, j1 = _cell_range(yl, yh, grid[1], h, shape[1])
        for j in range(j0, j1 + 1):
            for i in range(i0, i1 + 1):
                x0, y0 = grid[0] + i * h, grid[1] + j * h
                if k < n:
                    inside = _overlaps_segment(x0, y0, h, segments[k])
                else:
                    inside = _overlaps_circle(x0, y0, h, arcs[k - n])
                if inside:
                    c = j * shape[0] + i
                    if fill:
                        items[counts[c]] = k
                    counts[c] += 1


def _index(segments: F64, arcs: F64, grid: F64, shape: I32) -> tuple[I32, I32]:
    """Obstacles by cell: those of cell c are items[starts[c]:starts[c + 1]]."""
    counts = np.zeros(int(shape[0]) * int(shape[1]), dtype=np.int32)
    _visit(segments, arcs, grid, shape, counts, np.empty(0, dtype=np.int32), False)
    starts = np.zeros(len(counts) + 1, dtype=np.int32)
    np.cumsum(counts, out=starts[1:])
    items = np.empty(int(starts[-1]), dtype=np.int32)
    _visit(segments, arcs, grid, shape, starts[:-1].copy(), items, True)
    return starts, items


@kernel
def _hit_segment(ox: float, oy: float, dx: float, dy: float, s: F64) -> float:
    ex, ey = s[2] - s[0], s[3] - s[1]
    cross = dx * ey - dy * ex
    if cross * cross < 1e-24 * (ex * ex + ey * ey):
        return inf  # seen edge on: no width
    ax, ay = s[0] - ox, s[1] - oy
    t = (ax * ey - ay * ex) / cross
    u = (ax * dy - ay * dx) / cross
    if t < 0.0 or u < -1e-9 or u > 1.0 + 1e-9:  # the slack closes corners
        return inf
    return float(t)


@kernel
def _hit_arc(ox: float, oy: float, dx: float, dy: float, a: F64) -> float:
    fx, fy = ox - a[0], oy - a[1]
    b = fx * dx + fy * dy
    # The offset from the ray to the centre squared, not |f|^2 - b^2: that cancels far away.
    side = fx * dy - fy * dx
    disc = a[2] * a[2] - side * side
    if disc < 0.0:
        return inf
    root = sqrt(disc)
    for t in (-b - root, -b + root):
        if t >= 0.0:
            px, py = fx + t * dx, fy + t * dy
            if px * a[3] + py * a[4] >= a[5] * a[2]:
                return float(t)
    return inf


@kernel
def _cast(
    origins: F64,
    directions: F64,
    range_max: float,
    segments: F64,
    arcs: F64,
    grid: F64,
    shape: I32,
    starts: I32,
    items: I32,
) -> F64:
    n = segments.shape[0]
    x0, y0, h = grid[0], grid[1], grid[2]
    x1, y1 = x0 + shape[0] * h, y0 + shape[1] * h
    out = np.full(origins.shape[0], inf)
    for k in range(origins.shape[0]):
        ox, oy, dx, dy = origins[k, 0], origins[k, 1], directions[k, 0], directions[k, 1]
        # The part of the ray inside the grid.
        t, t_end = 0.0, range_max
        if dx != 0.0:
            ta, tb = (x0 - ox) / dx, (x1 - ox) / dx
            t, t_end = max(t, min(ta, tb)), min(t_end, max(ta, tb))
        elif ox < x0 or ox > x1:
            continue
        if dy != 0.0:
            ta, tb = (y0 - oy) / dy, (y1 - oy) / dy
            t, t_end = max(t, min(ta, tb)), min(t_end, max(ta, tb))
        elif oy < y0 or oy > y1:
            continue
        slack = 1e-9 * (1.0 + abs(t))
        if t > t_end + slack:
            continue
        i = min(max(floor((ox + t * dx - x0) / h), 0), shape[0] - 1)
        j = min(max(floor((oy + t * dy - y0) / h), 0), shape[1] - 1)
        di, dj = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1
        tx, ty, sx, sy = inf, inf, inf, inf
        if dx != 0.0:
            tx, sx = (x0 + (i + (dx > 0.0)) * h - ox) / dx, h / abs(dx)
        if dy != 0.0:
            ty, sy = (y0 + (j + (dy > 0.0)) * h - oy) / dy, h / abs(dy)
        best = inf
        while True:
            c = j * shape[0] + i
            for m in range(starts[c], starts[c + 1]):
                item = items[m]
                if item < n:
                    hit = _hit_segment(ox, oy, dx, dy, segments[item])
                else:
                    hit = _hit_arc(ox, oy, dx, dy, arcs[item - n])
                if hit < best:
                    best = hit
            leave = min(tx, ty)
            if best <= leave or leave > t_end:
                break
            if tx < ty:
                i += di
                tx += sx
                if i < 0 or i >= shape[0]:
                    break
            else:
                j += dj
                ty += sy
                if j < 0 or j >= shape[1]:
                    break
        if best <= range_max:
            out[k] = best
    return out


@kernel
def _clearance(x: float, y: float, segments: F64, arcs: F64) -> float:
    best = inf
    for k in range(segments.shape[0]):
        ax, ay = x - segments[k, 0], y - segments[k, 1]
        ex, ey = segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1]
        u = min(max((ax * ex + ay * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        gx, gy = ax - u * ex, ay - u * ey
        best = min(best, gx * gx + gy * gy)
    best = sqrt(best)
    for k in range(arcs.shape[0]):
        a = arcs[k]
        px, py = x - a[0], y - a[1]
        r = sqrt(px * px + py * py)
        if px * a[3] + py * a[4] >= a[5] * r:
            d = abs(r - a[2])
        else:
            d = sqrt(min((x - a[6]) ** 2 + (y - a[7]) ** 2, (x - a[8]) ** 2 + (y - a[9]) ** 2))
        best = min(best, d)
    return float(best)
