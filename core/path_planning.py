"""Smooth paths among obstacles: a B-spline whose pieces provably keep clear, by the convex hull property.

Each piece of a B-spline lies in the convex hull of the degree + 1 control points that act on it. If a
line separates those from an obstacle, the piece cannot touch it, at any parameter, not only at samples.
The path is the smoothest one (least integral of squared second derivative, a little length added) under
such lines, found by a sequence of quadratic programs: lines are drawn between obstacles and the path so
far, the program is solved, lines are drawn anew. While the path still cuts through something the lines
push with growing force; once it is clear they bind, the path so far satisfies them and the cost falls.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.obstacle import Obstacle
from knotwork.core.splines import Curve, UniformBasis

__all__ = ["Obstacle", "clearance_of", "plan_path"]

F64 = NDArray[np.float64]


def plan_path(
    route: ArrayLike,
    obstacles: Sequence[Obstacle],
    clearance: float,
    *,
    spacing: float = 0.4,
    length_weight: float = 0.05,
    iterations: int = 25,
) -> Curve:
    """Return the smoothest cubic path near `route` that keeps `clearance` from all obstacles.

    Parameters
    ----------
    route
        Points (k, 2) [m] from start to goal, a rough way: it says on which side of obstacles to pass.
        It may cut through them.
    obstacles
        What to avoid.
    clearance
        Least distance [m] between the path and any obstacle: robot radius and margin.
    spacing
        Distance [m] of knots along the route; the parameter runs 0, spacing, 2 spacing, ... : about a length.
    length_weight
        Factor [1/m^2] of the integral of the squared first derivative against that of the second.
    iterations
        Quadratic programs at most.

    Raises
    ------
    InputError
        For a route of another shape, or whose ends are nearer than `clearance` to an obstacle.
    KnotworkError
        If no path on these sides of the obstacles exists with this spacing.
    """
    way = np.asarray(route, np.float64)
    if way.ndim != 2 or way.shape[1] != 2 or len(way) < 2 or not np.isfinite(way).all():
        raise InputError(f"route of shape {way.shape}: expected finite points (k, 2), k > 1")
    shapes = [Obstacle(np.asarray(o.points, np.float64).reshape(-1, 2), o.radius + clearance) for o in obstacles]
    for end in (way[:1], way[-1:]):
        for given, grown in zip(obstacles, shapes, strict=True):
            if _separation(end, grown.points)[0] < grown.radius:
                raise InputError(
                    f"the route's end {end[0].tolist()} is nearer than {clearance} m to an obstacle",
                    hint=f"obstacle {np.asarray(given.points).tolist()}",
                )
    curve = _along(way, spacing)
    penalty = _penalty(curve, length_weight)
    best, best_cost, push = None, np.inf, 10.0
    for _ in range(iterations):
        rows, right = _lines(curve, shapes, reach=4 * spacing)
        control = _solve(curve, penalty, way, rows, right, push if best is None else np.inf)
        if control is None:
            break
        curve = Curve(control, curve.basis)
        cost = float(np.sum(control.T @ penalty * control.T))
        if clearance_of(curve, shapes) < -1e-7:
            push *= 4.0
            if best is not None:  # into an obstacle that was out of reach before
                break
        elif cost > best_cost * (1 - 1e-4):
            break
        else:
            best, best_cost = curve, cost
    if best is None:
        raise KnotworkError(
            "no path on these sides of the obstacles",
            hint="give a route around them, a shorter spacing or less clearance",
        )
    return best


def clearance_of(curve: Curve, obstacles: Sequence[Obstacle]) -> float:
    """Return a distance [m] that the whole path certainly keeps from all obstacles (from the hulls, not samples)."""
    hulls = _hulls(curve)
    least = np.inf
    for hull, bounds in zip(hulls, _bounds(hulls, obstacles), strict=True):
        for o, bound in zip(obstacles, bounds.tolist(), strict=True):
            if bound < least:
                gap = _separation(hull, np.asarray(o.points, np.float64).reshape(-1, 2))[0] - o.radius
                least = min(least, gap)
    return least


def _along(way: F64, spacing: float) -> Curve:
    """Return a curve whose control points stand evenly along the route."""
    keep = np.concatenate(([True], np.linalg.norm(np.diff(way, axis=0), axis=1) > 0))
    way = way[keep]
    reached = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))))
    pieces = max(int(np.ceil(reached[-1] / spacing)), 3)
    wanted = np.linspace(0, reached[-1], pieces + 1)
    places = np.stack([np.interp(wanted, reached, column) for column in way.T], axis=1)
    before, after = 2 * places[0] - places[1], 2 * places[-1] - places[-2]
    step = float(wanted[1])
    return Curve(np.vstack((before, places, after)), UniformBasis(3, -3 * step, step))


def _penalty(curve: Curve, length_weight: float) -> F64:
    n = len(curve.control)
    return np.asarray((curve.basis.gram(n, 2) + length_weight * curve.basis.gram(n, 1)).toarray())


def _hulls(curve: Curve) -> F64:
    """Return the control points of each piece (pieces, 4, 2)."""
    return np.lib.stride_tricks.sliding_window_view(curve.control, 4, axis=0).transpose(0, 2, 1)


def _lines(curve: Curve, shapes: list[Obstacle], reach: float) -> tuple[F64, F64]:
    """Return rows G and h of the conditions G x >= h on control points x = (x0, y0, x1, y1, ...)."""
    rows, right = [], []
    n = curve.control.size
    hulls = _hulls(curve)
    near = _bounds(hulls, shapes) <= reach
    for first, hull in enumerate(hulls):
        for shape in (shapes[k] for k in np.flatnonzero(near[first])):
            gap, normal = _separation(hull, shape.points)
            if gap > shape.radius + reach:
                continue
            if gap <= 0:  # the route cuts through: push the piece out on the side where most of it is
                aside = hull.mean(axis=0) - shape.points.mean(axis=0)
                along = hull[-1] - hull[0]
                left = np.array([-along[1], along[0]])
                side = left if aside @ left >= 0 else -left
                normal = side / max(float(np.linalg.norm(side)), 1e-12)
            least = (shape.points @ normal).max() + shape.radius
            for k in range(4):
                row = np.zeros(n)
                row[2 * (first + k) : 2 * (first + k) + 2] = normal
                rows.append(row)
                right.append(least)
    return np.array(rows).reshape(-1, n), np.array(right)


def _bounds(hulls: F64, shapes: Sequence[Obstacle]) -> F64:
    """Return lower bounds (pieces, shapes) of the distances of hulls from shapes: from circles about both."""
    points = [np.asarray(shape.points, np.float64).reshape(-1, 2) for shape in shapes]
    middles = np.array([p.mean(axis=0) for p in points]).reshape(-1, 2)
    sizes = np.array([np.linalg.norm(p - p.mean(axis=0), axis=1).max() for p in points])
    sizes += np.array([shape.radius for shape in shapes])
    centres = hulls.mean(axis=1)
    spans = np.linalg.norm(hulls - centres[:, None], axis=2).max(axis=1)
    apart = np.linalg.norm(centres[:, None] - middles, axis=2)
    return np.asarray(apart - spans[:, None] - sizes)


def _separation(a: F64, b: F64) -> tuple[float, F64]:
    """Return the distance of the hulls of two point sets and the unit normal from b to a; not above 0 if they meet."""
    best, normal = np.inf, np.array([1.0, 0.0])
    for one, other, sign in ((a, b, 1.0), (b, a, -1.0)):
        starts, ends = (
            grid.reshape(-1, 2) for grid in (np.repeat(other, len(other), 0), np.tile(other, (len(other), 1)))
        )
        edge = ends - starts
        square = np.maximum(np.sum(edge**2, axis=1), 1e-300)
        share = np.clip(np.einsum("pec,ec->pe", one[:, None] - starts, edge) / square, 0.0, 1.0)
        gap = one[:, None] - (starts + share[..., None] * edge)
        distance = np.linalg.norm(gap, axis=2)
        p, e = np.unravel_index(distance.argmin(), distance.shape)
        if 0 < distance[p, e] < best:
            best, normal = float(distance[p, e]), sign * gap[p, e] / distance[p, e]
    return float((a @ normal).min() - (b @ normal).max()), normal


def _solve(curve: Curve, penalty: F64, way: F64, rows: F64, right: F64, push: float) -> F64 | None:
    """Return the control points of least penalty with the route's ends and rows @ x >= right; None if there are none.

    With a finite `push` what is missing to the conditions costs push times its square instead.
    Least distance programming (Lawson and Hanson, chapter 23): the ends are eliminated, the penalty
    becomes a length, its dual is a non-negative least-squares problem.
    """
    from scipy.linalg import null_space, solve_triangular
    from scipy.optimize import nnls

    n = len(curve.control)
    ends = np.zeros((4, 2 * n))
    for k, first in enumerate((0, n - 3)):  # at a knot the three control points weigh 1/6, 4/6, 1/6
        for axis in range(2):
            ends[2 * k + axis, 2 * first + axis : 2 * first + 6 : 2] = (1 / 6, 4 / 6, 1 / 6)
    fixed = np.linalg.lstsq(ends, np.concatenate((way[0], way[-1])), rcond=None)[0]
    free = null_space(ends)
    full = np.kron(penalty, np.eye(2))
    hessian = free.T @ full @ free
    root = np.linalg.cholesky(hessian + 1e-12 * np.trace(hessian) * np.eye(len(hessian)))
    shift = solve_triangular(root, free.T @ (full @ fixed), lower=True)  # cost |z|^2 with z = root^T y + shift
    z = np.zeros(len(hessian))
    if len(rows):
        g = solve_triangular(root, (rows @ free).T, lower=True).T
        h = right - rows @ fixed + g @ shift
        scale = max(float(np.abs(h).max()), 1e-9)
        slack = np.eye(len(rows)) / np.sqrt(push)
        system = np.vstack((g.T, slack, h / scale)) if np.isfinite(push) else np.vstack((g.T, h / scale))
        target = np.zeros(len(system))
        target[-1] = 1.0
        try:
            dual, norm = nnls(system, target, maxiter=50 * system.shape[1])
        except RuntimeError:
            return None
        residual = system @ dual - target
        if norm < 1e-9 or abs(residual[-1]) < 1e-12:
            return None
        z = -scale * residual[: len(z)] / residual[-1]
    y = solve_triangular(root.T, z - shift, lower=False)
    return np.asarray((fixed + free @ y).reshape(n, 2))
