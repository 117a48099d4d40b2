"""A map that knows a room in closed form: the truth that localisers are tried on."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.conformance.room import Room
from knotwork.core.contracts import Alignment, Loss, Map, NormalEquations
from knotwork.core.messages import F64, Scan

_INLIER = 0.10  # m


class RoomMap(Map):
    """Implements `Map` by the distance to a room's walls; fusing changes nothing but is kept in `updates`.

    Parameters
    ----------
    sigma
        What residuals are whitened by [m], one a level, coarse to fine.
    beams
        A scan weighs as much as this many independent beams.
    """

    def __init__(
        self, context: Any, room: Room | None = None, sigma: tuple[float, ...] = (0.1, 0.05, 0.02), beams: int = 60
    ) -> None:
        super().__init__(context)
        self.room = room or Room()
        self.sigma = sigma
        self.beams = beams
        self.levels = len(sigma)
        self.updates: list[tuple[Scan, F64, bool]] = []

    def alignment(self, scan: Scan, guess: F64, motion: F64 | None = None) -> Alignment:
        """Prepare a scan; it is not de-skewed."""
        return RoomAlignment(self, scan)

    def update(self, scan: Scan, pose: F64, alignment: Alignment | None = None, fuse: bool = True) -> None:
        """Keep book."""
        self.updates.append((scan, np.array(pose), fuse))

    def empty(self) -> bool:
        """Return False: the room is known from the start."""
        return False

    def occupancy(self, points: F64) -> F64:
        """Return 1 within 5 cm of a wall, -1 inside, 0 outside."""
        distance, _ = self.room.distance(points)
        return np.where(np.abs(distance) < 0.05, 1.0, np.where(self._inside(points), -1.0, 0.0))

    def _inside(self, points: F64) -> NDArray[np.bool_]:
        inside: NDArray[np.bool_] = np.all(np.abs(points - self.room.middle) < self._half(), axis=1)
        return inside

    def _half(self) -> F64:
        return np.array([self.room.width, self.room.depth]) / 2

    def rasterize(self, resolution: float | None = None) -> tuple[NDArray[np.int8], float, tuple[float, float, float]]:
        """Return the room and half a metre around it."""
        side = resolution or 0.05
        x0, y0 = (self.room.middle - self._half() - 0.5).tolist()
        xs = np.arange(x0 + side / 2, x0 + self.room.width + 1, side)
        ys = np.arange(y0 + side / 2, y0 + self.room.depth + 1, side)
        grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        occupancy = self.occupancy(grid).reshape(len(ys), len(xs))
        cells = np.where(occupancy == 0, -1, 50 + 50 * occupancy).astype(np.int8)
        return cells, side, (x0, y0, 0.0)

    @property
    def nbytes(self) -> int:
        """Two numbers."""
        return 16

    def save(self, path: Path) -> None:
        """Refuse: there is nothing to save."""
        raise NotImplementedError

    def load(self, path: Path) -> None:
        """Refuse: there is nothing to load."""
        raise NotImplementedError


class RoomAlignment(Alignment):
    """Residual: signed distance of a beam's end to the nearest wall, whitened."""

    def __init__(self, owner: RoomMap, scan: Scan) -> None:
        self._map = owner
        self.levels = owner.levels
        r = scan.ranges.astype(float)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(r)) + scan.mount[2]
        valid = np.isfinite(r) & (r >= scan.range_min) & (r < scan.range_max)
        r, angles = r[valid], angles[valid]
        ends = np.column_stack([r * np.cos(angles), r * np.sin(angles)])
        self._points = ends + np.asarray(scan.mount[:2])

    def _ends(self, pose: F64) -> tuple[F64, F64]:
        c, s = np.cos(pose[2]), np.sin(pose[2])
        turned = self._points @ np.array([[c, s], [-s, c]])
        return turned + pose[:2], turned

    def residuals(self, pose: F64, level: int) -> tuple[F64, F64]:
        """Return residuals (n,) and Jacobian (n, 3)."""
        ends, turned = self._ends(np.asarray(pose))
        distance, gradient = self._map.room.distance(ends)
        spin = gradient[:, 1] * turned[:, 0] - gradient[:, 0] * turned[:, 1]
        scale = np.sqrt(min(1.0, self._map.beams / max(len(ends), 1))) / self._map.sigma[level]
        return distance * scale, np.column_stack([gradient, spin]) * scale

    def normal_equations(self, pose: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> NormalEquations:
        """Return H, g and cost."""
        r, jacobian = self.residuals(pose, level)
        rho, w = robust(r, loss, scale)
        n = len(r)
        return NormalEquations((jacobian.T * w) @ jacobian, jacobian.T @ (w * r), float(rho.sum()), n, n)

    def costs(self, poses: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> F64:
        """Return the cost at each pose."""
        return np.array([robust(self.residuals(pose, level)[0], loss, scale)[0].sum() for pose in poses])

    def inliers(self, pose: F64, level: int) -> float:
        """Return the share of beams that end within 10 cm of a wall."""
        if not len(self._points):
            return 0.0
        distance, _ = self._map.room.distance(self._ends(np.asarray(pose))[0])
        return float(np.mean(np.abs(distance) < _INLIER))


def robust(r: F64, loss: Loss, scale: float) -> tuple[F64, F64]:
    """Return the loss rho (r^2 near zero) of residuals (n,) and its weight d rho / d(r^2)."""
    k = scale**2
    u = r**2 / k
    if loss == "huber":
        far = u > 1
        a = np.sqrt(u)
        return np.where(far, k * (2 * a - 1), k * u), np.where(far, 1 / np.maximum(a, 1), 1.0)
    if loss == "cauchy":
        return k * np.log1p(u), 1 / (1 + u)
    if loss == "geman-mcclure":
        return k * u / (1 + u), 1 / (1 + u) ** 2
    if loss == "welsch":
        return k * -np.expm1(-u), np.exp(-u)
    return k * u, np.ones_like(r)
