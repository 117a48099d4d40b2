"""The extended Kalman filter of a planar pose: prediction and corrections, no memory of its own.

The error of a pose is additive in (x, y, yaw) in map axes. Covariances are kept as their upper triangle
(xx, xy, xyaw, yy, yyaw, yawyaw): predicting on plain floats costs a few microseconds.
"""

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from knotwork.core.geometry import Pose2, wrap
from knotwork.core.messages import F64

Triangle: TypeAlias = tuple[float, float, float, float, float, float]


def diagonal(translation: float, rotation: float) -> Triangle:
    """Return the covariance of sigmas `translation` [m] of both axes and `rotation` [rad]."""
    return (translation * translation, 0.0, 0.0, translation * translation, 0.0, rotation * rotation)


def add(a: Triangle, b: Triangle) -> Triangle:
    """Return the sum of two covariances."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


def times(t: Triangle, factor: float) -> Triangle:
    """Return a covariance times a factor."""
    return (factor * t[0], factor * t[1], factor * t[2], factor * t[3], factor * t[4], factor * t[5])


def to_matrix(t: Triangle) -> F64:
    """Return the covariance as an array (3, 3)."""
    xx, xy, xw, yy, yw, ww = t
    return np.array(((xx, xy, xw), (xy, yy, yw), (xw, yw, ww)))


def to_triangle(matrix: NDArray[np.floating[Any]]) -> Triangle:
    """Return the upper triangle of the symmetric part of an array (3, 3)."""
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = matrix.tolist()
    return (xx, 0.5 * (xy + yx), 0.5 * (xw + wx), yy, 0.5 * (yw + wy), ww)


def is_positive(t: Triangle) -> bool:
    """Tell whether a covariance is finite and positive definite, by its Cholesky factor."""
    xx, xy, xw, yy, yw, ww = t
    if not 0.0 < xx < math.inf:
        return False
    yy -= xy * xy / xx
    if not 0.0 < yy < math.inf:
        return False
    yw -= xy * xw / xx
    return 0.0 < ww - xw * xw / xx - yw * yw / yy < math.inf


def rotated(t: Triangle, angle: float) -> Triangle:
    """Return a covariance given in axes that stand at `angle` [rad] in the axes it is wanted in."""
    xx, xy, xw, yy, yw, ww = t
    c = math.cos(angle)
    s = math.sin(angle)
    return (
        c * c * xx - 2.0 * c * s * xy + s * s * yy,
        c * s * (xx - yy) + (c * c - s * s) * xy,
        c * xw - s * yw,
        s * s * xx + 2.0 * c * s * xy + c * c * yy,
        s * xw + c * yw,
        ww,
    )


def predict(pose: Pose2, p: Triangle, motion: Pose2, noise: Triangle) -> tuple[Pose2, Triangle]:
    """Move by `motion`, given in the frame at `pose`: (3.8), (3.9) with noise on the input.

    P+ = F P F^T + G Q G^T with F, G the Jacobians (3.10) and Q = `noise`, the covariance of `motion`.
    """
    x, y, yaw = pose
    dx, dy, dyaw = motion
    c = math.cos(yaw)
    s = math.sin(yaw)
    mx = c * dx - s * dy
    my = s * dx + c * dy
    # F is the identity but for its last column (-my, mx, 1).
    xx, xy, xw, yy, yw, ww = p
    xw_new = xw - my * ww
    yw_new = yw + mx * ww
    q = rotated(noise, yaw) if noise[1] or noise[2] or noise[4] or noise[0] != noise[3] else noise
    return (x + mx, y + my, wrap(yaw + dyaw)), (
        xx - my * (xw + xw_new) + q[0],
        xy - my * yw + mx * xw_new + q[1],
        xw_new + q[2],
        yy + mx * (yw + yw_new) + q[3],
        yw_new + q[4],
        ww + q[5],
    )


def innovation(pose: Pose2, measured: Pose2) -> Pose2:
    """Return measured - pose with the yaw wrapped (errata of 3.13)."""
    return (measured[0] - pose[0], measured[1] - pose[1], wrap(measured[2] - pose[2]))


def moved_by(pose: Pose2, step: F64) -> Pose2:
    """Return pose + step, yaw wrapped."""
    dx, dy, dyaw = step.tolist()
    return (pose[0] + dx, pose[1] + dy, wrap(pose[2] + dyaw))


def distance(pose: Pose2, p: Triangle, measured: Pose2, r: Triangle) -> float:
    """Return the Mahalanobis distance of a measured pose with covariance r from the predicted one."""
    e = np.array(innovation(pose, measured))
    return math.sqrt(max(0.0, float(e @ np.linalg.solve(to_matrix(add(p, r)), e))))


def correct(pose: Pose2, p: Triangle, measured: Pose2, r: Triangle) -> tuple[Pose2, Triangle]:
    """Correct with a measured pose of covariance r: (3.11)-(3.14), h(xi) = xi, H = I.

    The covariance is computed in Joseph's form, which stays positive whatever the rounding.
    """
    prior = to_matrix(p)
    noise = to_matrix(r)
    gain = np.linalg.solve(prior + noise, prior).T
    rest = np.eye(3) - gain
    posterior = rest @ prior @ rest.T + gain @ noise @ gain.T
    return moved_by(pose, gain @ np.array(innovation(pose, measured))), to_triangle(posterior)


def information_distance(pose: Pose2, p: Triangle, measured: Pose2, information: F64) -> float:
    """Return the Mahalanobis distance as `distance` does, for an information matrix that may be singular.

    (P + L^-1)^-1 = L (I + P L)^-1 needs no inverse of L: what L does not know does not count.
    """
    e = np.array(innovation(pose, measured))
    return math.sqrt(max(0.0, float(e @ information @ np.linalg.solve(np.eye(3) + to_matrix(p) @ information, e))))


def correct_information(pose: Pose2, p: Triangle, measured: Pose2, information: F64) -> tuple[Pose2, Triangle]:
    """Correct as `correct` does, for an information matrix (3, 3) that may be singular (a corridor).

    P+ = (I + P L)^-1 P and xi+ = xi + P+ L e need no inverse of L.
    """
    prior = to_matrix(p)
    posterior = np.linalg.solve(np.eye(3) + prior @ information, prior)
    step = posterior @ (information @ np.array(innovation(pose, measured)))
    return moved_by(pose, step), to_triangle(posterior)
