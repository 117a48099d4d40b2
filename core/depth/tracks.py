"""Which feature has which row: features come and go, arrays follow."""

import numpy as np
from numpy.typing import NDArray

from knotwork.core.messages import F64, I64


def usable(ids: I64, points: F64) -> NDArray[np.bool_]:
    """Return which features can be used (n,): finite coordinates, and the first of each id."""
    mask: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(points), axis=1)
    if ids.size > 1 and not (np.diff(ids) > 0).all():
        _, first = np.unique(np.where(mask, ids, np.iinfo(np.int64).min), return_index=True)
        once = np.zeros(ids.size, dtype=np.bool_)
        once[first] = True
        mask = mask & once
    return mask


class Tracks:
    """Rows of named arrays, one for each feature in memory.

    Parameters
    ----------
    memory
        An unseen feature is kept this long [s].
    shapes
        Names of arrays and the shape of one row.
    """

    def __init__(self, memory: float, **shapes: tuple[int, ...]) -> None:
        self.memory = memory
        self.ids: I64 = np.empty(0, dtype=np.int64)
        self.same = False  # the last frame had exactly the features in memory, in their order
        self.arrays: dict[str, F64] = {name: np.zeros((0, *shape)) for name, shape in shapes.items()}
        self._unseen = np.zeros(0)
        self._row: dict[int, int] = {}

    def __getitem__(self, name: str) -> F64:
        return self.arrays[name]

    def clear(self) -> None:
        """Forget all features."""
        self._keep(np.zeros(self.ids.size, dtype=np.bool_))

    def match(self, ids: I64, step: float) -> tuple[NDArray[np.intp], F64, NDArray[np.intp]]:
        """Find or make the rows of `ids` (k,), all different, seen `step` seconds after the last ones.

        Returns
        -------
        rows
            Row of each of `ids` (k,).
        seen
            1 for each row (m,) that was known before and is seen now.
        fresh
            Rows made now: zeros.
        """
        self.same = np.array_equal(ids, self.ids)
        if self.same:
            self._unseen[:] = 0.0
            return np.arange(ids.size), np.ones(ids.size), np.empty(0, dtype=np.intp)
        self._unseen += step
        known = [self._row.get(i, -1) for i in ids.tolist()]
        self._unseen[[row for row in known if row >= 0]] = 0.0
        if (self._unseen > self.memory).any():
            self._keep(self._unseen <= self.memory)
            known = [self._row.get(i, -1) for i in ids.tolist()]
        rows = np.array(known, dtype=np.intp)
        before = self.ids.size
        seen = np.zeros(before + int((rows < 0).sum()))
        seen[rows[rows >= 0]] = 1.0
        fresh = np.arange(before, seen.size)
        self._extend(ids[rows < 0])
        rows[rows < 0] = fresh
        return rows, seen, fresh

    def _extend(self, ids: I64) -> None:
        self.ids = np.concatenate((self.ids, ids))
        self._unseen = np.concatenate((self._unseen, np.zeros(ids.size)))
        for name, array in self.arrays.items():
            self.arrays[name] = np.concatenate((array, np.zeros((ids.size, *array.shape[1:]))))
        self._row = {i: row for row, i in enumerate(self.ids.tolist())}

    def _keep(self, mask: NDArray[np.bool_]) -> None:
        self.ids = self.ids[mask]
        self._unseen = self._unseen[mask]
        for name, array in self.arrays.items():
            self.arrays[name] = array[mask]
        self._row = {i: row for row, i in enumerate(self.ids.tolist())}
