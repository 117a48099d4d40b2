"""Fusing a scan into a grid of log-odds."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.cells.traversal import axis
from knotwork.core.kernel import inlined, kernel
from knotwork.core.splines.tiles import MASK, slot_of

Array = NDArray[Any]


@inlined
def _add(
    pool: Array, marks: Array, directory: Array, oi: int, oj: int, i: int, j: int, amount: int, clamp: int
) -> None:
    """Add to cell (i, j) unless this scan has changed it."""
    slot = np.uint64(slot_of(directory, oi, oj, i, j))
    if slot == 0:  # a corner that the coarser traversal of tiles did not see
        return
    a = np.uint64(i & MASK)
    b = np.uint64(j & MASK)
    bit = np.uint64(1) << b
    if marks[slot, a] & bit:
        return
    marks[slot, a] |= bit
    pool[slot, a, b] = min(max(int(pool[slot, a, b]) + amount, -clamp), clamp)


@kernel
def fuse(
    pool: Array, directory: Array, oi: int, oj: int, marks: Array, step: float, rays: Array, pose: Array,
    hit: int, free: int, clamp: int, nearest: float, margin: float, no_return: float,
) -> None:  # fmt: skip
    """Fuse rays: each cell changes once a scan, by `hit` if a beam ended in it, else by -`free` if one passed.

    `marks` (slots, SIDE), zeros, has a bit for each cell of each tile; all tiles have been claimed.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    for k in range(rays.shape[0]):
        if rays[k, 5] > 0.0:
            x = pose[0] + c * rays[k, 0] - s * rays[k, 1] + rays[k, 4] * (c * rays[k, 2] - s * rays[k, 3])
            y = pose[1] + s * rays[k, 0] + c * rays[k, 1] + rays[k, 4] * (s * rays[k, 2] + c * rays[k, 3])
            _add(pool, marks, directory, oi, oj, math.floor(x / step), math.floor(y / step), hit, clamp)
    if free == 0:
        return
    for k in range(rays.shape[0]):
        end = rays[k, 4] - margin if rays[k, 5] > 0.0 else min(rays[k, 4], no_return)
        if end < nearest:
            continue
        x = pose[0] + c * rays[k, 0] - s * rays[k, 1]
        y = pose[1] + s * rays[k, 0] + c * rays[k, 1]
        i, di, tx, dx = axis(x, c * rays[k, 2] - s * rays[k, 3], nearest, step)
        j, dj, ty, dy = axis(y, s * rays[k, 2] + c * rays[k, 3], nearest, step)
        while True:
            _add(pool, marks, directory, oi, oj, i, j, -free, clamp)
            if min(tx, ty) > end:
                break
            if tx < ty:
                i += di
                tx += dx
            else:
                j += dj
                ty += dy
