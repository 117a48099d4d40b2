"""A raster map as square pictures, so that only those that changed travel to a page."""

import base64
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotwork.core.messages import Grid

SIDE = 128  # cells of a tile

Key = tuple[int, int]


class Tiles:
    """The tiles of one stream of grids.

    Tile (i, j) covers cells i*SIDE.. and j*SIDE.. counted from the cell corner `corner`, which all grids of
    the stream share as long as their cells fall on each other.
    """

    def __init__(self) -> None:
        self._resolution = 0.0
        self._corner = (0.0, 0.0, 0.0)  # x [m], y [m], yaw [rad]
        self._cells: dict[Key, NDArray[np.int8]] = {}
        self._pictures: dict[Key, str] = {}
        self._changed: set[Key] = set()
        self._fresh = True  # the page must forget what it has
        self.map_bytes = 0

    def update(self, grid: Grid) -> None:
        """Take a grid; tiles it does not reach are gone."""
        resolution, (x, y, yaw) = grid.resolution, grid.origin
        if not (np.isfinite([resolution, x, y, yaw]).all() and resolution > 0):
            return
        i, j = (round(x / resolution), round(y / resolution)) if yaw == 0 else (0, 0)
        corner = (x - i * resolution, y - j * resolution, yaw)
        if resolution != self._resolution or not np.allclose(corner, self._corner, rtol=0, atol=1e-6 * resolution):
            self._resolution, self._corner = resolution, corner
            self._cells.clear()
            self._pictures.clear()
            self._changed.clear()
            self._fresh = True
        self.map_bytes = grid.map_bytes
        tiles = _cut(grid.cells, i, j)
        if any(key not in tiles for key in self._cells):
            self._fresh = True
            self._cells = {key: cells for key, cells in self._cells.items() if key in tiles}
        for key, cells in tiles.items():
            old = self._cells.get(key)
            if old is None or not np.array_equal(old, cells):
                self._cells[key] = cells
                self._pictures.pop(key, None)
                self._changed.add(key)

    def changes(self) -> dict[str, Any] | None:
        """Return what changed since the last call, None for nothing."""
        if not self._changed and not self._fresh:
            return None
        fresh, self._fresh = self._fresh, False
        keys = list(self._cells) if fresh else [key for key in self._changed if key in self._cells]
        self._changed.clear()
        return self._told(keys, fresh)

    def everything(self) -> dict[str, Any]:
        """Return all tiles."""
        return self._told(list(self._cells), True)

    def _told(self, keys: list[Key], fresh: bool) -> dict[str, Any]:
        return {
            "fresh": fresh,
            "resolution": self._resolution,
            "side": SIDE,
            "corner": self._corner,
            "bytes": self.map_bytes,
            "tiles": [[*key, self._picture(key)] for key in keys],
        }

    def _picture(self, key: Key) -> str:
        found = self._pictures.get(key)
        if found is None:
            found = self._pictures[key] = encode(self._cells[key])
        return found


def encode(cells: NDArray[np.int8]) -> str:
    """Return cells (rows, cols) as a PNG in base64: white free, black occupied, unknown transparent; up is +y."""
    picture = Image.fromarray(np.ascontiguousarray(cells[::-1]).view(np.uint8)).convert("P")
    picture.putpalette(_PALETTE)
    out = BytesIO()
    picture.save(out, "PNG", transparency=_TRANSPARENCY)
    return base64.b64encode(out.getvalue()).decode()


def _cut(cells: NDArray[np.int8], i: int, j: int) -> dict[Key, NDArray[np.int8]]:
    """Return the tiles with a known cell; cell (0, 0) of `cells` is cell (column i, row j) of the plane."""
    rows, columns = cells.shape
    if not rows or not columns:
        return {}
    i0, j0 = i // SIDE, j // SIDE
    i1, j1 = -(-(i + columns) // SIDE), -(-(j + rows) // SIDE)
    whole = np.full(((j1 - j0) * SIDE, (i1 - i0) * SIDE), -1, np.int8)
    whole[j - j0 * SIDE :, i - i0 * SIDE :][:rows, :columns] = cells
    out: dict[Key, NDArray[np.int8]] = {}
    for b in range(j1 - j0):
        for a in range(i1 - i0):
            tile = whole[b * SIDE : (b + 1) * SIDE, a * SIDE : (a + 1) * SIDE]
            if (tile >= 0).any():
                out[i0 + a, j0 + b] = tile.copy()
    return out


_GREY = np.linspace(255, 25, 101).round().astype(np.uint8)
_PALETTE = np.repeat(np.concatenate([_GREY, np.full(155, 25, np.uint8)]), 3).tolist()
_TRANSPARENCY = bytes(255 if value <= 100 else 0 for value in range(256))
