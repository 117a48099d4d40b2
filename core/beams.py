"""A scan as points and rays in the robot's frame, de-skewed: what every map makes of it first."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import inlined, kernel
from knotwork.core.messages import F64, Scan

Array = NDArray[Any]

_NEIGHBOURS = 8  # beams to each side that a normal is fitted to, at most
_REACH = (0.15, 1.0)  # m: how far they may be, at least and at most
_STRETCH = 2.2  # and in spacings of the beams there
_FLAT = 0.1  # largest ratio of the variances across and along a line


@dataclass(frozen=True, slots=True)
class Beams:
    """A scan in the robot's frame at the scan's stamp.

    Attributes
    ----------
    points : shape (n, 4)
        Where beams ended [m], and the unit normal of the surface there, from the neighbouring beams; (0, 0)
        where they do not lie on a line.
    rays : shape (k, 6)
        Origin x, y [m], direction x, y (unit), length [m], 1 if the beam ended there, 0 for no return.
        Invalid beams (NaN, too near) are left out.
    """

    points: F64
    rays: F64


def beams_of(scan: Scan, range_min: float, range_max: float, motion: F64 | None = None) -> Beams:
    """Return the beams of a scan.

    Parameters
    ----------
    scan
        Ranges at or beyond `range_max` (or the scan's own) are no return, of that length.
    range_min, range_max
        [m]; shorter ranges are ignored.
    motion : shape (3,) or None
        Twist of the robot during the scan: each beam is moved to the stamp by it; None: as measured.
    """
    n = len(scan.ranges)
    points = np.empty((n, 4))
    rays = np.empty((n, 6))
    vx, vy, w = (0.0, 0.0, 0.0) if motion is None else motion.tolist()
    mx, my, myaw = scan.mount
    hits, kept = fill_beams(
        scan.ranges, scan.angle_min, scan.angle_increment, mx, my, myaw,
        max(range_min, scan.range_min), min(range_max, scan.range_max),
        scan.time_offset, scan.time_increment, vx, vy, w, points, rays,
    )  # fmt: skip
    fill_normals(points[:hits])
    return Beams(points[:hits], rays[:kept])


@kernel
def fill_beams(
    ranges: Array, angle_min: float, angle_increment: float, mx: float, my: float, myaw: float,
    range_min: float, range_max: float, time_offset: float, time_increment: float,
    vx: float, vy: float, w: float, points: Array, rays: Array,
) -> tuple[int, int]:  # fmt: skip
    """Fill `points` and `rays` of `Beams`; return how many of each."""
    hits = kept = 0
    still = vx == 0.0 and vy == 0.0 and w == 0.0
    for i in range(ranges.shape[0]):
        r = float(ranges[i])
        if not r >= range_min or r <= 0.0:  # NaN too
            continue
        angle = myaw + angle_min + i * angle_increment
        ox = mx
        oy = my
        if not still:  # pose of the robot at the beam's time, seen from the one at the stamp
            t = time_offset + i * time_increment
            a = w * t
            if abs(a) < 1e-4:
                p = t * (1.0 - a * a / 6.0)
                q = 0.5 * t * a
            else:
                p = math.sin(a) / w
                q = (1.0 - math.cos(a)) / w
            c = math.cos(a)
            s = math.sin(a)
            ox = p * vx - q * vy + c * mx - s * my
            oy = q * vx + p * vy + s * mx + c * my
            angle += a
        ux = math.cos(angle)
        uy = math.sin(angle)
        ended = r < range_max
        length = r if ended else range_max
        if ended:
            points[hits, 0] = ox + r * ux
            points[hits, 1] = oy + r * uy
            hits += 1
        rays[kept, 0] = ox
        rays[kept, 1] = oy
        rays[kept, 2] = ux
        rays[kept, 3] = uy
        rays[kept, 4] = length
        rays[kept, 5] = 1.0 if ended else 0.0
        kept += 1
    return hits, kept


@kernel
def fill_normals(points: Array) -> None:
    """Fill columns 2 and 3 of points (n, 4), in the order of the beams, with normals; see `Beams`.

    A wall says nothing of the motion along it. But where a map has seen a wall longer its evidence is
    stronger, and far beams hit a wall in dots: both slope along the wall. Without normals a localiser takes
    that slope for knowledge and lags behind the robot.
    """
    n = points.shape[0]
    for k in range(n):
        px = points[k, 0]
        py = points[k, 1]
        a = k - 1 if k > 0 else n - 1
        b = k + 1 if k < n - 1 else 0
        spacing2 = min(
            (points[a, 0] - px) ** 2 + (points[a, 1] - py) ** 2, (points[b, 0] - px) ** 2 + (points[b, 1] - py) ** 2
        )
        reach2 = min(max(_REACH[0] * _REACH[0], _STRETCH * _STRETCH * spacing2), _REACH[1] * _REACH[1])
        count = 1
        sx = sy = sxx = sxy = syy = 0.0
        for side in (-1, 1):
            m = k
            for _ in range(_NEIGHBOURS):
                m += side
                if m < 0:
                    m += n
                elif m >= n:
                    m -= n
                dx = points[m, 0] - px
                dy = points[m, 1] - py
                if dx * dx + dy * dy > reach2:
                    break
                count += 1
                sx += dx
                sy += dy
                sxx += dx * dx
                sxy += dx * dy
                syy += dy * dy
        points[k, 2] = 0.0
        points[k, 3] = 0.0
        if count < 3:
            continue
        sxx -= sx * sx / count
        sxy -= sx * sy / count
        syy -= sy * sy / count
        mean = 0.5 * (sxx + syy)
        d = 0.5 * (sxx - syy)
        half = math.sqrt(d * d + sxy * sxy)
        if mean - half < _FLAT * (mean + half):
            # the eigenvector of the smaller eigenvalue, from whichever row is the longer
            if d > 0.0:
                nx, ny = -sxy, half + d
            else:
                nx, ny = half - d, -sxy
            per = 1.0 / math.sqrt(nx * nx + ny * ny)
            points[k, 2] = nx * per
            points[k, 3] = ny * per


@inlined
def across(points: Array, k: int, c: float, s: float, gx: float, gy: float) -> tuple[float, float]:
    """Return the part of a gradient across the surface that point `k` lies on; all of it without a normal.

    `points` are those of `Beams`; `c` and `s` are cosine and sine of the robot's yaw in the map.
    """
    if points[k, 2] == 0.0 and points[k, 3] == 0.0:
        return gx, gy
    nx = c * points[k, 2] - s * points[k, 3]
    ny = s * points[k, 2] + c * points[k, 3]
    g = gx * nx + gy * ny
    return g * nx, g * ny
