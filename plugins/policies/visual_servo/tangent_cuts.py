"""The servo program by any QP solver of qpsolvers: each ball is a tangent plane, moved until the ball holds.

Planes alone come near a ball slowly, and a solver of first order, such as OSQP, is slow where planes are
nearly parallel or the cost nearly flat. So each round also

- gives the cost the curvature of each ball, times the multiplier of its plane in the last round: sequential
  quadratic programming, whose rounds converge quadratically and need one plane for each ball;
- works in coordinates in which that cost is |y|^2 / 2;
- has of the rows J_l(s_i) w <= b_i only those that bound the polygon of (w_x, w_y); a polygon without an inside,
  as four corners of a centred square make it, becomes equations.
"""

import warnings
from importlib import import_module
from typing import Any

import numpy as np

from knotwork.core.messages import F64
from knotwork.plugins.policies.visual_servo.program import Program

_ROUNDS = 25  # 1 to 5 are usual
_TIGHT = 1e-6  # radii; by so much a ball may still be left, before the answer is scaled into it
_STILL = 1e-9  # of the largest entry of H and g
_SLACK = 1e-9  # radii; keeps the origin inside the polygon when rounding
_FLAT = 1e-6  # radii; a polygon of less width has no inside
_THIN = 0.05  # radii; with nearly parallel sides some solvers do not end: then one of less width is its diagonal
_BALLS = (slice(0, 3), slice(3, 6))
# (thinnest polygon taken as it is, tolerance of a first-order solver) of the first attempt and, if it fails, the next.
_ATTEMPTS = ((_FLAT, 1e-7), (_THIN, 5e-7))
# Of solvers that are not exact by themselves. OSQP's iterations are for all rounds of an attempt: 10 to 15 ms. Its rho
# is adapted after a number of iterations: after a share of the time, as it may do it, a run would not repeat itself.
_FIRST_ORDER: dict[str, dict[str, float]] = {
    "osqp": {"max_iter": 30000, "rho": 1.0, "alpha": 1.8, "adaptive_rho_interval": 200},
    "qpalm": {"max_iter": 1000},
    "scs": {"max_iters": 5000},
}


class TangentCuts:
    """A QP solver by its name in qpsolvers.

    Raises
    ------
    ImportError
        qpsolvers is not installed.
    ValueError
        It has no such solver here.
    """

    def __init__(self, name: str) -> None:
        self._module: Any = import_module("qpsolvers")
        if name not in self._module.available_solvers:
            found = ", ".join(self._module.available_solvers) or "none"
            raise ValueError(f"qpsolvers has no solver {name!r} here; it has: {found}")
        self._name = name
        takes_sparse = name not in self._module.dense_solvers
        self._matrix: Any = import_module("scipy.sparse").csc_matrix if takes_sparse else np.asarray

    def __call__(self, program: Program) -> F64 | None:
        """Solve one program; u (6,) is in units of the radii and holds the balls and all rows to 1e-6."""
        answers = (self._rounds(program, thin, tolerance) for thin, tolerance in _ATTEMPTS)
        return next((u for u in answers if u is not None), None)

    def _rounds(self, program: Program, thin: float, tolerance: float) -> F64 | None:
        hessian, gradient = program.scaled()
        if not (np.isfinite(hessian).all() and np.isfinite(gradient).all()):
            return None
        rows, limits, equal, level = _half_spaces(program, thin)
        options: dict[str, float] = {}
        if self._name in _FIRST_ORDER:
            options = _FIRST_ORDER[self._name] | {"eps_abs": tolerance, "eps_rel": tolerance}
        planes: dict[int, F64] = {}  # unit normal (3,) of the tangent plane of a ball
        multipliers = [0.0, 0.0]
        for _ in range(_ROUNDS):
            curved, slope = hessian.copy(), gradient.copy()
            tangents = np.zeros((len(planes), 6))
            for row, (k, plane) in zip(tangents, planes.items(), strict=True):
                row[_BALLS[k]] = plane
                curved[_BALLS[k], _BALLS[k]] += multipliers[k] * np.eye(3)
                slope[_BALLS[k]] -= multipliers[k] * plane
            ends = np.concatenate((np.ones(len(planes)), limits))
            answer = self._solve(curved, slope, np.vstack((tangents, rows)), ends, equal, level, options)
            if answer is None:
                return None
            u, dual = answer
            wrong = 0.0  # gradient that the curvature of the last round adds at this answer
            for i, (k, plane) in enumerate(planes.items()):
                now = max(0.0, float(dual[i]))
                wrong = max(wrong, abs(now - multipliers[k]) * float(np.linalg.norm(u[_BALLS[k]] - plane)))
                multipliers[k] = now
            lengths = [float(np.linalg.norm(u[ball])) for ball in _BALLS]
            if max(lengths) <= 1.0 + _TIGHT and wrong <= _STILL:
                return u
            for k, length in enumerate(lengths):
                if length > 1.0 + _TIGHT or (k in planes and multipliers[k] > 0.0):
                    planes[k] = u[_BALLS[k]] / length
        return None

    def _solve(
        self, hessian: F64, gradient: F64, rows: F64, limits: F64, equal: F64, level: F64, options: dict[str, float]
    ) -> tuple[F64, F64] | None:
        """Return the answer of one QP and the multipliers of its rows; OSQP's iterations are taken off `options`."""
        # u = T y with T^T H T = 1; y in units of the distance to the free optimum, so that tolerances are relative.
        whole = np.linalg.inv(np.linalg.cholesky(hessian)).T
        slope = whole.T @ gradient
        reach = max(float(np.linalg.norm(slope)), 1e-300)
        problem = self._module.Problem(
            self._matrix(np.eye(6)),
            slope / reach,
            self._matrix(rows @ whole * reach),
            limits,
            self._matrix(equal @ whole * reach) if len(level) else None,
            level if len(level) else None,
        )
        try:
            with warnings.catch_warnings():  # "solved inaccurate" is not found
                warnings.simplefilter("ignore")
                solution = self._module.solve_problem(problem, solver=self._name, **options)
        except (ArithmeticError, RuntimeError, ValueError, self._module.exceptions.QPError):
            return None  # some solvers raise where others find nothing
        if self._name == "osqp":
            options["max_iter"] = max(1, options["max_iter"] - int(solution.extras["info"].iter))
        if not solution.found or solution.x is None or solution.z is None or not np.isfinite(solution.x).all():
            return None
        return whole @ solution.x * reach, solution.z * reach**2


def _half_spaces(program: Program, thin: float) -> tuple[F64, F64, F64, F64]:
    """Return A (k, 6), b (k,) of A u <= b, and the same of equations: all but the balls, which are in a box."""
    rows, limits = program.planes()
    size = np.linalg.norm(rows, axis=1)
    useful = (size > 1e-9) & (limits < size)  # the ball says more than a row with a larger limit
    rows, limits = rows[useful] / size[useful, None], limits[useful] / size[useful]
    pan = (rows[:, 3:5] != 0.0).any(axis=1)
    sides, ends, equal, level = polygon_sides(rows[pan, 3:5], limits[pan], thin)
    box = np.vstack((np.eye(6), -np.eye(6)))
    return (
        np.vstack((rows[~pan], _of_pan(sides), box)),
        np.concatenate((limits[~pan], ends, np.ones(12))),
        _of_pan(equal),
        level,
    )


def _of_pan(rows: F64) -> F64:
    out = np.zeros((len(rows), 6))
    out[:, 3:5] = rows
    return out


def polygon_sides(rows: F64, limits: F64, thin: float) -> tuple[F64, F64, F64, F64]:
    """Return those of the half-planes a^T p <= b that bound their intersection with the square |p_x|, |p_y| <= 1.

    Parameters
    ----------
    rows, limits
        Unit vectors (n, 2) and numbers >= 0 (n,): the origin is inside.
    thin
        An intersection of no more than this width is replaced by its longest diagonal.

    Returns
    -------
    sides, ends, equal, level
        Half-planes (k, 2), (k,) and, of a diagonal or a point, equations (m, 2), (m,).
    """
    corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
    owners = [-1] * 4  # which half-plane the side after a corner lies on
    for i, ((x, y), limit) in enumerate(zip(rows.tolist(), limits.tolist(), strict=True)):
        over = [x * p + y * q - limit - _SLACK for p, q in corners]
        if max(over) <= 0.0:
            continue
        cut, cut_owners = [], []
        for j, (p, q) in enumerate(corners):
            k = (j + 1) % len(corners)
            if over[j] <= 0.0:
                cut.append((p, q))
                cut_owners.append(owners[j])
            if (over[j] <= 0.0) != (over[k] <= 0.0):
                share = over[j] / (over[j] - over[k])
                cut.append((p + share * (corners[k][0] - p), q + share * (corners[k][1] - q)))
                cut_owners.append(i if over[j] <= 0.0 else owners[j])
        corners, owners = cut, cut_owners
    none = np.zeros((0, 2))
    points = np.array(corners)
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    first, second = np.unravel_index(distances.argmax(), distances.shape)
    length = distances[first, second]
    if length <= _FLAT:
        return none, none[:, 0], np.eye(2), points[first]
    along = (points[second] - points[first]) / length
    across = np.array((-along[1], along[0]))
    if float(np.ptp(points @ across)) > thin:
        kept = sorted({owner for owner in owners if owner >= 0})
        return rows[kept], limits[kept], none, none[:, 0]
    ends = np.array((along @ points[second], -along @ points[first]))
    return np.vstack((along, -along)), ends, across[None], across[None] @ points[first]
