"""The map `grid`: occupancy grids of log-odds, coarse to fine."""

from typing import Any

import numpy as np

from knotwork.core.beams import Beams
from knotwork.core.cells.alignment import CellLevel
from knotwork.core.cells.interpolation import lookup
from knotwork.core.cells.map import CellMap
from knotwork.core.cells.traversal import claim
from knotwork.core.contracts import Context
from knotwork.core.map_config import MapConfig
from knotwork.core.map_file import Arrays
from knotwork.core.messages import F64
from knotwork.core.splines import TiledArray
from knotwork.core.splines.tiles import SIDE
from knotwork.plugins.maps.grid import GridOptions, kernels

EXPLAINED = 0.5  # [log-odds] a beam that ends where the grid is higher is explained by the map


class GridMap(CellMap):
    """Cells hold log-odds in [-clamp, clamp] as whole numbers of a quantum, 0 where nothing is known.

    In a scan a cell is raised by `hit` if a beam ended in it, or else lowered by `free` if one passed, once.
    Residual of a beam: (1 - log-odds / clamp) / sigma, log-odds interpolated between cell centres.
    """

    kind = "grid"
    options: GridOptions

    def __init__(self, context: Context) -> None:
        self.dtype, self.quantum = storage(context.config)
        super().__init__(context)

    def clear(self) -> None:
        """Forget all cells."""
        self.cells = [TiledArray(self.dtype) for _ in self.config.resolution]

    def view(self, level: int) -> CellLevel:
        """Return how an alignment reads a level."""
        gain = -self.quantum / (self.config.clamp * self.options.sigma)
        offset = 1.0 / self.options.sigma
        explained = (EXPLAINED / self.quantum, np.inf)
        return CellLevel(self.cells[level], self.config.resolution[level], gain, offset, offset, 0.0, False, explained)

    def fuse(self, level: int, step: float, beams: Beams, pose: F64) -> None:
        """Fuse beams into one level."""
        config, options, cells = self.config, self.options, self.cells[level]
        claim(cells, step, beams.rays, pose, config.range_min, 0.0, options.free_no_return)
        marks = np.zeros((cells.used, SIDE), np.uint64)
        kernels.fuse(
            *cells.arrays(), marks, step, beams.rays, pose, *self._amounts(), config.range_min, options.margin,
            options.free_no_return,
        )  # fmt: skip

    def _amounts(self) -> tuple[int, int, int]:
        """Return hit, free and clamp in quanta."""
        config = self.config
        hit, free, clamp = (round(value / self.quantum) for value in (config.hit, config.free, config.clamp))
        return max(hit, 1), free, clamp

    def occupancy(self, points: F64) -> F64:
        """Return 2 p - 1 at `points` (n, 2), p the probability of the finest level's cell; shape (n,)."""
        rows = np.ascontiguousarray(points, np.float64)
        return np.tanh(0.5 * self.quantum * lookup(*self.cells[-1].arrays(), self.config.resolution[-1], rows))

    @property
    def nbytes(self) -> int:
        """Memory of all levels' cells [bytes]."""
        return sum(cells.nbytes for cells in self.cells)

    def stored(self) -> tuple[dict[str, Any], Arrays]:
        """Return what a map file holds: the claimed tiles of each level."""
        arrays: Arrays = {}
        for level, cells in enumerate(self.cells):
            arrays[f"where{level}"], arrays[f"tiles{level}"] = cells.claimed()
        return self.facts() | {"clamp": self.config.clamp, "quantum": self.quantum}, arrays

    def restore(self, facts: dict[str, Any], arrays: Arrays) -> None:
        """Replace the map; a file of another quantum is rounded to this map's."""
        ratio, clamp = float(facts["quantum"]) / self.quantum, self._amounts()[2]
        found = []
        for level in range(self.levels):
            where, tiles = arrays[f"where{level}"], arrays[f"tiles{level}"]
            if where.shape != (len(tiles), 2) or tiles.shape[1:] != (SIDE, SIDE) or tiles.dtype.kind != "i":
                raise ValueError(f"tiles of level {level} have shapes {where.shape} and {tiles.shape}")
            if ratio != 1.0 or tiles.dtype != self.dtype:
                tiles = np.clip(np.rint(tiles * ratio), -clamp, clamp).astype(self.dtype)
            found.append(TiledArray.from_claimed(where, tiles))
        fused = int(facts["fused"])
        self.cells = found
        self.adopt(fused)


def storage(config: MapConfig) -> tuple[type[np.signedinteger[Any]], float]:
    """Return the type of a cell and the log-odds of one unit.

    One byte holds -127 to 127 units: enough if `free`, of which the unit is a whole part, is at least
    clamp / 127. Else two bytes.
    """
    for dtype, limit in ((np.int8, 127), (np.int16, 32767)):
        if config.free == 0:
            return np.int8, config.clamp / 127
        if parts := int(limit * config.free / config.clamp):
            return dtype, config.free / parts
    return np.int16, config.clamp / 32767
