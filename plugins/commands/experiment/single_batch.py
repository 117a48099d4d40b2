"""One single-point run (section 9.3.1) as a compiled loop over the kernels that the plugins call."""

import numpy as np

from knotwork.core.camera import move_points, rigid_step
from knotwork.core.depth.observer import fixed_gain_step
from knotwork.core.depth.single_point import NEAR_GOAL, circle_goal, single_point_command
from knotwork.core.kernel import kernel
from knotwork.core.messages import F64

COLUMNS = (
    "time",
    "x",
    "y",
    "goal_x",
    "goal_y",
    "error",
    "chi",
    "chi_hat",
    "sigma2",
    "J_l w",
    "v_x",
    "v_y",
    "w_x",
    "w_y",
    "w_z",
)


@kernel
def run_single(
    variant: int,
    point: F64,
    guess: float,
    circle: F64,
    gain: float,
    feed_forward: bool,
    printed: bool,
    gains: F64,
    h: float,
    limits: F64,
    noise: F64,
    table: F64,
) -> None:
    """Fill `table` (K+1, 15), a row a frame, columns as in `COLUMNS`.

    Parameters
    ----------
    variant
        As of `single_point_command`.
    point, guess
        The point (3,) [m] in the first camera frame; guessed inverse depth [1/m].
    circle, gain, feed_forward
        Goal: centre, radius and period [s] (4,); k_p [1/s]; whether pi contains the goal's velocity.
    printed
        Algorithm 9 as printed: always the smaller root, both branches up to pi = 0.
    gains, h, limits
        (k_s, k_chi, sigma^2 floor); step [s]; (v_max, w_max).
    noise
        Added to the measured image (K+1, 2).
    """
    points = point.copy().reshape(1, 3)
    measured = np.empty((1, 2))
    before = np.empty((1, 2))
    s_hat = np.empty((1, 2))
    chi = np.full(1, guess)
    seen = np.ones(1)
    memory = np.zeros(2)
    goal, rate = np.empty(2), np.empty(2)
    u = np.zeros(6)
    rotation, shift = np.eye(3), np.zeros(3)
    for k in range(table.shape[0]):
        if k > 0:
            rigid_step(u[:3], u[3:], h, rotation, shift)
            move_points(points, rotation, shift)
        x, y = points[0, 0] / points[0, 2], points[0, 1] / points[0, 2]
        measured[0, 0] = x + noise[k, 0]
        measured[0, 1] = y + noise[k, 1]
        if k == 0:
            s_hat[:] = measured
            before[:] = measured
        else:
            fixed_gain_step(
                s_hat, chi, before, measured, seen, u[:3], u[3:], rotation, shift, h, gains[0], gains[1], gains[2]
            )
        circle_goal(k * h, circle[0], circle[1], circle[2], circle[3], goal, rate)
        ahead = 1.0 if feed_forward else 0.0
        px = ahead * rate[0] - gain * (measured[0, 0] - goal[0])
        py = ahead * rate[1] - gain * (measured[0, 1] - goal[1])
        if printed:
            memory[:] = 0.0
        single_point_command(
            variant, measured[0, 0], measured[0, 1], chi[0], px, py, limits[0], limits[1],
            0.0 if printed else NEAR_GOAL, memory, u,
        )  # fmt: skip
        table[k, 0] = k * h
        table[k, 1], table[k, 2], table[k, 3], table[k, 4] = x, y, goal[0], goal[1]
        table[k, 5] = np.sqrt((x - goal[0]) ** 2 + (y - goal[1]) ** 2)
        table[k, 6], table[k, 7] = 1.0 / points[0, 2], chi[0]
        table[k, 8] = (x * u[2] - u[0]) ** 2 + (y * u[2] - u[1]) ** 2
        table[k, 9] = y * u[3] - x * u[4]
        table[k, 10], table[k, 11] = u[0], u[1]
        table[k, 12:] = u[3:]
