"""The map `spline-surface`: log-odds as cubic B-spline surfaces, coarse to fine."""

import math
from typing import Any

import numpy as np

from knotwork.core.beams import Beams, beams_of
from knotwork.core.contracts import Alignment, Context
from knotwork.core.geometry import wrap
from knotwork.core.map_base import PlaneMap
from knotwork.core.map_file import Arrays
from knotwork.core.messages import F64, Scan
from knotwork.core.splines import TiledArray
from knotwork.core.splines.surface_kernels import cubic_values
from knotwork.core.splines.tiles import SIDE
from knotwork.plugins.maps.spline_surface import SplineSurfaceOptions, kernels
from knotwork.plugins.maps.spline_surface.alignment import SurfaceAlignment

UNITS = 127  # clamp in units of a control point
_GOLDEN = 0.6180339887498949  # its multiples are spread evenly
EXPLAINED = 0.5  # [log-odds] a beam that ends where the surface is higher is explained by the map


class SplineSurface(PlaneMap):
    """Surfaces s of log-odds, in [-clamp, clamp] at their control points (7.15).

    Control points are whole numbers of clamp / 127, one byte each, as long as a hit is at least that much; a change is
    rounded up or down in turns, so that it is right on average. Else they are float32 log-odds.

    A beam that ends at tau raises s(tau) by `hit`, to `clamp` at most, with the least change of control
    points (7.14). Samples before the end lower s by `free` in the same way (7.2, mended: they stop `margin`
    short of it). Each level is fused by itself.
    """

    kind = "spline-surface"
    version = 2  # 1: control points were float32 log-odds

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        options = context.options or SplineSurfaceOptions()
        self.options: SplineSurfaceOptions = options
        whole = self.config.clamp <= UNITS * self.config.hit
        self.unit = self.config.clamp / UNITS if whole else 1.0  # [log-odds] of a control point
        self._clamp = float(UNITS) if whole else self.config.clamp  # in that unit
        self._kind: type[np.int8] | type[np.float32] = np.int8 if whole else np.float32
        self.surfaces = [TiledArray(self._kind) for _ in self.config.resolution]
        self._fused = 0
        self._last: F64 | None = None  # pose of the last fused scan

    def warm(self) -> None:
        """Compile all kernels on a scan of two beams."""
        spare = SplineSurface.__new__(SplineSurface)
        spare.__dict__.update(self.__dict__)
        spare.surfaces = [TiledArray(self._kind) for _ in self.config.resolution]
        scan = Scan(
            stamp=0, scan_id=0, ranges=np.array([1.0, np.inf], np.float32), angle_min=0.0, angle_increment=1.0,
            range_min=0.0, range_max=2.0,
        )  # fmt: skip
        pose = np.zeros(3)
        spare.update(scan, pose)
        alignment = spare.alignment(scan, pose, np.array([0.1, 0.0, 0.1]))
        alignment.normal_equations(pose, 0)
        alignment.costs(pose[None], 0)
        alignment.inliers(pose, 0)
        spare.rasterize()

    def alignment(self, scan: Scan, guess: F64, motion: F64 | None = None) -> Alignment:
        """Prepare `scan`; the guess does not matter to this map."""
        return self._aligned(beams_of(scan, self.config.range_min, self.config.range_max, motion))

    def _aligned(self, beams: Beams) -> SurfaceAlignment:
        config, options = self.config, self.options
        if not options.normals:
            beams.points[:, 2:] = 0.0
        return SurfaceAlignment(
            beams,
            self.surfaces,
            config.resolution,
            self._clamp,
            options.sigma,
            EXPLAINED / self.unit,
            options.beams,
        )

    def update(self, scan: Scan, pose: F64, alignment: Alignment | None = None, fuse: bool = True) -> None:
        """Fuse `scan` taken at robot `pose` (3,); nothing with `fuse=False` or `fuse: false` in the config."""
        if not fuse or not self.config.fuse:
            return
        if isinstance(alignment, SurfaceAlignment):
            beams = alignment.beams
        else:
            beams = beams_of(scan, self.config.range_min, self.config.range_max)
        rays = beams.rays
        if not len(rays):
            return
        config, options = self.config, self.options
        weight = self._weight(pose) / self.unit
        clamp, dither = self._clamp, self._fused * _GOLDEN % 1.0
        reach = self._reach(rays)
        x, y = float(pose[0]), float(pose[1])
        for surface, step in zip(self.surfaces, config.resolution, strict=True):
            surface.cover(
                math.floor((x - reach) / step) - 4, math.floor((y - reach) / step) - 4,
                math.floor((x + reach) / step) + 2, math.floor((y + reach) / step) + 2,
            )  # fmt: skip
            margin = max(options.margin, options.margin_steps * step)
            first, sample, used = 0, 0, surface.used
            while first < 2 * len(rays):
                first, sample, used = kernels.fuse(
                    *surface.arrays(), step, rays, pose, weight * config.hit, weight * config.free, clamp,
                    config.range_min, options.free_step * step, margin, options.free_no_return,
                    dither, first, sample, used,
                )  # fmt: skip
                surface.commit(used)
        self._fused += 1
        self._last = pose

    def _weight(self, pose: F64) -> float:
        """Return for how many scans this one counts: evidence grows with the way, also where scans are rare."""
        if self._last is None:
            return 1.0
        far, turn = self.options.stride
        moved = math.hypot(pose[0] - self._last[0], pose[1] - self._last[1]) / far
        turned = abs(wrap(float(pose[2] - self._last[2]))) / turn
        return min(max(1.0, moved, turned), self.options.strides)

    def _reach(self, rays: F64) -> float:
        """Return a radius around the robot [m] that holds all that the rays touch."""
        lengths = np.where(rays[:, 5] > 0, rays[:, 4], np.minimum(rays[:, 4], self.options.free_no_return))
        return float(lengths.max() + np.abs(rays[:, :2]).sum(axis=1).max())

    def empty(self) -> bool:
        """Return True as long as nothing has been fused or loaded."""
        return self._fused == 0

    def occupancy(self, points: F64) -> F64:
        """Return 2 p - 1 at `points` (n, 2), p the probability of the finest level's log-odds; shape (n,)."""
        step = self.config.resolution[-1]
        rows = np.ascontiguousarray(points, np.float64)
        return np.tanh(0.5 * self.unit * cubic_values(*self.surfaces[-1].arrays(), 0.0, 0.0, step, step, rows))

    def bounds(self) -> tuple[float, float, float, float]:
        """Return the box (x0, y0, x1, y1) [m] of the finest level's tiles."""
        step = self.config.resolution[-1]
        i0, j0, i1, j1 = self.surfaces[-1].bounds()
        return i0 * step, j0 * step, (i1 + 3) * step, (j1 + 3) * step

    @property
    def nbytes(self) -> int:
        """Memory of all levels' control points [bytes]."""
        return sum(surface.nbytes for surface in self.surfaces)

    def stored(self) -> tuple[dict[str, Any], Arrays]:
        """Return what a map file holds: the claimed tiles of each level."""
        arrays: Arrays = {}
        for level, surface in enumerate(self.surfaces):
            arrays[f"where{level}"], arrays[f"tiles{level}"] = surface.claimed()
        facts = {"resolution": list(self.config.resolution), "clamp": self.config.clamp, "fused": self._fused}
        return facts, arrays

    def restore(self, facts: dict[str, Any], arrays: Arrays) -> None:
        """Replace the map; control points of the other kind, as version 1 has them, are converted."""
        surfaces = []
        for level in range(self.levels):
            where, tiles = arrays[f"where{level}"], arrays[f"tiles{level}"]
            if (
                where.shape != (len(tiles), 2)
                or tiles.shape[1:] != (SIDE, SIDE)
                or tiles.dtype not in (np.int8, np.float32)
            ):
                raise ValueError(f"tiles of level {level} have shapes {where.shape} and {tiles.shape}")
            if tiles.dtype != self._kind:
                log_odds = tiles * (self.config.clamp / UNITS) if tiles.dtype == np.int8 else tiles
                if self._kind is np.int8:
                    tiles = np.clip(np.rint(log_odds / self.unit), -UNITS, UNITS).astype(np.int8)
                else:
                    tiles = log_odds.astype(np.float32)
            surfaces.append(TiledArray.from_claimed(where, tiles))
        self._fused = int(facts["fused"])
        self.surfaces = surfaces
