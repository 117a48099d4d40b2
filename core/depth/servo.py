"""Visual servoing that keeps depth observable: the controller (9.46), (9.47) for many points.

    minimise |lambda e + L u|^2  over u = (v, w)
    subject to |v| <= v_max, |w| <= w_max
               J_l(s_i) w <= b_i,  v_z <= c          (active: conditions 1 and 2 of Theorem 8.2, relaxed)
               d^T v_xy >= beta v_max                 (active+: condition 3, while a point is not released)

The two balls make it a second-order cone program. `solve_cone` is a primal-dual interior-point method
(Mehrotra's predictor and corrector) with the balls as quadratic constraints; the norms hold exactly, the
rows to `ROW_SLACK`.
"""

import math

import numpy as np

from knotwork.core.kernel import kernel
from knotwork.core.messages import F64

ROW_SLACK = 1e-9  # of w_max |s_i|: gives the cone J_l w <= 0 an inside even where it is the point w = 0
_ITERATIONS = 60  # a safeguard, 10 to 20 are usual
_REDUNDANT = 1.0 - 1e-9
_LONGEST = 0.3  # radii; a longer step no longer sees the balls as they are
_GAP, _RESIDUAL, _COARSE = 1e-12, 1e-10, 1e-7
_LEAST_GAP = 1e-14  # aiming closer than this only loses digits
# Of the largest entry of H: one or two points leave directions that cost nothing. Rounding may ask for more.
_PROXIMAL = (1e-11, 1e-8, 1e-5)


@kernel
def servo_terms(s: F64, chi: F64, goal: F64, gain: float, hessian: F64, gradient: F64) -> float:
    """Write L^T L (6, 6) and L^T lambda e (6,) for points s (n, 2); return |e| of the stacked error (2n,)."""
    hessian[:] = 0.0
    gradient[:] = 0.0
    row = np.empty(6)
    total = 0.0
    for i in range(chi.shape[0]):
        x, y = s[i, 0], s[i, 1]
        for k in range(2):
            if k == 0:
                row[0], row[1], row[2] = -chi[i], 0.0, chi[i] * x
                row[3], row[4], row[5] = x * y, -(1.0 + x * x), y
            else:
                row[0], row[1], row[2] = 0.0, -chi[i], chi[i] * y
                row[3], row[4], row[5] = 1.0 + y * y, -x * y, -x
            e = s[i, k] - goal[i, k]
            total += e * e
            for a in range(6):
                gradient[a] += gain * e * row[a]
                for b in range(6):
                    hessian[a, b] += row[a] * row[b]
    return math.sqrt(total)


@kernel
def relaxed_bounds(s: F64, rho: F64, v_max: float, w_max: float, bounds: F64) -> float:
    """Write b_i = rho_i w_max |s_i| [rad/s] (n,) and return c = v_max min rho_i [m/s] (9.42)-(9.45)."""
    least = 1.0
    for i in range(rho.shape[0]):
        bounds[i] = rho[i] * w_max * math.sqrt(s[i, 0] ** 2 + s[i, 1] ** 2)
        least = min(least, rho[i])
    return least * v_max


@kernel
def excitation_direction(s: F64, goal: F64, last: F64, direction: F64) -> None:
    """Write d (2,): the direction of the last lateral velocity `last` (2,), at the start that of the mean error."""
    x, y = last[0], last[1]
    if x == 0.0 and y == 0.0:
        for i in range(s.shape[0]):
            x += s[i, 0] - goal[i, 0]
            y += s[i, 1] - goal[i, 1]
    size = math.sqrt(x * x + y * y)
    if size < 1e-12:
        x, y, size = 1.0, 0.0, 1.0
    direction[0] = x / size
    direction[1] = y / size


@kernel
def servo_problem(
    s: F64,
    chi: F64,
    goal: F64,
    rho: F64,
    released: F64,
    lateral: F64,
    gain: float,
    v_max: float,
    w_max: float,
    beta: float,
    hessian: F64,
    gradient: F64,
    bounds: F64,
    direction: F64,
) -> tuple[float, float, float]:
    """Set up the controller's program for the points in view.

    Parameters
    ----------
    s, chi, goal, rho
        Image points (n, 2), inverse depths (n,), goal points (n, 2), certainty (n,).
    released
        1 for each point (n,) that has once been certain (rho = 1): a latch, updated here.
    lateral
        Lateral velocity (2,) of the last command; sets d.
    gain, v_max, w_max, beta
        lambda [1/s], radii [m/s, rad/s], share of v_max that condition 3 asks for (negative: no such row).
    hessian, gradient, bounds, direction
        Outputs (6, 6), (6,), (n,), (2,).

    Returns
    -------
    error, v_z_bound, least
        Norm of the stacked error, c, and beta if a point is not released yet, else -1.
    """
    error = servo_terms(s, chi, goal, gain, hessian, gradient)
    v_z_bound = relaxed_bounds(s, rho, v_max, w_max, bounds)
    excitation_direction(s, goal, lateral, direction)
    least = -1.0
    for i in range(rho.shape[0]):
        if rho[i] >= 1.0:
            released[i] = 1.0
        if released[i] == 0.0:
            least = beta
    return error, v_z_bound, least


@kernel
def _cholesky_solve(matrix: F64, rhs: F64, n: int) -> bool:
    """Solve in place for a symmetric positive definite matrix; False if it is not."""
    for j in range(n):
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        if not matrix[j, j] > 0.0:
            return False
        matrix[j, j] = math.sqrt(matrix[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= matrix[j, j]
    for i in range(n):
        for k in range(i):
            rhs[i] -= matrix[i, k] * rhs[k]
        rhs[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            rhs[i] -= matrix[k, i] * rhs[k]
        rhs[i] /= matrix[i, i]
    return True


@kernel
def _into_ball(u: F64, first: int, radius: float) -> None:
    """Scale three components so that their norm does not exceed `radius`, also after rounding."""
    size = math.sqrt(u[first] ** 2 + u[first + 1] ** 2 + u[first + 2] ** 2)
    if size > radius * (1.0 - 1e-15):
        for a in range(first, first + 3):
            u[a] *= radius * (1.0 - 4e-16) / size


@kernel
def _attempt(
    hessian: F64,
    gradient: F64,
    rows: F64,
    bounds: F64,
    v_z_bound: float,
    direction: F64,
    least: float,
    v_max: float,
    w_max: float,
    proximal: float,
    u: F64,
) -> bool:
    """Do what `solve_cone` does, with `proximal` times the largest entry of H added to its diagonal."""
    n = rows.shape[0]
    # In units of the radii: constraints 0 and 1 are the balls (|u|^2 - 1)/2 <= 0, the others a^T u <= limit.
    normal = np.zeros((n + 4, 6))
    limit = np.empty(n + 4)
    m = 2
    for i in range(n):
        size = math.sqrt(rows[i, 0] ** 2 + rows[i, 1] ** 2)
        # A bound of w_max |s| or more says nothing that the ball does not say.
        if size > 1e-9 and bounds[i] < w_max * size * _REDUNDANT:
            normal[m, 3] = rows[i, 1] / size
            normal[m, 4] = -rows[i, 0] / size
            limit[m] = bounds[i] / (w_max * size) + ROW_SLACK
            m += 1
    if v_z_bound < v_max:
        normal[m, 2] = 1.0
        limit[m] = v_z_bound / v_max
        m += 1
    if least >= 0.0:
        normal[m, 0] = -direction[0]
        normal[m, 1] = -direction[1]
        limit[m] = -least
        m += 1
    h = np.empty((6, 6))
    g = np.empty(6)
    scale = 0.0
    for a in range(6):
        ra = v_max if a < 3 else w_max
        g[a] = gradient[a] * ra
        for b in range(6):
            h[a, b] = hessian[a, b] * ra * (v_max if b < 3 else w_max)
            scale = max(scale, abs(h[a, b]))
        scale = max(scale, abs(g[a]))
    u[:] = 0.0
    if not math.isfinite(scale):
        return False
    if scale == 0.0:
        scale = 1.0
    for a in range(6):
        g[a] /= scale
        for b in range(6):
            h[a, b] /= scale
        h[a, a] += proximal
    slack = np.ones(m)
    dual = np.ones(m)
    d_slack = np.zeros(m)
    d_dual = np.zeros(m)
    primal = np.empty(m)
    push = np.empty(m)
    matrix = np.empty((6, 6))
    factor = np.empty((6, 6))
    residual = np.empty(6)
    step = np.empty(6)
    for iteration in range(_ITERATIONS):
        for i in range(2):
            for a in range(3 * i, 3 * i + 3):
                normal[i, a] = u[a]
        gap = 0.0
        worst = 0.0
        for i in range(m):
            along = 0.0
            for a in range(6):
                along += normal[i, a] * u[a]
            primal[i] = (0.5 * (along - 1.0) if i < 2 else along - limit[i]) + slack[i]
            worst = max(worst, abs(primal[i]))
            gap += slack[i] * dual[i]
        gap /= m
        for a in range(6):
            residual[a] = g[a]
            for b in range(6):
                residual[a] += h[a, b] * u[b]
                matrix[a, b] = h[a, b]
            matrix[a, a] += dual[a // 3]
            for i in range(m):
                residual[a] += dual[i] * normal[i, a]
            worst = max(worst, abs(residual[a]))
        if gap < _GAP and (worst < _RESIDUAL or (worst < _COARSE and iteration > _ITERATIONS // 2)):
            for a in range(6):
                u[a] *= v_max if a < 3 else w_max
            _into_ball(u, 0, v_max)
            _into_ball(u, 3, w_max)
            return True
        for i in range(m):
            ratio = dual[i] / slack[i]
            for a in range(6):
                if normal[i, a] != 0.0:
                    for b in range(6):
                        matrix[a, b] += ratio * normal[i, a] * normal[i, b]
        # Mehrotra: first straight for the optimum, then centred by how far that got, with its curvature.
        centre = 0.0
        length = 1.0
        for phase in range(2):
            for i in range(m):
                push[i] = (
                    (centre - d_slack[i] * d_dual[i] * phase) / slack[i] - dual[i] + dual[i] * primal[i] / slack[i]
                )
            for a in range(6):
                step[a] = -residual[a]
                for i in range(m):
                    step[a] -= normal[i, a] * push[i]
                for b in range(6):
                    factor[a, b] = matrix[a, b]
            if not _cholesky_solve(factor, step, 6):
                u[:] = 0.0
                return False
            length = 1.0
            for i in range(m):
                along = 0.0
                for a in range(6):
                    along += normal[i, a] * step[a]
                d_slack[i] = -primal[i] - along
                d_dual[i] = push[i] + dual[i] * along / slack[i]
                if d_slack[i] < 0.0:
                    length = min(length, -slack[i] / d_slack[i])
                if d_dual[i] < 0.0:
                    length = min(length, -dual[i] / d_dual[i])
            if phase == 0:
                reached = 0.0
                for i in range(m):
                    reached += (slack[i] + length * d_slack[i]) * (dual[i] + length * d_dual[i])
                centre = max(gap * (reached / m / gap) ** 3, _LEAST_GAP)
        size = 0.0
        for i in range(2):
            size = max(size, step[3 * i] ** 2 + step[3 * i + 1] ** 2 + step[3 * i + 2] ** 2)
        length = min(1.0, 0.99 * length, _LONGEST / math.sqrt(size + 1e-300))
        for a in range(6):
            u[a] += length * step[a]
        for i in range(m):
            slack[i] += length * d_slack[i]
            dual[i] += length * d_dual[i]
    u[:] = 0.0
    return False


@kernel
def solve_cone(
    hessian: F64,
    gradient: F64,
    rows: F64,
    bounds: F64,
    v_z_bound: float,
    direction: F64,
    least: float,
    v_max: float,
    w_max: float,
    u: F64,
) -> bool:
    """Minimise u^T H u / 2 + g^T u over the balls and half-spaces; write u (6,).

    Parameters
    ----------
    hessian, gradient
        H (6, 6) positive semi-definite and g (6,).
    rows, bounds
        Image points s (n, 2) and b (n,) >= 0 of the rows J_l(s) w <= b; n = 0 for none.
    v_z_bound
        c >= 0 of v_z <= c; infinite for none.
    direction, least
        Unit vector d (2,) and 0 <= beta < 1 of d^T v_xy >= beta v_max; beta < 0 for none.
    v_max, w_max
        Radii [m/s, rad/s].

    Returns
    -------
    bool
        False if a number was not finite or the method did not converge; u is then 0.
    """
    for proximal in _PROXIMAL:
        if _attempt(hessian, gradient, rows, bounds, v_z_bound, direction, least, v_max, w_max, proximal, u):
            return True
    return False
