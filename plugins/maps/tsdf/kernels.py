"""Fusing a scan into a field of truncated signed distances.

Distances are whole numbers of a quantum, `UNKNOWN` where no beam has passed; positive in front of a surface,
negative behind it.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.cells.traversal import axis
from knotwork.core.kernel import inlined, kernel
from knotwork.core.splines.tiles import MASK, slot_of

Array = NDArray[Any]

UNKNOWN = -32768
_GRAZING = 0.1  # least cosine between a beam and the wall's normal for which the normal is believed


@inlined
def _average(
    pool: Array, weights: Array, directory: Array, oi: int, oj: int, i: int, j: int, value: int, share: int, most: int
) -> None:
    """Take a distance of weight `share` into cell (i, j): a mean up to the weight `most`, a moving one after."""
    slot = np.uint64(slot_of(directory, oi, oj, i, j))
    if slot == 0:  # a corner that the coarser traversal of tiles did not see
        return
    a = np.uint64(i & MASK)
    b = np.uint64(j & MASK)
    weight = int(weights[slot, a, b])
    if weight == 0:
        pool[slot, a, b] = value
    else:
        old = float(pool[slot, a, b])
        pool[slot, a, b] = math.floor(old + (value - old) * share / (weight + share) + 0.5)
    weights[slot, a, b] = min(weight + share, most)


@kernel
def fuse(
    pool: Array, directory: Array, oi: int, oj: int, weights: Array, step: float, rays: Array, points: Array,
    pose: Array, truncation: float, quantum: float, nearest: float, no_return: float, behind: float, near: int,
    far: int, most: int, use_normals: bool,
) -> None:  # fmt: skip
    """Fuse rays (k, 6) and the points (n, 4) in which the first n of those that ended did so.

    Each cell that a ray crosses, to `behind` past its end, gets the signed distance of its centre: along
    the ray, or to the line through its end across the normal of the surface there. It weighs `near`, less
    behind the surface, and `far` where the beam was further from its end than the truncation: another surface
    may be nearer to that cell. All tiles are claimed.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    limit = round(truncation / quantum)
    hit = 0
    for k in range(rays.shape[0]):
        x = pose[0] + c * rays[k, 0] - s * rays[k, 1]
        y = pose[1] + s * rays[k, 0] + c * rays[k, 1]
        ux = c * rays[k, 2] - s * rays[k, 3]
        uy = s * rays[k, 2] + c * rays[k, 3]
        length = rays[k, 4]
        ended = rays[k, 5] > 0.0
        nx = ux
        ny = uy
        if ended:
            if use_normals and (points[hit, 2] != 0.0 or points[hit, 3] != 0.0):
                mx = c * points[hit, 2] - s * points[hit, 3]
                my = s * points[hit, 2] + c * points[hit, 3]
                cosine = mx * ux + my * uy
                if abs(cosine) > _GRAZING:
                    nx = math.copysign(1.0, cosine) * mx
                    ny = math.copysign(1.0, cosine) * my
            hit += 1
        end = length + behind if ended else min(length, no_return)
        if end < nearest:
            continue
        i, di, tx, dx = axis(x, ux, nearest, step)
        j, dj, ty, dy = axis(y, uy, nearest, step)
        while True:
            value = limit
            share = far
            if ended:
                px = x + length * ux - (i + 0.5) * step
                py = y + length * uy - (j + 0.5) * step
                along = ux * px + uy * py
                distance = along if along > 2.0 * truncation else nx * px + ny * py
                if distance < truncation:
                    value = max(math.floor(distance / quantum + 0.5), -limit)
                    share = near
                    if distance < -step:
                        share = max(int(near * (1.0 + distance / truncation)), 1)
            if share > 0:
                _average(pool, weights, directory, oi, oj, i, j, value, share, most)
            if min(tx, ty) > end:
                break
            if tx < ty:
                i += di
                tx += dx
            else:
                j += dj
                ty += dy
