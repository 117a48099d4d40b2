"""A 2-D array over all integer indices, negative ones too, that costs memory only where it is used.

Elements live in square tiles of `SIDE` elements: `pool` (capacity, SIDE, SIDE). `directory` (ni, nj)
holds the pool slot of each tile of a box of tiles whose first has tile coordinates (oi, oj). Slot 0 is
the background: every tile that was never claimed reads as it, nothing may be written to it. Growing
copies at most the directory (4 bytes a tile); the pool is extended in place.

Kernels take the four as arguments: `pool, directory, oi, oj = tiled.arrays()`, fetched anew after
anything that reserves.
"""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from knotwork.core.errors import KnotworkError
from knotwork.core.kernel import inlined, kernel

Array = NDArray[Any]

BITS = 6
SIDE = 1 << BITS
MASK = SIDE - 1
_MAX_DIRECTORY = 1 << 26  # tiles in the bounding box: 13 km by 13 km of 5 cm cells


@inlined
def slot_of(directory: Array, oi: int, oj: int, i: int, j: int) -> int:
    """Return the slot of the tile that holds element (i, j), 0 (the background) where none was claimed."""
    a = np.uint64((i >> BITS) - oi)
    b = np.uint64((j >> BITS) - oj)
    if a < np.uint64(directory.shape[0]) and b < np.uint64(directory.shape[1]):
        return int(directory[a, b])
    return 0


@inlined
def read(pool: Array, directory: Array, oi: int, oj: int, i: int, j: int) -> float:
    """Return element (i, j)."""
    slot = np.uint64(slot_of(directory, oi, oj, i, j))
    return pool[slot, np.uint64(i & MASK), np.uint64(j & MASK)]  # type: ignore[no-any-return]


@inlined
def in_one_tile(i: int, j: int, width: int) -> bool:
    """Return whether the patch of width x width elements that starts at (i, j) lies in one tile."""
    return (i & MASK) <= SIDE - width and (j & MASK) <= SIDE - width


@kernel
def claim_patch(directory: Array, oi: int, oj: int, i: int, j: int, width: int, used: int) -> int:
    """Give the up to four tiles under the patch at (i, j) a slot each; return the new number of slots.

    The directory must cover the patch (`TiledArray.cover`), `width` be at most SIDE. Start with
    `TiledArray.used` and hand the last result to `TiledArray.commit`.
    """
    a0, a1 = (i >> BITS) - oi, ((i + width - 1) >> BITS) - oi
    b0, b1 = (j >> BITS) - oj, ((j + width - 1) >> BITS) - oj
    for a in range(a0, a1 + 1):
        for b in range(b0, b1 + 1):
            if directory[a, b] == 0:
                directory[a, b] = used
                used += 1
    return used


@kernel
def claim_patches(directory: Array, oi: int, oj: int, first: Array, width: int, used: int) -> int:
    """Claim the tiles of all patches that start at `first` (n, 2); return the new number of slots."""
    for k in range(first.shape[0]):
        used = claim_patch(directory, oi, oj, first[k, 0], first[k, 1], width, used)
    return used


class TiledArray:
    """A 2-D array that grows in any direction; memory follows the touched area.

    Parameters
    ----------
    dtype
        Element type, float32 unless told.
    fill
        Value of every element that was never written.
    """

    def __init__(self, dtype: DTypeLike = np.float32, fill: float = 0.0) -> None:
        self.fill = fill
        self.pool: NDArray[Any] = np.full((1, SIDE, SIDE), fill, dtype)
        self.directory: NDArray[np.int32] = np.zeros((0, 0), np.int32)
        self.oi = 0
        self.oj = 0
        self.used = 1  # slots in use, the background included

    @property
    def dtype(self) -> np.dtype[Any]:
        """Element type."""
        return self.pool.dtype

    @property
    def nbytes(self) -> int:
        """Bytes held: all tiles, claimed or in reserve, and the directory."""
        return self.pool.nbytes + self.directory.nbytes

    def arrays(self) -> tuple[NDArray[Any], NDArray[np.int32], int, int]:
        """Return (pool, directory, oi, oj) for kernels; valid until something is reserved."""
        return self.pool, self.directory, self.oi, self.oj

    def cover(self, i0: int, j0: int, i1: int, j1: int) -> None:
        """Make the directory span elements [i0, i1) x [j0, j1); claims no tile.

        Raises
        ------
        KnotworkError
            If the bounding box of the whole array would become absurd (a wild pose or point).
        """
        ni, nj = self.directory.shape
        low_i, high_i = _span(i0 >> BITS, ((i1 - 1) >> BITS) + 1, self.oi, ni)
        low_j, high_j = _span(j0 >> BITS, ((j1 - 1) >> BITS) + 1, self.oj, nj)
        if (low_i, high_i, low_j, high_j) == (self.oi, self.oi + ni, self.oj, self.oj + nj):
            return
        if (high_i - low_i) * (high_j - low_j) > _MAX_DIRECTORY:
            raise KnotworkError(
                f"elements [{i0}, {i1}) x [{j0}, {j1}) are too far from the {ni * SIDE} x {nj * SIDE} that "
                f"begin at ({self.oi * SIDE}, {self.oj * SIDE})",
                hint="look for a wild pose or point",
            )
        grown = np.zeros((high_i - low_i, high_j - low_j), np.int32)
        if ni and nj:
            di, dj = self.oi - low_i, self.oj - low_j
            grown[di : di + ni, dj : dj + nj] = self.directory
        self.directory, self.oi, self.oj = grown, low_i, low_j

    def commit(self, used: int) -> None:
        """Back the slots that kernels have claimed, up to `used`, with tiles."""
        capacity = len(self.pool)
        self.used = used
        if used <= capacity:
            return
        grown = max(used, capacity + capacity // 4, 4)
        shape = (grown, SIDE, SIDE)
        try:
            self.pool.resize(shape)  # large blocks are moved by the page table, not copied
        except ValueError:  # somebody holds a view: leave them the old block
            old = self.pool
            self.pool = np.zeros(shape, old.dtype)
            self.pool[:capacity] = old
        if self.fill:
            self.pool[capacity:] = self.fill

    def reserve_box(self, i0: int, j0: int, i1: int, j1: int) -> None:
        """Claim every tile that meets elements [i0, i1) x [j0, j1)."""
        if i1 <= i0 or j1 <= j0:
            return
        self.cover(i0, j0, i1, j1)
        part = self.directory[
            (i0 >> BITS) - self.oi : ((i1 - 1) >> BITS) - self.oi + 1,
            (j0 >> BITS) - self.oj : ((j1 - 1) >> BITS) - self.oj + 1,
        ]
        missing = part == 0
        count = int(missing.sum())
        part[missing] = np.arange(self.used, self.used + count, dtype=np.int32)
        self.commit(self.used + count)

    def reserve_patches(self, first: NDArray[np.int64], width: int) -> None:
        """Claim the tiles under the width x width patches that start at `first` (n, 2)."""
        if not len(first):
            return
        i0, j0 = (int(v) for v in first.min(axis=0))
        i1, j1 = (int(v) + width for v in first.max(axis=0))
        self.cover(i0, j0, i1, j1)
        self.commit(int(claim_patches(self.directory, self.oi, self.oj, first, width, self.used)))

    def block(self, i0: int, j0: int, i1: int, j1: int) -> NDArray[Any]:
        """Return a copy of elements [i0, i1) x [j0, j1)."""
        out = np.full((max(i1 - i0, 0), max(j1 - j0, 0)), self.fill, self.dtype)
        for _, inside, tile in self._pieces(i0, j0, i1, j1):
            out[inside] = tile
        return out

    def write_block(self, i0: int, j0: int, values: NDArray[Any], *, claim: bool = True) -> None:
        """Write `values` (n, m) from element (i0, j0) on; without `claim` only into tiles that exist."""
        i1, j1 = i0 + values.shape[0], j0 + values.shape[1]
        if claim:
            self.reserve_box(i0, j0, i1, j1)
        for _, inside, tile in self._pieces(i0, j0, i1, j1):
            tile[...] = values[inside]

    def blend_block(self, i0: int, j0: int, values: NDArray[Any], share: float, known: int) -> None:
        """Mix `share` of `values` into tiles of slots below `known`, write it into all others."""
        i1, j1 = i0 + values.shape[0], j0 + values.shape[1]
        self.reserve_box(i0, j0, i1, j1)
        for slot, inside, tile in self._pieces(i0, j0, i1, j1):
            tile[...] = (1 - share) * tile + share * values[inside] if slot < known else values[inside]

    def bounds(self) -> tuple[int, int, int, int]:
        """Return the box (i0, j0, i1, j1) of the claimed tiles, in elements; all 0 if there is none."""
        a, b = np.nonzero(self.directory)
        if not len(a):
            return 0, 0, 0, 0
        return (
            (int(a.min()) + self.oi) * SIDE,
            (int(b.min()) + self.oj) * SIDE,
            (int(a.max()) + 1 + self.oi) * SIDE,
            (int(b.max()) + 1 + self.oj) * SIDE,
        )

    def claimed(self) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """Return tile coordinates (n, 2) and a copy of the tiles (n, SIDE, SIDE), in row order."""
        a, b = np.nonzero(self.directory)
        where = np.column_stack((a + self.oi, b + self.oj)).astype(np.int64)
        return where, self.pool[self.directory[a, b]]

    @classmethod
    def from_claimed(cls, where: NDArray[np.int64], tiles: NDArray[Any], fill: float = 0.0) -> "TiledArray":
        """Build from what `claimed` returned."""
        made = cls(tiles.dtype, fill)
        if len(where):
            made.reserve_patches(np.ascontiguousarray(where, np.int64) * SIDE, SIDE)
            made.pool[made.directory[where[:, 0] - made.oi, where[:, 1] - made.oj]] = tiles
        return made

    def copy(self) -> "TiledArray":
        """Return an independent copy without reserve."""
        return TiledArray.from_claimed(*self.claimed(), fill=self.fill)

    def _pieces(self, i0: int, j0: int, i1: int, j1: int) -> list[tuple[int, tuple[slice, slice], NDArray[Any]]]:
        """Cut a box at tile borders: (slot, place inside the box, view into the tile), claimed tiles only."""
        pieces = []
        ni, nj = self.directory.shape
        for ti in range(max(i0 >> BITS, self.oi), min(((i1 - 1) >> BITS) + 1, self.oi + ni)):
            low_i, high_i = max(i0, ti * SIDE), min(i1, (ti + 1) * SIDE)
            for tj in range(max(j0 >> BITS, self.oj), min(((j1 - 1) >> BITS) + 1, self.oj + nj)):
                slot = self.directory[ti - self.oi, tj - self.oj]
                low_j, high_j = max(j0, tj * SIDE), min(j1, (tj + 1) * SIDE)
                if slot and low_i < high_i and low_j < high_j:
                    rows = slice(low_i - ti * SIDE, high_i - ti * SIDE)
                    tile = self.pool[slot, rows, low_j - tj * SIDE : high_j - tj * SIDE]
                    inside = slice(low_i - i0, high_i - i0), slice(low_j - j0, high_j - j0)
                    pieces.append((int(slot), inside, tile))
        return pieces


def _span(low: int, high: int, start: int, count: int) -> tuple[int, int]:
    """Return the wider range of tiles that holds both; grows by half its length, so that growth is rare."""
    if count == 0:
        return low - 1, high + 1
    spare = 2 + count // 2
    return (
        start if low >= start else min(low, start - spare),
        start + count if high <= start + count else max(high, start + count + spare),
    )
