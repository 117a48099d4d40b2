"""Corners followed from picture to picture (Lucas and Kanade), each with an id that is never used again."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from knotwork.core.messages import F64, I64
from knotwork.plugins.drivers.camera import Tracking

Picture = NDArray[np.uint8]


class Tracker:
    """Follows up to `features` corners; lost ones are replaced by new corners elsewhere."""

    def __init__(self, config: Tracking) -> None:
        self._config = config
        self._last: Picture | None = None
        self._points = np.empty((0, 2), dtype=np.float32)
        self._ids: I64 = np.empty(0, dtype=np.int64)
        self._next = 0

    def follow(self, picture: Picture) -> tuple[I64, F64]:
        """Return ids (n,) and pixels (n, 2) of the points in a grey picture (rows, columns)."""
        if self._last is not None and self._last.shape == picture.shape and len(self._points):
            self._track(self._last, picture)
        else:
            self._points, self._ids = self._points[:0], self._ids[:0]
        self._refill(picture)
        self._last = picture
        return self._ids.copy(), self._points.astype(np.float64)

    def _track(self, last: Picture, picture: Picture) -> None:
        options: dict[str, Any] = {"winSize": (self._config.window, self._config.window), "maxLevel": 3}
        none: Any = None
        there, found, _ = cv2.calcOpticalFlowPyrLK(last, picture, self._points[:, None], none, **options)
        back, returned, _ = cv2.calcOpticalFlowPyrLK(picture, last, there, none, **options)
        there, back = there[:, 0], back[:, 0]
        rows, columns = picture.shape
        kept = (found[:, 0] == 1) & (returned[:, 0] == 1)
        kept &= np.hypot(*(back - self._points).T) <= self._config.round_trip
        kept &= (there >= 0).all(axis=1) & (there[:, 0] < columns) & (there[:, 1] < rows)
        self._points, self._ids = there[kept], self._ids[kept]

    def _refill(self, picture: Picture) -> None:
        missing = self._config.features - len(self._points)
        if missing <= 0:
            return
        free: Any = np.full(picture.shape, 255, dtype=np.uint8)
        for x, y in self._points.tolist():
            cv2.circle(free, (round(x), round(y)), round(self._config.distance), 0, -1)
        new: Any = cv2.goodFeaturesToTrack(picture, missing, self._config.quality, self._config.distance, mask=free)
        if new is None:
            return
        self._points = np.concatenate((self._points, new[:, 0]))
        self._ids = np.concatenate((self._ids, np.arange(self._next, self._next + len(new))))
        self._next += len(new)
