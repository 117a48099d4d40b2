"""A point from two or more views of known pose: least squares over the rays, and the linear transform (8.1)-(8.6)."""

import numpy as np

from knotwork.core.messages import F64


def from_rays(positions: F64, rotations: F64, s: F64) -> tuple[F64, float]:
    """Return the point nearest to all rays, and the condition number of its normal equations.

    For two views this is the middle of the shortest segment between the rays, (8.1)-(8.3).

    Parameters
    ----------
    positions, rotations
        Camera poses: (k, 3) [m] and (k, 3, 3), optical axes as columns.
    s
        Normalised image coordinates (k, 2), one for each view.

    Returns
    -------
    point, condition
        (3,) [m] in the frame of the poses, NaN when the rays are parallel; condition number, then infinite.
    """
    rays = np.einsum("kij,kj->ki", rotations, np.column_stack((s, np.ones(len(s)))))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    normal = across.sum(axis=0)
    return _solve(normal, np.einsum("kij,kj->i", across, positions))


def from_projections(positions: F64, rotations: F64, s: F64) -> tuple[F64, float]:
    """Return the point of the direct linear transform, rows (x p3 - p1) q = 0, (y p3 - p2) q = 0 (8.5), (8.6).

    Parameters and results as of `from_rays`; the condition number is that of the linear system's normal equations.
    """
    to_camera = np.transpose(rotations, (0, 2, 1))
    projections = np.concatenate((to_camera, -(to_camera @ positions[:, :, None])), axis=2)
    rows = (s[:, :, None] * projections[:, 2:3] - projections[:, :2]).reshape(-1, 4)
    return _solve(rows[:, :3].T @ rows[:, :3], -rows[:, :3].T @ rows[:, 3])


def _solve(normal: F64, right: F64) -> tuple[F64, float]:
    values = np.linalg.eigvalsh(normal)
    if not values[0] > 1e-12 * values[-1]:
        return np.full(3, np.nan), float("inf")
    return np.linalg.solve(normal, right).astype(np.float64), float(values[-1] / values[0])
