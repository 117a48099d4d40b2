"""Arrays of planar poses: x [m], y [m], yaw [rad], shape (..., 3)."""

import numpy as np

from knotwork.core.messages import F64


def relative(a: F64, b: F64) -> F64:
    """Return a^-1 * b, poses `b` seen from poses `a`: shape (..., 3), yaw in [-pi, pi]."""
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    yaw = wrap(b[..., 2] - a[..., 2])
    return np.stack((c * dx + s * dy, c * dy - s * dx, yaw), axis=-1)


def compose(a: F64, b: F64) -> F64:
    """Return a * b, poses `b` given in the frames `a` as seen from where `a` is given: shape (..., 3)."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack((x, y, wrap(a[..., 2] + b[..., 2])), axis=-1)


def wrap(angle: F64) -> F64:
    """Return the angle in [-pi, pi] [rad]."""
    wrapped: F64 = np.arctan2(np.sin(angle), np.cos(angle))
    return wrapped
