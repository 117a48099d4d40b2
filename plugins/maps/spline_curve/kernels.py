"""The cost of a scan against associated curves: offsets solved inside, normal equations, residuals (6.17 to 6.19).

A point of run j at length l of its cluster is compared with the curve's point at l + o_j. The difference is
taken across and along the curve there, each over its own standard deviation. The offset o_j is the one of
least cost at the pose, so the pose's normal equations are what remains of (6.17) when the offsets are
eliminated. With `along` 0 each point has an offset of its own, the one that takes it to the nearest place:
the difference across is left. Points on no curve cost what a point at the gate does, and those on a curve do so
by what the curve lacks of full trust: what one scan has seen may be somebody who walks along.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import inlined, kernel
from knotwork.core.robust import loss_terms
from knotwork.plugins.maps.spline_curve.piece import place

Array = NDArray[Any]

_ITERATIONS = 12
_SETTLED = 1e-5  # knot intervals
_FOOT = 4  # steps to the nearest place

Row = tuple[float, float, float, float, float, float, float, float]


@inlined
def _row(
    control: Array, start: int, count: int, first: int, q: float, x: float, y: float, across: float, along: float
) -> Row:
    """Return both residuals of a point, their gradients with respect to the point, and to the offset."""
    px, py, dx, dy, ex, ey = place(control, start, count, first, q)
    speed2 = dx * dx + dy * dy + 1e-12
    speed = math.sqrt(speed2)
    tx = dx / speed
    ty = dy / speed
    if along == 0.0:
        return ((x - px) * ty - (y - py) * tx) * across, 0.0, ty * across, -tx * across, 0.0, 0.0, 0.0, 0.0
    bend = (dx * ey - dy * ex) / speed2  # turning of the tangent per unit of q
    a = ((x - px) * ty - (y - py) * tx) * across
    b = ((x - px) * tx + (y - py) * ty) * along
    da = bend * b * (across / along)
    db = -bend * a * (along / across) - speed * along
    return a, b, ty * across, -tx * across, tx * along, ty * along, da, db


@inlined
def _across(points: Array, i: int, c: float, s: float, gx: float, gy: float) -> tuple[float, float]:
    """Return the part of a gradient across the surface that the beams around point `i` hit; all where they see none.

    `c` and `s` are of the association's heading, not of the pose: where the pose is turned wrongly by t, normals
    turned with it times residuals that grow by t on the way along a wall pull along it, by t squared.
    """
    if points[i, 4] == 0.0 and points[i, 5] == 0.0:
        return gx, gy
    nx = c * points[i, 4] - s * points[i, 5]
    ny = s * points[i, 4] + c * points[i, 5]
    g = gx * nx + gy * ny
    return g * nx, g * ny


@inlined
def _parameter(
    control: Array, start: int, count: int, first: int, shifted: float, near: float, x: float, y: float, along: float
) -> float:
    """Return where on its curve a point is compared: `shifted`, or nearest to it, from `near`, if `along` is 0."""
    if along > 0.0:
        return shifted
    q = near
    for _ in range(_FOOT):
        px, py, dx, dy, _, _ = place(control, start, count, first, q)
        q += min(max(((x - px) * dx + (y - py) * dy) / (dx * dx + dy * dy + 1e-12), -0.5), 0.5)
    return q


@kernel
def offset_of(
    control: Array, table: Array, step: float, points: Array, chord: Array, run: Array, feet: Array,
    runs: Array, j: int, pose: Array, across: float, along: float, loss: int, scale: float,
) -> float:  # fmt: skip
    """Return the offset of run `j` of least cost at `pose` [knot intervals], near the run's own."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    number = int(runs[j, 2])
    start, count, first = int(table[number, 0]), int(table[number, 1]), int(table[number, 2])
    o: float = runs[j, 3]
    if along == 0.0:
        return o
    for _ in range(_ITERATIONS):
        h = g = 0.0
        for i in range(int(runs[j, 0]), int(runs[j, 1])):
            if run[i] != j:
                continue
            x = pose[0] + c * points[i, 0] - s * points[i, 1]
            y = pose[1] + s * points[i, 0] + c * points[i, 1]
            q = _parameter(control, start, count, first, chord[i] / step + o, feet[i], x, y, along)
            a, b, _, _, _, _, da, db = _row(
                control, start, count, first, q, x, y, across, along
            )  # fmt: skip
            w = loss_terms(loss, a * a + b * b, scale)[1]
            h += w * (da * da + db * db)
            g += w * (da * a + db * b)
        if h <= 0.0:
            break
        d = min(max(-g / h, -1.0), 1.0)
        o += d
        if abs(d) < _SETTLED:
            break
    return o


@kernel
def normal_equations(
    control: Array, table: Array, step: float, points: Array, chord: Array, run: Array, feet: Array,
    runs: Array, pose: Array, heading: float, across: float, along: float, missing: float, n: int,
    weight: float, loss: int, scale: float, out: Array,
) -> float:  # fmt: skip
    """Fill `out` (4, 3): rows of H, then g; return the cost. `missing` is the residual of a point on no curve."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    turn_c = math.cos(heading)
    turn_s = math.sin(heading)
    H = np.zeros((3, 3))
    g = np.zeros(3)
    ja, jb = np.empty(3), np.empty(3)
    cross = np.empty(3)
    cost = used = 0.0
    for j in range(runs.shape[0]):
        trust = runs[j, 5]
        o = offset_of(
            control, table, step, points, chord, run, feet, runs, j, pose, across, along, loss, scale
        )  # fmt: skip
        number = int(runs[j, 2])
        start, count, first = int(table[number, 0]), int(table[number, 1]), int(table[number, 2])
        hoo = go = 0.0
        cross[:] = 0.0
        for i in range(int(runs[j, 0]), int(runs[j, 1])):
            if run[i] != j:
                continue
            rx = c * points[i, 0] - s * points[i, 1]
            ry = s * points[i, 0] + c * points[i, 1]
            q = _parameter(
                control, start, count, first, chord[i] / step + o, feet[i], pose[0] + rx, pose[1] + ry, along
            )
            a, b, ja[0], ja[1], jb[0], jb[1], da, db = _row(
                control, start, count, first, q, pose[0] + rx, pose[1] + ry, across, along
            )  # fmt: skip
            rho, w = loss_terms(loss, a * a + b * b, scale)
            cost += trust * rho
            used += trust
            w *= trust
            ja[0], ja[1] = _across(points, i, turn_c, turn_s, ja[0], ja[1])
            ja[2] = rx * ja[1] - ry * ja[0]
            jb[2] = rx * jb[1] - ry * jb[0]
            hoo += w * (da * da + db * db)
            go += w * (da * a + db * b)
            for k in range(3):
                cross[k] += w * (ja[k] * da + jb[k] * db)
                g[k] += w * (ja[k] * a + jb[k] * b)
                for m in range(k + 1):
                    H[k, m] += w * (ja[k] * ja[m] + jb[k] * jb[m])
        if hoo > 0.0:
            for k in range(3):
                g[k] -= cross[k] * go / hoo
                for m in range(k + 1):
                    H[k, m] -= cross[k] * cross[m] / hoo
    for k in range(3):
        out[3, k] = weight * g[k]
        for m in range(k + 1):
            out[k, m] = out[m, k] = weight * H[k, m]
    return weight * (cost + (n - used) * loss_terms(loss, missing * missing, scale)[0])


@kernel
def cost_of(
    control: Array, table: Array, step: float, points: Array, chord: Array, run: Array, feet: Array,
    runs: Array, pose: Array, across: float, along: float, missing: float, n: int,
    weight: float, loss: int, scale: float,
) -> float:  # fmt: skip
    """Return the cost at `pose`."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    cost = used = 0.0
    for j in range(runs.shape[0]):
        trust = runs[j, 5]
        o = offset_of(
            control, table, step, points, chord, run, feet, runs, j, pose, across, along, loss, scale
        )  # fmt: skip
        number = int(runs[j, 2])
        start, count, first = int(table[number, 0]), int(table[number, 1]), int(table[number, 2])
        for i in range(int(runs[j, 0]), int(runs[j, 1])):
            if run[i] != j:
                continue
            x = pose[0] + c * points[i, 0] - s * points[i, 1]
            y = pose[1] + s * points[i, 0] + c * points[i, 1]
            q = _parameter(control, start, count, first, chord[i] / step + o, feet[i], x, y, along)
            a, b, _, _, _, _, _, _ = _row(
                control, start, count, first, q, x, y, across, along
            )  # fmt: skip
            cost += trust * loss_terms(loss, a * a + b * b, scale)[0]
            used += trust
    return weight * (cost + (n - used) * loss_terms(loss, missing * missing, scale)[0])


@kernel
def jacobian(
    control: Array, table: Array, step: float, points: Array, chord: Array, run: Array, feet: Array,
    runs: Array, pose: Array, heading: float, across: float, along: float, missing: float, weight: float,
    residuals: Array, rows: Array,
) -> None:  # fmt: skip
    """Fill whitened residuals (3 n,) and their Jacobian (3 n, 3).

    For each point those across and along its curve, and what the curve lacks of full trust, a constant.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    turn_c = math.cos(heading)
    turn_s = math.sin(heading)
    factor = math.sqrt(weight)
    residuals[:] = 0.0
    residuals[::3] = factor * missing
    rows[:] = 0.0
    da = np.empty(residuals.shape[0])
    cross = np.empty(3)
    for j in range(runs.shape[0]):
        o = offset_of(control, table, step, points, chord, run, feet, runs, j, pose, across, along, 0, 1.0)
        number = int(runs[j, 2])
        start, count, first = int(table[number, 0]), int(table[number, 1]), int(table[number, 2])
        hoo = 0.0
        root = factor * math.sqrt(runs[j, 5])
        lack = factor * missing * math.sqrt(max(1.0 - runs[j, 5], 0.0))
        cross[:] = 0.0
        for i in range(int(runs[j, 0]), int(runs[j, 1])):
            if run[i] != j:
                continue
            rx = c * points[i, 0] - s * points[i, 1]
            ry = s * points[i, 0] + c * points[i, 1]
            q = _parameter(
                control, start, count, first, chord[i] / step + o, feet[i], pose[0] + rx, pose[1] + ry, along
            )
            a, b, ax, ay, bx, by, dao, dbo = _row(
                control, start, count, first, q, pose[0] + rx, pose[1] + ry, across, along
            )  # fmt: skip
            ax, ay = _across(points, i, turn_c, turn_s, ax, ay)
            residuals[3 * i] = root * a
            residuals[3 * i + 1] = root * b
            residuals[3 * i + 2] = lack
            for row, jx, jy, d in ((3 * i, ax, ay, dao), (3 * i + 1, bx, by, dbo)):
                rows[row, 0] = jx
                rows[row, 1] = jy
                rows[row, 2] = rx * jy - ry * jx
                da[row] = d
                hoo += d * d
                for k in range(3):
                    cross[k] += d * rows[row, k]
        for i in range(int(runs[j, 0]), int(runs[j, 1])):
            if run[i] == j:
                for row in (3 * i, 3 * i + 1):
                    for k in range(3):
                        eliminated = da[row] * cross[k] / hoo if hoo > 0.0 else 0.0
                        rows[row, k] = root * (rows[row, k] - eliminated)


@kernel
def discount(out: Array, floor: float) -> None:
    """Take from `out` (4, 3), rows of H, then g, what the weakest direction owes to errors of slope.

    Normals of the wall are known to an angle only, and residuals along a wall are alike from beam to beam and
    from scan to scan: of the information across a wall the share `floor`, the square of that angle, shows up
    along it and is none. With s the information along the weakest direction v and a that across it, both
    with the yaw eliminated, the Jacobian along v is scaled by the root of s / (s + floor a).
    """
    yaw = out[2, 2]
    if not yaw > 0.0 or floor <= 0.0:
        return
    xx = out[0, 0] - out[0, 2] * out[0, 2] / yaw
    xy = out[0, 1] - out[0, 2] * out[1, 2] / yaw
    yy = out[1, 1] - out[1, 2] * out[1, 2] / yaw
    d = 0.5 * (xx - yy)
    half = math.sqrt(d * d + xy * xy)
    strong = 0.5 * (xx + yy) + half
    weak = max(0.5 * (xx + yy) - half, 0.0)
    if not strong > 0.0:
        return
    if d > 0.0:
        vx, vy = -xy, half + d
    else:
        vx, vy = half - d, -xy
    size = math.hypot(vx, vy)
    if not size > 0.0:
        return
    vx /= size
    vy /= size
    kept = math.sqrt(weak / (weak + floor * strong))
    # T H T and T g, with T = 1 - (1 - kept) v v^T
    for row in range(4):
        along = (1.0 - kept) * (out[row, 0] * vx + out[row, 1] * vy)
        out[row, 0] -= along * vx
        out[row, 1] -= along * vy
    for column in range(3):
        along = (1.0 - kept) * (out[0, column] * vx + out[1, column] * vy)
        out[0, column] -= along * vx
        out[1, column] -= along * vy
