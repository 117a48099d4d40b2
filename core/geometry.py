"""Rigid motions of the plane, SE(2): a pose is (x [m], y [m], yaw [rad]), x forward, y left.

`compose(a, b)` is "b seen from a, expressed where a is expressed". Single poses are plain floats: that
is several times faster than NumPy on three numbers. Every function takes any three-element sequence
(use `array.tolist()` in hot code) and returns a tuple, unless it says that it returns an array.
"""

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from knotwork.core.messages import F64

Pose2: TypeAlias = tuple[float, float, float]
Pose2Like: TypeAlias = Sequence[float] | F64

IDENTITY: Pose2 = (0.0, 0.0, 0.0)
_TWO_PI = 2.0 * math.pi
_SMALL = 1e-4  # below it sin(w)/w and (1 - cos(w))/w come from their series, exact to rounding


def wrap(angle: float) -> float:
    """Return the angle [rad] brought into (-pi, pi]."""
    angle = math.remainder(angle, _TWO_PI)
    return angle if angle > -math.pi else math.pi


def compose(a: Pose2Like, b: Pose2Like) -> Pose2:
    """Return a * b, yaw wrapped (2.5 with the rotation of the errata)."""
    ax, ay, ayaw = a
    bx, by, byaw = b
    c = math.cos(ayaw)
    s = math.sin(ayaw)
    return (ax + c * bx - s * by, ay + s * bx + c * by, wrap(ayaw + byaw))


def inverse(a: Pose2Like) -> Pose2:
    """Return a^-1, so that compose(a, inverse(a)) is the identity."""
    x, y, yaw = a
    c = math.cos(yaw)
    s = math.sin(yaw)
    return (-c * x - s * y, s * x - c * y, wrap(-yaw))


def relative(a: Pose2Like, b: Pose2Like) -> Pose2:
    """Return a^-1 * b: pose b seen from pose a, yaw wrapped."""
    ax, ay, ayaw = a
    bx, by, byaw = b
    c = math.cos(ayaw)
    s = math.sin(ayaw)
    dx = bx - ax
    dy = by - ay
    return (c * dx + s * dy, c * dy - s * dx, wrap(byaw - ayaw))


def exp(twist: Pose2Like) -> Pose2:
    """Return the motion of moving for unit time with a constant body twist (vx, vy, yaw rate)."""
    vx, vy, w = twist
    if abs(w) < _SMALL:
        a = 1.0 - w * w / 6.0
        b = 0.5 * w * (1.0 - w * w / 12.0)
    else:
        a = math.sin(w) / w
        b = (1.0 - math.cos(w)) / w
    return (a * vx - b * vy, b * vx + a * vy, wrap(w))


def log(pose: Pose2Like) -> Pose2:
    """Return the constant body twist that reaches `pose` in unit time: exp(log(pose)) = pose."""
    x, y, yaw = pose
    w = wrap(yaw)
    half = 0.5 * w
    a = 1.0 - w * w / 12.0 if abs(w) < _SMALL else half / math.tan(half)
    return (a * x + half * y, a * y - half * x, w)


def scaled(twist: Pose2Like, factor: float) -> Pose2:
    """Return the twist times a factor."""
    vx, vy, w = twist
    return (factor * vx, factor * vy, factor * w)


def interpolate(a: Pose2Like, b: Pose2Like, part: float) -> Pose2:
    """Return the pose at `part` in [0, 1] of the constant-twist motion from a to b; exact at both ends."""
    if part <= 0.0:
        x, y, yaw = a
        return (x, y, yaw)
    if part >= 1.0:
        x, y, yaw = b
        return (x, y, yaw)
    return compose(a, exp(scaled(log(relative(a, b)), part)))


def compose_jacobians(a: Pose2Like, b: Pose2Like) -> tuple[F64, F64]:
    """Return the Jacobians of compose(a, b) with respect to a and b, each an array (3, 3) (3.10)."""
    _, _, yaw = a
    bx, by, _ = b
    c = math.cos(yaw)
    s = math.sin(yaw)
    by_a = np.array([[1.0, 0.0, -s * bx - c * by], [0.0, 1.0, c * bx - s * by], [0.0, 0.0, 1.0]])
    by_b = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return by_a, by_b


def transform_points(pose: Pose2Like, points: F64) -> F64:
    """Return points (n, 2) of the frame at `pose` in the frame that `pose` is given in: array (n, 2)."""
    x, y, yaw = pose
    c = math.cos(yaw)
    s = math.sin(yaw)
    out = np.empty((len(points), 2))
    out[:, 0] = x + c * points[:, 0] - s * points[:, 1]
    out[:, 1] = y + s * points[:, 0] + c * points[:, 1]
    return out
