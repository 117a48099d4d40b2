"""One run of a wheeled base towards a goal view as a compiled loop over the kernels that the plugins call."""

import math

import numpy as np

from knotwork.core.camera import move_points, rigid_step
from knotwork.core.depth.base import backing_up, drive_to, goal_pose, move_goal, swing_rate
from knotwork.core.depth.ekf import ekf_start, ekf_step
from knotwork.core.kernel import kernel
from knotwork.core.messages import F64

_TOO_NEAR = 0.05  # m


@kernel
def run_base(
    start: F64,
    goal: F64,
    guess: F64,
    filter_sd: F64,
    offset: float,
    limits: F64,
    back: float,
    pause: float,
    swing: float,
    deviation: float,
    h: float,
    noise: F64,
    view: F64,
    errors: F64,
    depth_errors: F64,
    poses: F64,
) -> float:
    """Back up until all depths are certain or `back` metres are used, then drive to the goal view.

    Parameters
    ----------
    start, goal, guess
        Points (n, 3) [m] in the first camera frame, goal image (n, 2), guessed inverse depths (n,) [1/m].
    filter_sd
        The filter's (image sd, chi sd, q_s, q_chi).
    offset, limits, back, pause, swing, deviation, h
        Camera ahead of the axle [m]; (v_max, w_max); metres; seconds of standing before and after backing up;
        radians of the heading to both sides on the way back; relative standard deviation; step [s].
    noise, view
        Added to the measured image (K+1, n, 2); half width and half height of the image.
    errors, depth_errors, poses
        Outputs: |e| (K+1,), largest relative depth error of all points (K+1,), base pose (K+1, 3).

    Returns
    -------
    float
        Metres it backed up; negative if it never ended.
    """
    n = start.shape[0]
    points = start.copy()
    measured = np.empty((n, 2))
    seen = np.zeros(n)
    known = np.zeros(n)
    state = np.ones((n, 3))
    covariance = np.zeros((n, 3, 3))
    rotation, shift = np.eye(3), np.zeros(3)
    pose, target = np.zeros(3), np.zeros(3)
    command = np.zeros(2)
    v, w = np.zeros(3), np.zeros(3)
    way = 0.0
    stopped = -1.0
    moving = 0.0
    backing, located = True, False
    errors[:] = np.inf
    for k in range(errors.shape[0]):
        if k > 0:
            rigid_step(v, w, h, rotation, shift)
            move_points(points, rotation, shift)
            move_goal(target, command[0], command[1], h)
            middle = pose[2] + 0.5 * command[1] * h
            pose[0] += command[0] * h * math.cos(middle)
            pose[1] += command[0] * h * math.sin(middle)
            pose[2] += command[1] * h
            way += max(0.0, -command[0]) * h if backing else 0.0
        poses[k] = pose
        total = 0.0
        for i in range(n):
            seen[i] = 0.0
            if points[i, 2] < _TOO_NEAR:
                return -1.0
            x, y = points[i, 0] / points[i, 2], points[i, 1] / points[i, 2]
            total += (x - goal[i, 0]) ** 2 + (y - goal[i, 1]) ** 2
            measured[i, 0], measured[i, 1] = x + noise[k, i, 0], y + noise[k, i, 1]
            if abs(x) <= view[0] and abs(y) <= view[1]:
                seen[i] = 1.0
        errors[k] = math.sqrt(total)
        if k > 0:
            ekf_step(
                state, covariance, measured, known * seen, rotation, shift, h, filter_sd[0], filter_sd[2], filter_sd[3]
            )
        worst = 0.0
        certain = True
        for i in range(n):
            if known[i] == 0.0 and seen[i] != 0.0:
                known[i] = 1.0
                ekf_start(state, covariance, i, measured[i, 0], measured[i, 1], guess[i], filter_sd[0], filter_sd[1])
            worst = max(worst, abs(1.0 / (state[i, 2] * points[i, 2]) - 1.0))
            if seen[i] != 0.0 and math.sqrt(covariance[i, 2, 2]) > deviation * state[i, 2]:
                certain = False
        depth_errors[k] = worst
        if backing:
            moving = backing_up(k * h, way, certain, back, pause, limits[0] * h, stopped)
            if moving < 0.0:
                backing = False
            elif moving == 0.0 and stopped < 0.0 and way > 0.0:
                stopped = k * h
        if backing:
            command[0] = -moving * limits[0]
            rate = swing_rate(way + 0.5 * limits[0] * h, back, swing, moving * limits[0])
            command[1] = min(max(rate, -limits[1]), limits[1])
        else:
            rows = np.nonzero(known * seen)[0]
            if rows.shape[0] >= 2:
                located = goal_pose(measured[rows], state[rows, 2].copy(), goal[rows], offset, target) or located
            command[0], command[1] = 0.0, 0.0
            if located:
                drive_to(target, 1.0, limits[0], limits[1], command)
        v[0], v[2] = -offset * command[1], command[0]
        w[1] = -command[1]
    return -1.0 if backing else way
