"""A rough way among obstacles: shortest on a grid, then pulled straight. `plan_path` makes it smooth."""

import heapq
import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.obstacle import Obstacle

F64 = NDArray[np.float64]

_MARGIN = 1.0  # m; the grid ends this far beyond all obstacles and both ends
_MOST_CELLS = 4_000_000
_STEPS = tuple((i, j, math.hypot(i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


def find_route(
    start: ArrayLike, goal: ArrayLike, obstacles: Sequence[Obstacle], clearance: float, *, cell: float = 0.05
) -> F64:
    """Return corners (k, 2) [m] of a short way from start to goal that keeps `clearance` from all obstacles.

    Cells nearer to an obstacle than twice the clearance cost more, so the way keeps to the middle of a door.

    Parameters
    ----------
    start, goal
        Points (2,) [m].
    obstacles
        What to avoid; polygons are given by their corners in order.
    clearance
        Least distance [m] to any obstacle.
    cell
        Side [m] of a cell of the grid.

    Raises
    ------
    InputError
        For an end nearer than `clearance` to an obstacle, or a plane too large for the grid.
    KnotworkError
        If no way exists.
    """
    ends = np.array([start, goal], np.float64).reshape(2, 2)
    edges, radii = _edges(obstacles)
    gaps = _distance(ends, edges, radii)
    for point, gap in zip(ends, gaps, strict=True):
        if not gap >= clearance:
            raise InputError(f"{point.tolist()} is {max(gap, 0.0):.2f} m from an obstacle, expected {clearance} m")
    corners = np.concatenate((edges.reshape(-1, 2), ends))
    low, high = corners.min(axis=0) - _MARGIN, corners.max(axis=0) + _MARGIN
    shape = tuple(int(v) for v in np.ceil((high - low) / cell)) if np.isfinite(high - low).all() else (_MOST_CELLS, 2)
    if shape[0] * shape[1] > _MOST_CELLS:
        raise InputError(f"the obstacles span {shape[0]} x {shape[1]} cells of {cell} m", hint="give a larger cell")
    x, y = (low[a] + (np.arange(shape[a]) + 0.5) * cell for a in range(2))
    free = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2).reshape(-1, 2)
    distance = _distance(free, edges, radii).reshape(shape)
    first, last = (tuple(int(v) for v in (end - low) // cell) for end in ends)
    # A start in a free place may stand in a cell whose middle is not: half a diagonal is given away there.
    passable = distance >= clearance
    for i, j in (first, last):
        passable[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] |= (
            distance[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] >= clearance - cell
        )
    cost = np.where(passable, 1.0 + np.clip(2.0 - distance / max(clearance, cell), 0.0, 1.0), np.inf)
    cells = _cheapest(cost, (first[0], first[1]), (last[0], last[1]))
    if cells is None:
        raise KnotworkError(
            f"no way from {ends[0].tolist()} to {ends[1].tolist()} that keeps {clearance} m from everything",
            hint="is the goal behind a wall? else give less clearance",
        )
    way = np.vstack((ends[:1], low + (np.array(cells[1:-1]).reshape(-1, 2) + 0.5) * cell, ends[1:]))
    return _pulled(way, edges, radii, clearance)


def _cheapest(cost: F64, first: tuple[int, int], last: tuple[int, int]) -> list[tuple[int, int]] | None:
    """Return the cells of the cheapest way over eight neighbours (A*), or None."""
    best = {first: 0.0}
    before: dict[tuple[int, int], tuple[int, int]] = {}
    queue = [(0.0, first)]
    done: set[tuple[int, int]] = set()
    while queue:
        _, here = heapq.heappop(queue)
        if here == last:
            way = [here]
            while here in before:
                here = before[here]
                way.append(here)
            return way[::-1]
        if here in done:
            continue
        done.add(here)
        for di, dj, length in _STEPS:
            there = here[0] + di, here[1] + dj
            if not (0 <= there[0] < cost.shape[0] and 0 <= there[1] < cost.shape[1]):
                continue
            spent = best[here] + length * float(cost[there])
            if spent < best.get(there, math.inf):
                best[there], before[there] = spent, here
                heapq.heappush(queue, (spent + math.hypot(there[0] - last[0], there[1] - last[1]), there))
    return None


def _pulled(way: F64, edges: F64, radii: F64, clearance: float) -> F64:
    """Leave out what a straight line that is as clear can replace."""
    kept = [way[0]]
    here = 0
    while here < len(way) - 1:
        reach = here + 1
        for far in range(len(way) - 1, here + 1, -1):
            count = max(int(np.linalg.norm(way[far] - way[here]) / 0.02), 2)
            line = way[here] + np.linspace(0.0, 1.0, count)[:, None] * (way[far] - way[here])
            if _distance(line, edges, radii).min() >= 1.5 * clearance:
                reach = far
                break
        here = reach
        kept.append(way[here])
    return np.array(kept)


def _edges(obstacles: Sequence[Obstacle]) -> tuple[F64, F64]:
    """Return the edges (n, 4) and their radii (n,)."""
    edges, radii = [], []
    for obstacle in obstacles:
        points = np.asarray(obstacle.points, np.float64).reshape(-1, 2)
        closed = np.vstack((points, points[:1])) if len(points) != 2 else points
        for a, b in pairwise(closed):
            edges.append([*a, *b])
            radii.append(obstacle.radius)
    return np.array(edges, np.float64).reshape(-1, 4), np.array(radii, np.float64)


def _distance(points: F64, edges: F64, radii: F64) -> F64:
    """Return the distance (n,) from each of `points` (n, 2) to the nearest obstacle."""
    nearest = np.full(len(points), np.inf)
    for (ax, ay, bx, by), radius in zip(edges.tolist(), radii.tolist(), strict=True):
        dx, dy = bx - ax, by - ay
        px, py = points[:, 0] - ax, points[:, 1] - ay
        share = np.clip((px * dx + py * dy) / max(dx * dx + dy * dy, 1e-300), 0.0, 1.0)
        np.minimum(nearest, np.hypot(px - share * dx, py - share * dy) - radius, out=nearest)
    return nearest
