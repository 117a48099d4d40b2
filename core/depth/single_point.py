"""Controllers for one point that keep sigma^2 at its maximum while they servo it (section 9.1).

The camera always translates sideways, v_z = 0 and |v| = v_max, so sigma^2 = v_max^2. What is left is to
share the wanted image velocity pi between that translation and a rotation w = (w_x, w_y, 0):

    lambda_pi pi = chi J_v v + J_w w,  lambda_pi in [0, 1] as large as possible

With J_w w = lambda v2 for a chosen unit vector v2 this is Theorem 9.1 in closed form (Algorithm 9).
"""

import math

from knotwork.core.kernel import kernel
from knotwork.core.messages import F64

SPICA14, VARYING_DEPTH, CONSTANT_DEPTH = 0, 1, 2
NEAR_GOAL = 0.005  # |pi| below which rotating along pi would flip the camera's direction
_SHARE = 0.9  # of w_max that the translation may ask the rotation to undo


@kernel
def largest_share(
    px: float, py: float, vx: float, vy: float, r: float, b: float, lx: float, ly: float
) -> tuple[float, float]:
    """Solve Theorem 9.1: the largest lambda_1 in [0, 1] with |lambda_1 pi - lambda_2 v2| = r, |lambda_2| <= b.

    Parameters
    ----------
    px, py, vx, vy
        pi, and the unit vector v2.
    r, b
        Length of the remainder, 0 < r <= b, and bound of lambda_2.
    lx, ly
        Last direction of the remainder: of two solutions the nearer one is taken, because the smaller one
        would change sides at each sample near pi = 0 and nothing would be learnt. (0, 0): the smaller.

    Returns
    -------
    lambda_1, lambda_2
    """
    along = px * vx + py * vy
    across2 = max(px * px + py * py - along * along, 0.0)
    if across2 <= 1e-24 * along * along:
        across2 = 0.0
    if across2 <= r * r:
        root = math.sqrt(r * r - across2)
        first, second = along - root, along + root
        if abs(second) < abs(first):
            first, second = second, first
        one, two = abs(first) <= b * (1.0 + 1e-12), abs(second) <= b * (1.0 + 1e-12)
        if one and two and (lx != 0.0 or ly != 0.0):
            # The remainders differ along v2 only: pi - lambda v2.
            if (px - second * vx) * lx + (py - second * vy) * ly > (px - first * vx) * lx + (py - first * vy) * ly:
                return 1.0, second
            return 1.0, first
        if one:
            return 1.0, first
        if two:
            return 1.0, second
    else:
        share = r / math.sqrt(across2)
        if abs(share * along) <= b:
            return share, share * along
    side = b if along > 0.0 else -b
    size2 = px * px + py * py
    root = math.sqrt(max(side * side * along * along - size2 * (side * side - r * r), 0.0))
    return min((side * along + root) / size2, 1.0), side


@kernel
def single_point_command(
    variant: int, x: float, y: float, chi: float, px: float, py: float, v_max: float, w_max: float, near: float,
    memory: F64, u: F64,
) -> float:  # fmt: skip
    """Write the twist u (6,) for a point at (x, y) with inverse depth chi that should move with pi; return lambda_pi.

    `variant` is SPICA14 (fixed sideways direction, (9.2)), VARYING_DEPTH (J_l w <= 0, (9.3)-(9.32)) or
    CONSTANT_DEPTH (J_l w = 0, (9.33)-(9.35)). `memory` (2,) keeps the last image velocity of the translation;
    `near` is NEAR_GOAL.
    """
    u[:] = 0.0
    size = math.sqrt(x * x + y * y)
    ex, ey = (x / size, y / size) if size > 1e-9 else (1.0, 0.0)
    if variant == SPICA14:
        u[0] = v_max
        fx, fy = px + chi * v_max, py  # pi - chi J_v v, the flow that the rotation must give
        share = 1.0
    else:
        r = chi * v_max
        if r > _SHARE * w_max:
            r = _SHARE * w_max
        speed = math.sqrt(px * px + py * py)
        if variant == VARYING_DEPTH and speed > near and (speed - r) * (x * px + y * py) < 0.0:
            vx, vy = px / speed, py / speed  # (9.8): both along pi; J_l w has the sign of the condition
            turn = min(speed - r, w_max)
            share = min((turn + r) / speed, 1.0)
        else:
            vx, vy = -ey, ex  # (9.10): the rotation moves the point around the axis, J_l w = 0
            share, turn = largest_share(px, py, vx, vy, r, w_max, memory[0], memory[1])
        fx, fy = turn * vx, turn * vy
        tx, ty = share * px - fx, share * py - fy
        memory[0], memory[1] = tx, ty
        # |t| = r but for rounding; the speed must not exceed its bound
        speed = min(r / chi, v_max) / max(math.sqrt(tx * tx + ty * ty), 1e-300)
        u[0], u[1] = -tx * speed, -ty * speed
    # J_w w = f, by the columns (1 + |s|^2) s/|s| and s_perp/|s| of J_w S
    radial = (ex * fx + ey * fy) / (1.0 + size * size)
    around = -ey * fx + ex * fy
    u[3] = radial * ey + around * ex
    u[4] = -radial * ex + around * ey
    rate = math.sqrt(u[3] * u[3] + u[4] * u[4])
    if rate > w_max * (1.0 - 1e-15):  # rounding is the caller's too
        u[3] *= w_max * (1.0 - 4e-16) / rate
        u[4] *= w_max * (1.0 - 4e-16) / rate
    rate = math.sqrt(u[0] * u[0] + u[1] * u[1])
    if rate > v_max * (1.0 - 1e-15):
        u[0] *= v_max * (1.0 - 4e-16) / rate
        u[1] *= v_max * (1.0 - 4e-16) / rate
    return share


@kernel
def circle_goal(time: float, cx: float, cy: float, radius: float, period: float, goal: F64, rate: F64) -> None:
    """Write the goal point (2,) on a circle of the image and its velocity (2,) at `time` [s]; radius 0 stands."""
    angle = 2.0 * math.pi * time / period
    goal[0] = cx + radius * math.cos(angle)
    goal[1] = cy + radius * math.sin(angle)
    rate[0] = -radius * math.sin(angle) * 2.0 * math.pi / period
    rate[1] = radius * math.cos(angle) * 2.0 * math.pi / period
