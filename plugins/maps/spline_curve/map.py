"""The map `spline-curve`: obstacles as cubic B-spline curves, coarse to fine."""

import math
from typing import Any

import numpy as np

from knotwork.core.beams import beams_of
from knotwork.core.contracts import Alignment, Context
from knotwork.core.map_base import PlaneMap
from knotwork.core.map_file import Arrays
from knotwork.core.messages import F64, Scan
from knotwork.plugins.maps.spline_curve import SplineCurveOptions, queries
from knotwork.plugins.maps.spline_curve.alignment import CurveAlignment
from knotwork.plugins.maps.spline_curve.fusion import Fusion
from knotwork.plugins.maps.spline_curve.lines import line_normals
from knotwork.plugins.maps.spline_curve.lookup import LookupCache
from knotwork.plugins.maps.spline_curve.segmentation import clusters_of
from knotwork.plugins.maps.spline_curve.stale import remove_stale
from knotwork.plugins.maps.spline_curve.store import CurveStore

_THICK = 0.05  # [m] from a curve to where it is not occupied any more, at least


class SplineCurve(PlaneMap):
    """Curves along what beams hit; each level is fused by itself.

    Clusters of a scan are laid on the curves they belong to, fitted with the curves' knots and averaged
    into them by Theorem 6.1; what is new prolongs a curve, joins two or begins one.
    """

    kind = "spline-curve"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.options: SplineCurveOptions = context.options or SplineCurveOptions()
        self._hold([CurveStore(step) for step in self.config.resolution])
        self._fused = 0
        self._counts = {"begun": 0, "joined": 0, "stale": 0}
        self._overlap = [0.0, 0.0]  # [m] of scans on curves, and beside them, at the finest level

    def _hold(self, stores: list[CurveStore]) -> None:
        self.stores = stores
        reach = self.options.gate + 0.3
        self._lookups = [LookupCache(store, reach) for store in stores]
        self._nearby: tuple[int, queries.Nearby] | None = None

    def warm(self) -> None:
        """Compile all kernels on scans of a small room."""
        spare = SplineCurve.__new__(SplineCurve)
        spare.__dict__.update(self.__dict__)
        spare._hold([CurveStore(step) for step in self.config.resolution])
        spare._counts, spare._overlap = dict(self._counts), [0.0, 0.0]
        scan = Scan(
            stamp=0, scan_id=0, ranges=np.ones(120, np.float32), angle_min=0.0, angle_increment=0.02,
            range_min=0.0, range_max=2.0,
        )  # fmt: skip
        pose = np.zeros(3)
        spare.update(scan, pose)
        spare.update(scan, pose)
        alignment = spare.alignment(scan, pose, np.array([0.1, 0.0, 0.1]))
        alignment.normal_equations(pose, 0)
        alignment.costs(pose[None], 0)
        alignment.inliers(pose, 0)
        spare.rasterize()

    # ---- scans

    def alignment(self, scan: Scan, guess: F64, motion: F64 | None = None) -> Alignment:
        """Prepare `scan` near `guess` (3,)."""
        return self._aligned(scan, guess, motion)

    def _aligned(self, scan: Scan, guess: F64, motion: F64 | None) -> CurveAlignment:
        options = self.options
        beams = beams_of(scan, self.config.range_min, self.config.range_max, motion)
        closed = len(scan.ranges) * abs(scan.angle_increment) > 2.0 * math.pi - 1.5 * abs(scan.angle_increment)
        points = line_normals(beams.points)
        clusters = [
            clusters_of(
                points, max(options.gap * step, options.gap_least), options.gap_line, options.gap_relative,
                options.points, closed,
            )
            for step in self.config.resolution
        ]  # fmt: skip
        if not options.normals:
            for each in clusters:
                each.points[:, 4:] = 0.0
        return CurveAlignment(beams, clusters, self.stores, self._lookups, guess, options)

    def update(self, scan: Scan, pose: F64, alignment: Alignment | None = None, fuse: bool = True) -> None:
        """Fuse `scan` taken at robot `pose` (3,); nothing with `fuse=False` or `fuse: false` in the config."""
        if not fuse or not self.config.fuse:
            return
        pose = np.asarray(pose, np.float64)
        ours = alignment if isinstance(alignment, CurveAlignment) else self._aligned(scan, pose, None)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        options = self.options
        for level, store in enumerate(self.stores):
            self._counts["stale"] += remove_stale(store, ours.beams.rays, pose, options.stale_margin)
            clusters = ours.clusters[level]
            if not len(clusters.points):
                continue
            gate = max(options.fuse_gate, 0.5 * store.step)
            found = ours.association(pose, level, gate)
            points = clusters.points[:, :2] @ np.array([[c, s], [-s, c]]) + pose[:2]
            work = Fusion(store, gate, options.smoothness, options.weight, options.points)
            done = work.apply(clusters, points, found, ours.barred(pose, level))
            self._counts["begun"] += done.begun
            self._counts["joined"] += done.joined
            if level == self.levels - 1:
                self._overlap[0] += done.overlap
                self._overlap[1] += done.new
        self._fused += 1

    def statistics(self) -> dict[str, float]:
        """Return counts of curves and control points of all levels, and the share of scans that lay on curves."""
        on, beside = self._overlap
        return {
            "curves": sum(len(store) for store in self.stores),
            "control_points": sum(len(store.control) for store in self.stores),
            "curves_begun": self._counts["begun"],
            "curves_joined": self._counts["joined"],
            "stale_control_points": self._counts["stale"],
            "overlap": on / (on + beside) if on + beside > 0.0 else 0.0,
        }

    # ---- questions

    def empty(self) -> bool:
        """Return True as long as nothing has been fused or loaded."""
        return self._fused == 0

    def nearest(self, points: F64, reach: float = math.inf) -> queries.Nearest:
        """Return the nearest obstacle of the finest level for each of `points` (n, 2), within `reach` [m]."""
        store = self.stores[-1]
        if self._nearby is None or self._nearby[0] != store.version:
            self._nearby = store.version, queries.Nearby(store)
        return self._nearby[1].nearest(points, reach)

    def length(self, curve: int) -> float:
        """Return the length [m] of an obstacle, a curve of the finest level by its number."""
        return self.stores[-1].curve(curve).length(tolerance=1e-4)

    def hulls(self) -> list[F64]:
        """Return convex polygons (k, 2) [m] that together hold all obstacles, one for each knot interval."""
        return queries.hulls(self.stores[-1])

    def outlines(self) -> list[F64]:
        """Return the finest level's curves as polylines (n, 2), map frame [m]."""
        return queries.outlines(self.stores[-1])

    def occupancy(self, points: F64) -> F64:
        """Return how surely occupied (positive, on a curve) or free (negative, in front of one) `points` (n, 2) are."""
        near = self.nearest(np.asarray(points, np.float64), max(self.options.front, 1.0))
        sure = near.evidence / (near.evidence + 1.0)
        thick = max(0.5 * self.config.resolution[-1], _THICK) + 1e-6
        free = (near.distance < 0.0) & (near.beside > 0.0) & (near.distance >= -self.options.front)
        on = np.abs(near.distance) <= thick
        return np.where(on, sure, np.where(free, -sure, 0.0))

    def bounds(self) -> tuple[float, float, float, float]:
        """Return the box (x0, y0, x1, y1) [m] of the finest level's curves and what is in front of them."""
        control = self.stores[-1].control
        if not len(control):
            return 0.0, 0.0, 0.0, 0.0
        x0, y0 = control.min(axis=0).tolist()
        x1, y1 = control.max(axis=0).tolist()
        margin = max(self.options.front, _THICK)
        return x0 - margin, y0 - margin, x1 + margin, y1 + margin

    @property
    def nbytes(self) -> int:
        """Memory of all levels: 9 bytes a control point and 12 a curve."""
        return sum(store.nbytes for store in self.stores)

    def stored(self) -> tuple[dict[str, Any], Arrays]:
        """Return what a map file holds: control points, weights and table of each level."""
        arrays: Arrays = {}
        for level, store in enumerate(self.stores):
            arrays[f"control{level}"] = store.control
            arrays[f"weight{level}"] = store.weight
            arrays[f"table{level}"] = store.table
        return {"resolution": list(self.config.resolution), "fused": self._fused}, arrays

    def restore(self, facts: dict[str, Any], arrays: Arrays) -> None:
        """Replace the map."""
        stores = [
            CurveStore.of_arrays(step, *(arrays[f"{name}{level}"] for name in ("control", "weight", "table")))
            for level, step in enumerate(self.config.resolution)
        ]
        self._fused = int(facts["fused"])
        self._hold(stores)
