"""One scan against the curves of a map."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotwork.core.beams import Beams
from knotwork.core.contracts import Alignment, Loss, NormalEquations
from knotwork.core.messages import F64
from knotwork.core.robust import CODES
from knotwork.plugins.maps.spline_curve import SplineCurveOptions, kernels
from knotwork.plugins.maps.spline_curve.association import Association, associate
from knotwork.plugins.maps.spline_curve.barred import barred
from knotwork.plugins.maps.spline_curve.lookup import LookupCache
from knotwork.plugins.maps.spline_curve.segmentation import Clusters
from knotwork.plugins.maps.spline_curve.store import CurveStore

_NODES = np.array([0.2, 0.2, 0.1])  # m, m, rad: curves are looked up at the nearest node of a lattice of poses


@dataclass(frozen=True, slots=True)
class Track:
    """A stretch of a scan on a curve of the map.

    Attributes
    ----------
    cluster, curve
        Numbers of the cluster of the scan and of the curve of the level.
    offset
        To be added to the length along the cluster to get the curve's parameter [m].
    overlap
        Length of the stretch [m].
    """

    cluster: int
    curve: int
    offset: float
    overlap: float


class CurveAlignment(Alignment):
    """A prepared scan; holds on to the map's curves, so it sees what is fused meanwhile.

    Which curves the scan lies on is looked up at nodes of a lattice of poses around the guess, so the
    cost is a function of the pose alone, smooth around each node.

    Parameters
    ----------
    beams
        The scan in the robot's frame.
    clusters, stores, lookups
        Of each level.
    guess : shape (3,)
        The lattice's origin.
    """

    def __init__(
        self,
        beams: Beams,
        clusters: list[Clusters],
        stores: list[CurveStore],
        lookups: list[LookupCache],
        guess: F64,
        options: SplineCurveOptions,
    ) -> None:
        self.beams = beams
        self.clusters = clusters
        self.levels = len(stores)
        self._stores = stores
        self._lookups = lookups
        self._guess = np.array(guess, np.float64)
        self._options = options
        self._along = 1.0 / options.sigma_along if options.sigma_along else 0.0
        self._n = len(beams.points)
        self._origin: F64 = beams.rays[:, :2].mean(axis=0) if len(beams.rays) else np.zeros(2)
        self._weight = min(1.0, options.beams / self._n) if self._n else 1.0
        self._found: dict[tuple[int, int, int, int, int], Association] = {}

    def association(self, pose: F64, level: int, gate: float) -> Association:
        """Look up the curves at exactly `pose` (3,)."""
        clusters = self.clusters[level]
        box = box_at(clusters.points, pose, 2.0 * gate)
        return associate(
            self._stores[level], self._lookups[level].covering(box), clusters, pose, gate, self._options.proven
        )

    def barred(self, pose: F64, level: int) -> NDArray[np.bool_]:
        """Return which clustered points lie behind a wall of the map, seen from `pose` (3,)."""
        margin = max(self._options.stale_margin, self._stores[level].step)
        return barred(self._stores[level], self.clusters[level].points, self._origin, pose, margin)

    def _at(self, pose: F64, level: int) -> Association:
        steps = np.rint((pose - self._guess) / _NODES)
        i, j, k = (int(v) for v in steps)
        key = (level, self._stores[level].version, i, j, k)
        found = self._found.get(key)
        if found is None:
            found = self.association(self._guess + steps * _NODES, level, self._options.gate)
            if len(self._found) > 64:
                self._found.clear()
            self._found[key] = found
        return found

    def normal_equations(self, pose: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> NormalEquations:
        """Return H, g and cost at `pose` (3,): (6.17) to (6.19) with the offsets eliminated, and `slope` discounted."""
        options, clusters, store = self._options, self.clusters[level], self._stores[level]
        found = self._at(pose, level)
        out = np.empty((4, 3))
        cost = kernels.normal_equations(
            store.control, store.table, store.step, clusters.points, clusters.chord, found.run, found.feet, found.runs,
            pose, found.heading, 1.0 / options.sigma, self._along, options.missing / options.sigma, self._n,
            self._weight, CODES[loss], scale, out,
        )  # fmt: skip
        kernels.discount(out, options.slope * options.slope)
        return NormalEquations(out[:3], out[3], cost, self._met(found, pose, level), self._holdable(level))

    def _met(self, found: Association, pose: F64, level: int) -> int:
        """Return how many beams met the map: those on curves, in front of one, or behind a wall."""
        return int(np.count_nonzero((found.run != -1) | self.barred(pose, level)))

    def _holdable(self, level: int) -> int:
        """Return how many beams a map of curves can explain: those in clusters, but at least half of all."""
        return max(len(self.clusters[level].points), self._n // 2)

    def costs(self, poses: F64, level: int, loss: Loss = "none", scale: float = 1.0) -> F64:
        """Return the cost at each of `poses` (k, 3): shape (k,)."""
        options, clusters, store = self._options, self.clusters[level], self._stores[level]
        out = np.empty(len(poses))
        if len(poses) > 2:
            self._widen(poses, level)
        for k, pose in enumerate(poses):
            found = self._at(pose, level)
            out[k] = kernels.cost_of(
                store.control, store.table, store.step, clusters.points, clusters.chord, found.run, found.feet,
                found.runs, pose, 1.0 / options.sigma, self._along, options.missing / options.sigma, self._n,
                self._weight, CODES[loss], scale,
            )  # fmt: skip
        return out

    def _widen(self, poses: F64, level: int) -> None:
        """Look up once around all of `poses`."""
        points = self.clusters[level].points
        if not len(points):
            return
        reach = float(np.hypot(points[:, 0], points[:, 1]).max()) + 2.0 * self._options.gate
        (x0, y0), (x1, y1) = poses[:, :2].min(axis=0).tolist(), poses[:, :2].max(axis=0).tolist()
        self._lookups[level].covering((x0 - reach, y0 - reach, x1 + reach, y1 + reach))

    def residuals(self, pose: F64, level: int) -> tuple[F64, F64]:
        """Return whitened residuals (3 n,) and their Jacobian (3 n, 3).

        For each beam those across and along its curve, and what the curve lacks of full trust, a constant.
        """
        options, clusters, store = self._options, self.clusters[level], self._stores[level]
        found = self._at(pose, level)
        residuals, rows = np.empty(3 * self._n), np.empty((3 * self._n, 3))
        kernels.jacobian(
            store.control, store.table, store.step, clusters.points, clusters.chord, found.run, found.feet, found.runs,
            pose, found.heading, 1.0 / options.sigma, self._along, options.missing / options.sigma, self._weight,
            residuals, rows,
        )  # fmt: skip
        return residuals, rows

    def inliers(self, pose: F64, level: int) -> float:
        """Return the share of the beams that curves can hold which end near one, in [0, 1]."""
        if not self._n:
            return 0.0
        found = self.association(pose, level, max(self._options.explained, 0.25 * self._stores[level].step))
        return int(np.count_nonzero(found.run >= 0)) / max(self._holdable(level), 1)

    def tracks(self, pose: F64, level: int) -> list[Track]:
        """Return which stretches of the scan lie on which curves at `pose` (3,)."""
        options, clusters, store = self._options, self.clusters[level], self._stores[level]
        found = self._at(pose, level)
        out = []
        for j, (begin, end, curve, _, cluster, _) in enumerate(found.runs):
            offset = kernels.offset_of(
                store.control, store.table, store.step, clusters.points, clusters.chord, found.run, found.feet,
                found.runs, j, pose, 1.0 / options.sigma, self._along or 0.1 / options.sigma, 0, 1.0,
            )  # fmt: skip
            length = clusters.chord[int(end) - 1] - clusters.chord[int(begin)]
            out.append(Track(int(cluster), int(curve), float(offset * store.step), float(length)))
        return out


def box_at(points: F64, pose: F64, margin: float) -> tuple[float, float, float, float]:
    """Return x0, y0, x1, y1 around robot-frame points (n, >= 2) seen from `pose` (3,), and `margin` [m] around."""
    if not len(points):
        return pose[0] - margin, pose[1] - margin, pose[0] + margin, pose[1] + margin
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x = pose[0] + c * points[:, 0] - s * points[:, 1]
    y = pose[1] + s * points[:, 0] + c * points[:, 1]
    return float(x.min()) - margin, float(y.min()) - margin, float(x.max()) + margin, float(y.max()) + margin
