"""A rectangular room in closed form: its scans, its walls' distance, and a prior that says what a test wants."""

import math
from dataclasses import dataclass

import numpy as np

from knotwork.core.contracts import PriorEstimate
from knotwork.core.messages import F64, Scan


@dataclass(frozen=True, slots=True)
class Room:
    """Four walls, `width` along x and `depth` along y [m]; `middle` is off the origin, so that no flip goes unseen."""

    width: float = 7.0
    depth: float = 5.0
    middle: tuple[float, float] = (0.6, -0.4)

    def ranges(self, pose: F64, angles: F64) -> F64:
        """Return the distance [m] to the wall along each map angle `angles` (n,) [rad] from a pose inside."""
        c, s = np.cos(angles), np.sin(angles)
        with np.errstate(divide="ignore", invalid="ignore"):
            tx = (np.sign(c) * self.width / 2 + self.middle[0] - pose[0]) / c
            ty = (np.sign(s) * self.depth / 2 + self.middle[1] - pose[1]) / s
        tx[c == 0] = np.inf
        ty[s == 0] = np.inf
        nearest: F64 = np.minimum(tx, ty)
        return nearest

    def scan(
        self,
        pose: F64,
        *,
        stamp: int = 0,
        scan_id: int = 0,
        beams: int = 360,
        noise: float = 0.0,
        mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Scan:
        """Return what a full-turn sensor measures at once, with white `noise` [m], from robot `pose` (3,)."""
        increment = 2 * math.pi / beams
        c, s = math.cos(pose[2]), math.sin(pose[2])
        sensor = np.array([pose[0] + c * mount[0] - s * mount[1], pose[1] + s * mount[0] + c * mount[1]])
        ranges = self.ranges(sensor, pose[2] + mount[2] - math.pi + increment * np.arange(beams))
        if noise:
            ranges = ranges + np.random.default_rng(scan_id).normal(0.0, noise, beams)
        return Scan(
            stamp=stamp, scan_id=scan_id, ranges=ranges.astype(np.float32), angle_min=-math.pi,
            angle_increment=increment, range_min=0.05, range_max=30.0, mount=mount,
        )  # fmt: skip

    def distance(self, points: F64) -> tuple[F64, F64]:
        """Return the signed distance [m] of `points` (n, 2) to the nearest wall, and its gradient (n, 2).

        Positive outside; the gradient is a wall's normal. Near a corner the nearer wall counts, inside
        and outside alike, so that the distance stays linear along each wall.
        """
        x, y = (points - self.middle).T
        dx = np.abs(x) - self.width / 2
        dy = np.abs(y) - self.depth / 2
        by_x = np.abs(dx) < np.abs(dy)
        distance = np.where(by_x, dx, dy)
        gradient = np.zeros_like(points)
        gradient[by_x, 0] = np.sign(x[by_x])
        gradient[~by_x, 1] = np.sign(y[~by_x])
        return distance, gradient

    def poses(self, n: int) -> F64:
        """Return `n` robot poses (n, 3) on a small ellipse in the middle, turning once."""
        t = 2 * math.pi * np.arange(n) / n
        return np.column_stack([self.middle[0] + 0.8 * np.cos(t), self.middle[1] + 0.5 * np.sin(t), t])


def scan_of(ranges: object, *, stamp: int = 0, scan_id: int = 0) -> Scan:
    """Return a full-turn scan of any ranges [m], shape (n,)."""
    values = np.asarray(ranges, dtype=np.float32)
    return Scan(
        stamp=stamp, scan_id=scan_id, ranges=values, angle_min=-math.pi,
        angle_increment=2 * math.pi / max(len(values), 1), range_min=0.05, range_max=30.0,
    )  # fmt: skip


class FixedPrior:
    """A prior that says what it was told; implements `knotwork.core.contracts.Prior`."""

    def __init__(self, pose: F64, sigma: tuple[float, float, float] = (0.1, 0.1, 0.05), weak: bool = False) -> None:
        self.pose = np.asarray(pose, dtype=float)
        self.sigma = sigma
        self.weak = weak

    def prior(self, time: int) -> PriorEstimate:
        """Return the pose that was set, with `sigma` [m, m, rad] and no motion."""
        return PriorEstimate(self.pose.copy(), np.diag(np.square(self.sigma)), np.zeros(3), self.weak)
