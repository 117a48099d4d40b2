"""What maps of cells share: levels of tiles, alignment, rays that claim their tiles."""

from abc import abstractmethod
from typing import Any, Self

import numpy as np

from knotwork.core.beams import Beams, beams_of
from knotwork.core.cells.alignment import CellAlignment, CellLevel
from knotwork.core.cells.config import CellOptions
from knotwork.core.cells.interpolation import CODES
from knotwork.core.contracts import Alignment, Context
from knotwork.core.map_base import PlaneMap
from knotwork.core.messages import F64, Scan
from knotwork.core.splines import TiledArray


class CellMap(PlaneMap):
    """Base of maps that hold one number a cell to align with, at every level.

    A subclass makes empty cells (`clear`), fuses into one level and says how its values are read.
    """

    options: CellOptions
    cells: list[TiledArray]

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.options = context.options
        self.renew()

    @abstractmethod
    def clear(self) -> None:
        """Set `cells`, and what else is stored, to an empty map."""

    @abstractmethod
    def view(self, level: int) -> CellLevel:
        """Return how an alignment reads a level."""

    @abstractmethod
    def fuse(self, level: int, step: float, beams: Beams, pose: F64) -> None:
        """Fuse beams seen from `pose` (3,) into one level of cells of the side `step` [m]."""

    def warm(self) -> None:
        """Compile all kernels on a scan of two beams."""
        spare = self._spare()
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

    def _spare(self) -> Self:
        """Return an empty map of the same configuration, outside of the run."""
        spare = type(self).__new__(type(self))
        spare.__dict__.update(self.__dict__)
        spare.renew()
        return spare

    def renew(self) -> None:
        """Forget everything."""
        self.clear()
        self.adopt(0)

    def adopt(self, fused: int) -> None:
        """Go on with the `cells` as they are now, of so many scans."""
        self._fused = fused
        self._views = [self.view(level) for level in range(self.levels)]

    def alignment(self, scan: Scan, guess: F64, motion: F64 | None = None) -> Alignment:
        """Prepare `scan`; the guess does not matter to this map."""
        beams = beams_of(scan, self.config.range_min, self.config.range_max, motion)
        points = beams.points
        if not self.options.normals:
            points = points.copy()
            points[:, 2:] = 0.0
        return CellAlignment(beams, points, self._views, CODES[self.options.interpolation], self.options.beams)

    def update(self, scan: Scan, pose: F64, alignment: Alignment | None = None, fuse: bool = True) -> None:
        """Fuse `scan` taken at robot `pose` (3,); nothing with `fuse=False` or `fuse: false` in the config."""
        if not fuse or not self.config.fuse:
            return
        if isinstance(alignment, CellAlignment):
            beams = alignment.beams
        else:
            beams = beams_of(scan, self.config.range_min, self.config.range_max)
        if not len(beams.rays):
            return
        for level, step in enumerate(self.config.resolution):
            self.fuse(level, step, beams, pose)
        self._fused += 1

    def empty(self) -> bool:
        """Return True as long as nothing has been fused or loaded."""
        return self._fused == 0

    def bounds(self) -> tuple[float, float, float, float]:
        """Return the box (x0, y0, x1, y1) [m] of the finest level's tiles."""
        step = self.config.resolution[-1]
        i0, j0, i1, j1 = self.cells[-1].bounds()
        return i0 * step, j0 * step, i1 * step, j1 * step

    def facts(self) -> dict[str, Any]:
        """Return the facts of a map file."""
        return {"resolution": list(self.config.resolution), "fused": self._fused}
