"""The cells that a ray crosses, in order: J. Amanatides and A. Woo, "A fast voxel traversal algorithm" (1987).

Cell (i, j) is the square [i, i + 1) x [j, j + 1) times its side `step` [m]. A loop over a ray's cells keeps
the state (i, j, tx, ty): the cell, and the distances [m] at which the ray crosses the next border along x
and along y. The ray is in the cell from the distance before until min(tx, ty).
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import inlined, kernel
from knotwork.core.splines.tiles import SIDE, TiledArray

Array = NDArray[Any]

_NEVER = 1e300
_PARALLEL = 1e-12  # a smaller component of the direction crosses no border


@inlined
def axis(x: float, u: float, start: float, step: float) -> tuple[int, int, float, float]:
    """Return (cell, direction, distance of the next border, distance between borders) of one axis.

    `x` [m] is where the ray begins, `u` its direction's component; the traversal begins at distance `start`.
    """
    i = math.floor((x + start * u) / step)
    if u > _PARALLEL:
        return i, 1, ((i + 1) * step - x) / u, step / u
    if u < -_PARALLEL:
        return i, -1, (i * step - x) / u, -step / u
    return i, 0, _NEVER, _NEVER


@kernel
def cells_along(x: float, y: float, ux: float, uy: float, start: float, end: float, step: float) -> Array:
    """Return the cells (n, 2) that the ray from (x, y) along the unit vector (ux, uy) crosses.

    From distance `start` to `end` [m], both included.
    """
    out = np.empty((int((end - start) / step) * 2 + 4, 2), np.int64)
    i, di, tx, dx = axis(x, ux, start, step)
    j, dj, ty, dy = axis(y, uy, start, step)
    n = 0
    while True:
        out[n, 0] = i
        out[n, 1] = j
        n += 1
        if min(tx, ty) > end or n == out.shape[0]:
            return out[:n]
        if tx < ty:
            i += di
            tx += dx
        else:
            j += dj
            ty += dy


@kernel
def claim_along(
    directory: Array, oi: int, oj: int, side: float, rays: Array, pose: Array, nearest: float, over: float,
    no_return: float, used: int,
) -> int:  # fmt: skip
    """Give every tile that a ray crosses a slot; return the new number of slots.

    Parameters
    ----------
    directory, oi, oj
        Of the tiles; it spans all rays.
    side
        Of a tile [m].
    rays, pose
        `Beams.rays` (k, 6) and the robot's pose (3,).
    nearest, over, no_return
        Rays count from `nearest` [m] on, to `over` beyond their end, or to `no_return` if they have none.
    used
        Slots in use.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    for k in range(rays.shape[0]):
        end = rays[k, 4] + over if rays[k, 5] > 0.0 else min(rays[k, 4], no_return)
        if end < nearest:
            continue
        x = pose[0] + c * rays[k, 0] - s * rays[k, 1]
        y = pose[1] + s * rays[k, 0] + c * rays[k, 1]
        i, di, tx, dx = axis(x, c * rays[k, 2] - s * rays[k, 3], nearest, side)
        j, dj, ty, dy = axis(y, s * rays[k, 2] + c * rays[k, 3], nearest, side)
        while True:
            a = i - oi
            b = j - oj
            if 0 <= a < directory.shape[0] and 0 <= b < directory.shape[1] and directory[a, b] == 0:
                directory[a, b] = used
                used += 1
            if min(tx, ty) > end:
                break
            if tx < ty:
                i += di
                tx += dx
            else:
                j += dj
                ty += dy
    return used


def claim(cells: TiledArray, step: float, rays: Array, pose: Array, nearest: float, over: float, free: float) -> None:
    """Back all tiles that rays cross with memory; see `claim_along`."""
    lengths = np.where(rays[:, 5] > 0, rays[:, 4] + over, np.minimum(rays[:, 4], free))
    reach = float(lengths.max() + np.abs(rays[:, :2]).sum(axis=1).max()) + 2 * step
    x, y = float(pose[0]), float(pose[1])
    cells.cover(
        math.floor((x - reach) / step), math.floor((y - reach) / step),
        math.ceil((x + reach) / step), math.ceil((y + reach) / step),
    )  # fmt: skip
    used = claim_along(cells.directory, cells.oi, cells.oj, SIDE * step, rays, pose, nearest, over, free, cells.used)
    cells.commit(used)
