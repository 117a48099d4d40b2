"""The way a robot has gone, as a page draws it: a point where it has moved on by a little."""

import math
from array import array
from typing import Any

from knotwork.core.geometry import Pose2

_STEP = 0.02  # m
_TURNED = 0.2  # rad


class Path:
    """Points of one stream of poses; corrections replace what was drawn."""

    def __init__(self, role: str) -> None:
        self.role = role
        self._scans = array("q")
        self._points = array("d")  # x, y, x, y, ... [m]
        self._last: Pose2 | None = None
        self._told = 0  # points the page has
        self._fresh = True

    def add(self, scan: int, at: Pose2) -> None:
        """Go on to a pose."""
        if self._last is not None:
            near = math.hypot(at[0] - self._last[0], at[1] - self._last[1]) < _STEP
            if near and abs(at[2] - self._last[2]) < _TURNED:
                return
        self._last = at
        self._scans.append(scan)
        self._points.extend((round(at[0], 3), round(at[1], 3)))

    def correct(self, poses: dict[int, list[float]]) -> None:
        """Move the points of these scans."""
        for number, scan in enumerate(self._scans):
            new = poses.get(scan)
            if new is not None and math.isfinite(new[0]) and math.isfinite(new[1]):
                self._points[2 * number], self._points[2 * number + 1] = round(new[0], 3), round(new[1], 3)
                self._fresh = True

    def changes(self) -> dict[str, Any] | None:
        """Return what the page lacks, None for nothing; `at` is the number of the first point given."""
        at = 0 if self._fresh else self._told
        self._fresh = False
        self._told = len(self._scans)
        if at == self._told:
            return None
        return {"role": self.role, "at": at, "points": self._points[2 * at :].tolist()}

    def everything(self) -> dict[str, Any]:
        """Return all points."""
        return {"role": self.role, "at": 0, "points": self._points.tolist()}
