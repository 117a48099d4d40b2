"""Pinhole camera: pixels, normalised image coordinates, their motion, and rigid motions of the camera.

The optical frame has x right, y down, z forward. A point q = (X, Y, Z) is seen at s = (X/Z, Y/Z) with
inverse depth chi = 1/Z. A camera that moves with the twist u = (v, w) in its own frame sees

    ds/dt = chi J_v(s) v + J_w(s) w,        dchi/dt = chi^2 J_q v + chi J_l(s) w        (8.11)
"""

import math
from dataclasses import dataclass

import numpy as np

from knotwork.core.errors import InputError
from knotwork.core.kernel import kernel
from knotwork.core.messages import F64

J_Q = np.array([[0.0, 0.0, 1.0]])
_SMALL = 1e-3  # rad; below it the series of the rotation are exact to rounding


@dataclass(frozen=True, slots=True)
class Pinhole:
    """Focal lengths and principal point of an undistorted camera [px] (3.5)-(3.7).

    Raises
    ------
    InputError
        A focal length is not positive or a number is not finite.
    """

    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in (self.fx, self.fy, self.cx, self.cy)):
            raise InputError("a camera's focal lengths and principal point must be finite numbers")
        if self.fx <= 0 or self.fy <= 0:
            raise InputError(f"focal lengths must be positive, found {self.fx} and {self.fy} px")

    def pixels(self, points: F64) -> F64:
        """Return pixels (n, 2) of normalised coordinates (n, 2): u = fx x + cx (3.6)."""
        return np.asarray(points) * (self.fx, self.fy) + (self.cx, self.cy)

    def normalised(self, pixels: F64) -> F64:
        """Return normalised coordinates (n, 2) of pixels (n, 2): x = (u - cx)/fx, the inverse of (3.6)."""
        return (np.asarray(pixels, dtype=np.float64) - (self.cx, self.cy)) / (self.fx, self.fy)


def project(points: F64) -> tuple[F64, F64]:
    """Return normalised coordinates (n, 2) and inverse depths (n,) of points (n, 3) in the optical frame.

    Points on or behind the camera plane have no image: NaN in both.
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    depth = np.where(points[:, 2] > 0.0, points[:, 2], np.nan)
    return points[:, :2] / depth[:, None], 1.0 / depth


def j_v(s: F64) -> F64:
    """Return J_v (n, 2, 3) at points s (n, 2)."""
    out = np.zeros((len(s), 2, 3))
    out[:, 0, 0] = out[:, 1, 1] = -1.0
    out[:, :, 2] = s
    return out


def j_w(s: F64) -> F64:
    """Return J_w (n, 2, 3) at points s (n, 2)."""
    x, y = s[:, 0], s[:, 1]
    rows = ((x * y, -(1 + x * x), y), (1 + y * y, -x * y, -x))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1)


def j_l(s: F64) -> F64:
    """Return J_l (n, 3) at points s (n, 2): dchi/dt = chi J_l w for a camera that only rotates."""
    return np.stack((s[:, 1], -s[:, 0], np.zeros(len(s))), axis=-1)


def interaction(s: F64, chi: F64) -> F64:
    """Return the matrix L (2n, 6) with ds/dt = L (v, w), rows [chi_i J_v(s_i), J_w(s_i)] (9.38)."""
    return np.concatenate((chi[:, None, None] * j_v(s), j_w(s)), axis=2).reshape(-1, 6)


def excitation(s: F64, v: F64) -> F64:
    """Return sigma^2 (n,) = |J_v(s_i) v|^2: how well the motion shows the depth of each point (8.15)."""
    flow = s * v[2] - v[:2]
    out: F64 = np.einsum("ni,ni->n", flow, flow)
    return out


@kernel
def rigid_step(v: F64, w: F64, h: float, rotation: F64, shift: F64) -> None:
    """Write the motion of a camera that keeps the twist (v, w) for h seconds.

    `rotation` (3, 3) = exp([w]x h) and `shift` (3,) = integral of exp([w]x t) v dt are the pose of the
    new camera frame in the old one: q_new = rotation^T (q_old - shift).
    """
    rate = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    angle = rate * h
    a2 = angle * angle
    if angle < _SMALL:
        c1 = h * (1.0 - a2 / 6.0)  # sin(a)/|w|
        c2 = h * h * (0.5 - a2 / 24.0)  # (1 - cos(a))/|w|^2
        c3 = h * h * h * (1.0 / 6.0 - a2 / 120.0)  # (a - sin(a))/|w|^3
    else:
        c1 = math.sin(angle) / rate
        c2 = (1.0 - math.cos(angle)) / (rate * rate)
        c3 = (angle - math.sin(angle)) / (rate * rate * rate)
    x, y, z = w[0], w[1], w[2]
    rotation[0, 0] = 1.0 - c2 * (y * y + z * z)
    rotation[0, 1] = c2 * x * y - c1 * z
    rotation[0, 2] = c2 * x * z + c1 * y
    rotation[1, 0] = c2 * x * y + c1 * z
    rotation[1, 1] = 1.0 - c2 * (x * x + z * z)
    rotation[1, 2] = c2 * y * z - c1 * x
    rotation[2, 0] = c2 * x * z - c1 * y
    rotation[2, 1] = c2 * y * z + c1 * x
    rotation[2, 2] = 1.0 - c2 * (x * x + y * y)
    # V = h I + c2 [w] + c3 [w]^2 applied to v
    ax, ay, az = y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]
    shift[0] = h * v[0] + c2 * ax + c3 * (y * az - z * ay)
    shift[1] = h * v[1] + c2 * ay + c3 * (z * ax - x * az)
    shift[2] = h * v[2] + c2 * az + c3 * (x * ay - y * ax)


@kernel
def move_points(points: F64, rotation: F64, shift: F64) -> None:
    """Express `points` (n, 3) in the camera frame after a rigid step, in place."""
    for i in range(points.shape[0]):
        a, b, c = points[i, 0] - shift[0], points[i, 1] - shift[1], points[i, 2] - shift[2]
        for k in range(3):
            points[i, k] = rotation[0, k] * a + rotation[1, k] * b + rotation[2, k] * c


@kernel
def move_image(s: F64, chi: F64, rotation: F64, shift: F64, i: int) -> None:
    """Move the image point s[i] and inverse depth chi[i] by a rigid step, in place.

    A point that the step leaves behind the camera keeps its old image.
    """
    a, b, c = s[i, 0] - chi[i] * shift[0], s[i, 1] - chi[i] * shift[1], 1.0 - chi[i] * shift[2]
    x = rotation[0, 0] * a + rotation[1, 0] * b + rotation[2, 0] * c
    y = rotation[0, 1] * a + rotation[1, 1] * b + rotation[2, 1] * c
    z = rotation[0, 2] * a + rotation[1, 2] * b + rotation[2, 2] * c
    if z > 1e-6:
        s[i, 0] = x / z
        s[i, 1] = y / z
        chi[i] /= z
