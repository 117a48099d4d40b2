"""The map `gp`: each scan is regressed by itself, the results are fused by a Bayesian committee machine."""

import math
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Matern

from knotwork.core.beams import beams_of
from knotwork.core.contracts import Alignment, Context
from knotwork.core.errors import KnotworkError
from knotwork.core.geometry import wrap
from knotwork.core.map_base import PlaneMap
from knotwork.core.map_file import Arrays
from knotwork.core.messages import F64, Pose, Scan
from knotwork.core.splines import TiledArray
from knotwork.core.splines.tiles import SIDE
from knotwork.plugins.maps.gp import GpOptions

_REACH = 2.0  # [length scales] cells further from all training points stay as they are
_PENDING = 8  # scans and poses that wait for each other


class GpMap(PlaneMap):
    """Occupancy in [-1, 1] as a Gaussian process, prior mean 0 and variance 1, kept at cell centres.

    Of each scan: ends of beams are labelled 1, samples along them -1, and regressed with scikit-learn. Per
    cell the precisions beyond the prior's and the precision-weighted means add up (V. Tresp, "A Bayesian
    committee machine", 2000; S. Kim and J. Kim's Gaussian-process occupancy maps work the same way).
    """

    kind = "gp"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.options: GpOptions = context.options
        self.levels = 1
        self.step = self.config.resolution[-1]
        self.evidence = TiledArray(np.float32)  # sum of precision times mean
        self.precision = TiledArray(np.float32)  # sum of precision beyond the prior's
        self._process = GaussianProcessRegressor(
            Matern(self.options.length, nu=1.5), alpha=self.options.noise**2, optimizer=None
        )
        self._fused = 0
        self._fused_at: F64 | None = None
        self._scans: dict[int, Scan] = {}
        self._poses: dict[int, F64] = {}

    def on_scan(self, scan: Scan) -> None:
        """Keep a scan until its pose is known."""
        self._scans[scan.scan_id] = scan
        self._fuse_pair(scan.scan_id)

    def on_pose(self, message: Pose) -> None:
        """Take the pose of a scan."""
        if not message.lost and message.scan_id >= 0:
            self._poses[message.scan_id] = message.pose
            self._fuse_pair(message.scan_id)

    def _fuse_pair(self, scan_id: int) -> None:
        for waiting in (self._scans, self._poses):
            while len(waiting) > _PENDING:
                del waiting[min(waiting)]
        if scan_id not in self._scans or scan_id not in self._poses:
            return
        scan, pose, at = self._scans.pop(scan_id), self._poses.pop(scan_id), self._fused_at
        far, turn = self.options.fuse_motion
        if at is None or math.dist(pose[:2], at[:2]) >= far or abs(wrap(float(pose[2] - at[2]))) >= turn:
            self._fused_at = pose
            with self.context.measure("update"):
                self.update(scan, pose)

    def alignment(self, scan: Scan, guess: F64, motion: F64 | None = None) -> Alignment:
        """Refuse: this map is not aligned with."""
        raise KnotworkError("the map `gp` cannot be aligned with", hint="give the localiser another map")

    def update(self, scan: Scan, pose: F64, alignment: Alignment | None = None, fuse: bool = True) -> None:
        """Fuse `scan` taken at robot `pose` (3,); nothing with `fuse=False` or `fuse: false` in the config."""
        if not fuse or not self.config.fuse:
            return
        points, labels = self._training(scan, pose)
        if not len(points):
            return
        cells = self._cells_near(points)
        self._process.fit(points, labels)
        mean, deviation = self._process.predict((cells + 0.5) * self.step, return_std=True)
        precision = 1.0 / np.maximum(deviation, 1e-3) ** 2
        self._add(cells, mean * precision, precision - 1.0)
        self._fused += 1

    def _training(self, scan: Scan, pose: F64) -> tuple[F64, F64]:
        """Return points (n, 2) in the map and labels (n,); hits are thinned last."""
        options = self.options
        beams = beams_of(scan, self.config.range_min, self.config.range_max)
        ended = beams.rays[beams.rays[:, 5] > 0]
        steps = np.arange(self.config.range_min, self.config.range_max, options.free_step)
        ray, step = np.nonzero(steps[None] <= ended[:, 4, None] - options.margin)
        free = ended[ray, :2] + steps[step, None] * ended[ray, 2:4]
        free = _thinned(free, options.free_step / 2, self.step)
        hits = _thinned(beams.points[:, :2], self.step, self.step)
        hits = hits[:: max(1, math.ceil(len(hits) / options.points))]
        room = max(options.points - len(hits), 0)
        if len(free) > room:
            free = free[np.linspace(0, len(free) - 1, room).astype(int)]
        points = np.concatenate([hits, free])
        c, s = math.cos(pose[2]), math.sin(pose[2])
        labels = np.concatenate([np.ones(len(hits)), -np.ones(len(free))])
        return points @ np.array([[c, s], [-s, c]]) + pose[:2], labels

    def _cells_near(self, points: F64) -> F64:
        """Return the cells (n, 2), whole numbers, whose centres are near a training point."""
        reach = _REACH * self.options.length
        low, high = (
            np.floor((points.min(axis=0) - reach) / self.step),
            np.ceil((points.max(axis=0) + reach) / self.step),
        )
        axes = [np.arange(a, b) for a, b in zip(low, high, strict=True)]
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        distance, _ = cKDTree(points).query((cells + 0.5) * self.step, distance_upper_bound=reach)
        near: F64 = cells[np.isfinite(distance)]
        return near

    def _add(self, cells: F64, evidence: F64, precision: F64) -> None:
        whole = cells.astype(np.int64)
        for tiled, amounts in ((self.evidence, evidence), (self.precision, precision)):
            tiled.reserve_patches(whole, 1)
            slot, i, j = self._places(tiled, whole)
            tiled.pool[slot, i, j] += amounts.astype(np.float32)

    @staticmethod
    def _places(tiled: TiledArray, cells: Any) -> tuple[Any, Any, Any]:
        """Return slots and places in their tiles of cells (n, 2); slot 0 where nothing was claimed."""
        tile = cells // SIDE - (tiled.oi, tiled.oj)
        inside = np.all((tile >= 0) & (tile < tiled.directory.shape), axis=1)
        slot = np.zeros(len(cells), np.int64)
        slot[inside] = tiled.directory[tile[inside, 0], tile[inside, 1]]
        return slot, cells[:, 0] % SIDE, cells[:, 1] % SIDE

    def empty(self) -> bool:
        """Return True as long as nothing has been fused or loaded."""
        return self._fused == 0

    def occupancy(self, points: F64) -> F64:
        """Return the process's mean at `points` (n, 2), kept in [-1, 1]; shape (n,)."""
        cells = np.floor(np.asarray(points) / self.step).astype(np.int64)
        evidence = self.evidence.pool[self._places(self.evidence, cells)].astype(np.float64)
        precision = self.precision.pool[self._places(self.precision, cells)]
        mean: F64 = np.clip(evidence / (1.0 + precision), -1.0, 1.0)
        return mean

    def bounds(self) -> tuple[float, float, float, float]:
        """Return the box (x0, y0, x1, y1) [m] of the tiles."""
        i0, j0, i1, j1 = self.evidence.bounds()
        return i0 * self.step, j0 * self.step, i1 * self.step, j1 * self.step

    @property
    def nbytes(self) -> int:
        """Memory of means and precisions [bytes]."""
        return self.evidence.nbytes + self.precision.nbytes

    def stored(self) -> tuple[dict[str, Any], Arrays]:
        """Return what a map file holds."""
        where, evidence = self.evidence.claimed()
        _, precision = self.precision.claimed()
        facts = {"resolution": list(self.config.resolution), "fused": self._fused}
        return facts, {"where": where, "evidence": evidence, "precision": precision}

    def restore(self, facts: dict[str, Any], arrays: Arrays) -> None:
        """Replace the map."""
        where, evidence, precision = arrays["where"], arrays["evidence"], arrays["precision"]
        if evidence.shape != (len(where), SIDE, SIDE) or precision.shape != evidence.shape:
            raise ValueError(f"tiles have shapes {evidence.shape} and {precision.shape}")
        fused = int(facts["fused"])
        self.evidence, self.precision = (TiledArray.from_claimed(where, tiles) for tiles in (evidence, precision))
        self._fused = fused


def _thinned(points: F64, spacing: float, least: float) -> F64:
    """Return one of the points (n, 2) in each square of a grid."""
    if not len(points):
        return points
    _, first = np.unique(np.floor(points / max(spacing, least)).astype(np.int64), axis=0, return_index=True)
    thinned: F64 = points[np.sort(first)]
    return thinned
