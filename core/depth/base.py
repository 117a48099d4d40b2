"""Depths for a wheeled base with a camera that looks forward: motion of the image, goal pose, drive to it.

The camera lies `offset` ahead of the axle's centre, x right, y down, z forward. A base with velocities
(v, w) [m/s, rad/s], w counter-clockwise seen from above, moves it with u = E (v, w),

    u = (-offset w, 0, v, 0, -w, 0),   sigma^2 = (x v + offset w)^2 + y^2 v^2,   J_l u_w = x w

Theorem 8.2 then asks for v <= 0 and x_i w <= 0. Backing up straight meets it for points on both sides
and excites every point but those in the middle of the image, as |s|^2 v^2.
"""

import math

import numpy as np

from knotwork.core.kernel import kernel
from knotwork.core.messages import F64

_STEPS = 15  # Gauss-Newton steps of the goal pose; 3 to 5 are usual
_K_RHO, _K_ALPHA, _K_BETA = 1.0, 3.0, -1.0  # stable for K_RHO > 0, K_BETA < 0, K_ALPHA > K_RHO
_HERE = 0.03  # m; nearer than this the direction of the goal is mostly noise: only its distance and heading count


@kernel
def backing_up(
    time: float, way: float, certain: bool, back: float, pause: float, stride: float, stopped: float
) -> float:
    """Decide about the way back: 1 go on backwards, 0 stand, -1 it is over.

    The base stands for `pause` seconds before and, if a depth is still uncertain, after the way: the image
    at both ends of the baseline is then a mean of many frames.

    Parameters
    ----------
    time
        Since the first frame [s].
    way, back, stride
        Metres gone back, metres allowed, metres of one more step.
    certain
        All depths are good.
    stopped
        When the base stopped at the end of the way [s]; negative before.
    """
    if way == 0.0 and time < pause - 1e-9:
        return 0.0
    if certain and way > 0.0:
        return -1.0
    if way + stride <= back + 1e-9:
        return 1.0
    return 0.0 if stopped < 0.0 or time - stopped < pause - 1e-9 else -1.0


@kernel
def swing_rate(way: float, back: float, swing: float, v: float) -> float:
    """Return the yaw rate [rad/s] that swings the heading by `swing` [rad] to both sides along the way back.

    The camera ahead of the axle then also moves sideways, which shows the depth of points in the middle
    of the image; backing up straight does not.
    """
    return swing * 2.0 * math.pi / back * v * math.cos(2.0 * math.pi * way / back) if back > 0.0 else 0.0


@kernel
def goal_pose(s: F64, chi: F64, goal: F64, offset: float, pose: F64) -> bool:
    """Find the pose of the base from which the points are seen at `goal`, by Gauss-Newton on the image.

    Parameters
    ----------
    s, chi, goal
        Present image (n, 2), inverse depths (n,) [1/m], wanted image (n, 2).
    offset
        Of the camera ahead of the base's centre [m].
    pose
        In: start; out: (x, y, yaw) of the goal in the present base frame (3,).

    Returns
    -------
    bool
        False if the points do not determine a pose, or it did not converge; `pose` is then as it was.
    """
    x, y, yaw = pose[0], pose[1], pose[2]
    h = np.empty((3, 3))
    g = np.empty(3)
    row = np.empty(3)
    for _ in range(_STEPS):
        h[:] = 0.0
        g[:] = 0.0
        c, sn = math.cos(yaw), math.sin(yaw)
        for i in range(chi.shape[0]):
            dx = 1.0 / chi[i] + offset - x
            dy = -s[i, 0] / chi[i] - y
            depth = c * dx + sn * dy - offset
            left = -sn * dx + c * dy
            if depth < 0.05:
                continue
            # Derivatives of depth and left with respect to (x, y, yaw)
            d0, d1, d2 = -c, -sn, left
            l0, l1, l2 = sn, -c, -(depth + offset)
            for k in range(2):
                top = -left if k == 0 else s[i, 1] / chi[i]
                ratio = top / depth
                moves = 1.0 if k == 0 else 0.0
                row[0] = (-moves * l0 - ratio * d0) / depth
                row[1] = (-moves * l1 - ratio * d1) / depth
                row[2] = (-moves * l2 - ratio * d2) / depth
                r = ratio - goal[i, k]
                for a in range(3):
                    g[a] += row[a] * r
                    for b in range(3):
                        h[a, b] += row[a] * row[b]
        for a in range(3):
            h[a, a] *= 1.0 + 1e-6
        det = (
            h[0, 0] * (h[1, 1] * h[2, 2] - h[1, 2] * h[2, 1])
            - h[0, 1] * (h[1, 0] * h[2, 2] - h[1, 2] * h[2, 0])
            + h[0, 2] * (h[1, 0] * h[2, 1] - h[1, 1] * h[2, 0])
        )
        if not det > 1e-12 * (h[0, 0] * h[1, 1] * h[2, 2] + 1e-300):
            return False
        step = np.linalg.solve(h, -g)
        size = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        if not math.isfinite(size):
            return False
        shorter = min(1.0, 0.5 / max(size, 1e-300))
        x += shorter * step[0]
        y += shorter * step[1]
        yaw += shorter * step[2]
        if size < 1e-6:
            pose[0], pose[1], pose[2] = x, y, math.atan2(math.sin(yaw), math.cos(yaw))
            return True
    return False


@kernel
def move_goal(pose: F64, v: float, w: float, h: float) -> None:
    """Express the goal `pose` (3,) in the base's frame after driving (v, w) for h seconds, in place."""
    turn = w * h
    middle = 0.5 * turn
    chord = v * h * (math.sin(middle) / middle if abs(middle) > 1e-6 else 1.0)
    dx, dy = pose[0] - chord * math.cos(middle), pose[1] - chord * math.sin(middle)
    c, s = math.cos(turn), math.sin(turn)
    pose[0], pose[1] = c * dx + s * dy, -s * dx + c * dy
    pose[2] = math.atan2(math.sin(pose[2] - turn), math.cos(pose[2] - turn))


@kernel
def drive_to(pose: F64, gain: float, v_max: float, w_max: float, command: F64) -> None:
    """Write the command (v, w) (2,) that drives to the goal `pose` (3,) and its heading, forwards or backwards.

    The steering law in polar coordinates around the goal; too fast commands are slowed on their arc.
    """
    distance = math.sqrt(pose[0] ** 2 + pose[1] ** 2)
    if distance < _HERE:
        v, w = gain * _K_RHO * pose[0], gain * _K_ALPHA * pose[2]
    else:
        side = 1.0 if pose[0] >= 0.0 else -1.0
        alpha = math.atan2(side * pose[1], side * pose[0])
        beta = math.atan2(math.sin(pose[2] - alpha), math.cos(pose[2] - alpha))
        v = side * gain * _K_RHO * distance * math.cos(alpha)
        w = gain * (_K_ALPHA * alpha + _K_BETA * beta)
    slow = min(1.0, v_max / max(abs(v), 1e-300), w_max / max(abs(w), 1e-300))
    command[0] = min(max(slow * v, -v_max), v_max)
    command[1] = min(max(slow * w, -w_max), w_max)
