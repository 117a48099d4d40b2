"""The map `tsdf`: truncated signed distances, coarse to fine."""

from typing import Any

import numpy as np

from knotwork.core.beams import Beams
from knotwork.core.cells.alignment import CellLevel
from knotwork.core.cells.interpolation import lookup
from knotwork.core.cells.map import CellMap
from knotwork.core.cells.traversal import claim
from knotwork.core.map_file import Arrays
from knotwork.core.messages import F64
from knotwork.core.splines import TiledArray
from knotwork.core.splines.tiles import SIDE
from knotwork.plugins.maps.tsdf import TsdfOptions, kernels

_LIMIT = 32767  # quanta in a truncation distance
_SURFACE = 0.75  # [cells] a cell is occupied if its centre is nearer to a surface than this
_SURE = 1.0  # measurements after which occupancy is half of what it ends at
_FINEST_SHARE = 10  # a passing beam weighs at least this part of a measured distance


class TsdfMap(CellMap):
    """Cells hold the mean signed distance [m] of their centres to the surface that beams hit, and its weight.

    After J. Fossel et al., "2D-SDF-SLAM" (2015) and K. Daun et al., "Large scale 2D laser SLAM using truncated
    signed distance functions" (2019). A beam that passes weighs free / hit of one that ends near. Residual of
    a beam: the distance where it ends / sigma.
    """

    kind = "tsdf"
    options: TsdfOptions

    def clear(self) -> None:
        """Forget all cells."""
        self.cells = [TiledArray(np.int16, kernels.UNKNOWN) for _ in self.config.resolution]
        self.weights = [TiledArray(np.uint8) for _ in self.config.resolution]

    def truncation(self, level: int) -> float:
        """Return the distance [m] at which a level cuts off."""
        options = self.options
        return max(options.truncation, options.truncation_cells * self.config.resolution[level])

    def view(self, level: int) -> CellLevel:
        """Return how an alignment reads a level."""
        step, truncation = self.config.resolution[level], self.truncation(level)
        quantum, sigma = truncation / _LIMIT, self.options.sigma
        near = max(0.1, step) / quantum
        return CellLevel(
            self.cells[level], step, quantum / sigma, 0.0, truncation / sigma, kernels.UNKNOWN, True, (-near, near)
        )

    def fuse(self, level: int, step: float, beams: Beams, pose: F64) -> None:
        """Fuse beams into one level."""
        config, options = self.config, self.options
        cells, weights, truncation = self.cells[level], self.weights[level], self.truncation(level)
        behind = options.behind * truncation
        claim(cells, step, beams.rays, pose, config.range_min, behind, options.free_no_return)
        weights.commit(cells.used)  # the two share a directory
        kernels.fuse(
            *cells.arrays(), weights.pool, step, beams.rays, beams.points, pose, truncation, truncation / _LIMIT,
            config.range_min, options.free_no_return, behind, *self._weights(), options.distance == "normal",
        )  # fmt: skip

    def _weights(self) -> tuple[int, int, int]:
        """Return the weights of a measured distance, of a passing beam, and the largest of a cell."""
        config = self.config
        near = min(max(round(config.hit / config.free), 1), _FINEST_SHARE) if config.free else 1
        return near, int(config.free > 0), min(self.options.weight_max * near, 255)

    def occupancy(self, points: F64) -> F64:
        """Return occupancy in [-1, 1] at `points` (n, 2), of the finest level's cells; shape (n,).

        Occupied at a surface, free in front of it, unknown behind it, and the more so the more beams said it.
        """
        rows = np.ascontiguousarray(points, np.float64)
        step, cells = self.config.resolution[-1], self.cells[-1]
        raw = lookup(*cells.arrays(), step, rows)
        weight = lookup(self.weights[-1].pool, *cells.arrays()[1:], step, rows)
        distance = raw * (self.truncation(self.levels - 1) / _LIMIT) / (_SURFACE * step)  # 1: half occupied
        front, back = 1.0 - 2.0 * np.minimum(0.5 * distance**2, 1.0), np.maximum(1.0 + 0.5 * distance, 0.0)
        shape = np.where(distance >= 0, front, back)
        known: F64 = np.where(raw == kernels.UNKNOWN, 0.0, shape * weight / (weight + _SURE * self._weights()[0]))
        return known

    @property
    def nbytes(self) -> int:
        """Memory of all levels' distances and weights [bytes]."""
        return sum(array.nbytes for array in (*self.cells, *self.weights))

    def stored(self) -> tuple[dict[str, Any], Arrays]:
        """Return what a map file holds: the claimed tiles of each level."""
        arrays: Arrays = {}
        for level, (cells, weights) in enumerate(zip(self.cells, self.weights, strict=True)):
            arrays[f"where{level}"], arrays[f"tiles{level}"] = cells.claimed()
            a, b = np.nonzero(cells.directory)
            arrays[f"weights{level}"] = weights.pool[cells.directory[a, b]]
        return self.facts() | {"truncation": [self.truncation(level) for level in range(self.levels)]}, arrays

    def restore(self, facts: dict[str, Any], arrays: Arrays) -> None:
        """Replace the map."""
        expected = [self.truncation(level) for level in range(self.levels)]
        if not np.allclose(facts["truncation"], expected):
            raise ValueError(f"truncated at {facts['truncation']} m, the config says {expected}")
        cells, weights = [], []
        for level in range(self.levels):
            where, tiles, counts = (arrays[f"{name}{level}"] for name in ("where", "tiles", "weights"))
            if where.shape != (len(tiles), 2) or tiles.shape[1:] != (SIDE, SIDE) or tiles.dtype != np.int16:
                raise ValueError(f"tiles of level {level} have shapes {where.shape} and {tiles.shape}")
            if counts.shape != tiles.shape or counts.dtype != np.uint8:
                raise ValueError(f"weights of level {level} have shape {counts.shape}")
            cells.append(TiledArray.from_claimed(where, tiles, kernels.UNKNOWN))
            weights.append(TiledArray(np.uint8))
            weights[-1].commit(cells[-1].used)
            directory, oi, oj = cells[-1].arrays()[1:]
            weights[-1].pool[directory[where[:, 0] - oi, where[:, 1] - oj]] = counts
        fused = int(facts["fused"])
        self.cells, self.weights = cells, weights
        self.adopt(fused)
