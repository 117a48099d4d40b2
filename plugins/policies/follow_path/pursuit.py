"""Pure pursuit of a polyline: from a pose to a forward speed and a yaw rate."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, cos, hypot, inf, sin, sqrt

Point = tuple[float, float]


class Polyline:
    """Waypoints joined by straight lines, addressed by arc length.

    Parameters
    ----------
    points
        (x, y) [m]; repeated neighbours are dropped.
    closed
        The last point is joined to the first; arc length goes on beyond one turn.
    """

    def __init__(self, points: Sequence[Sequence[float]], closed: bool = False) -> None:
        kept: list[Point] = []
        for x, y in [*points, points[0]] if closed else points:
            if not kept or (x, y) != kept[-1]:
                kept.append((float(x), float(y)))
        if len(kept) < 2:
            raise ValueError("a path needs two different points")
        self.closed = closed
        self._points = kept
        self._starts = [0.0]
        for (ax, ay), (bx, by) in pairwise(kept):
            self._starts.append(self._starts[-1] + hypot(bx - ax, by - ay))
        self.length = self._starts[-1]

    def point(self, s: float) -> Point:
        """Return the point at arc length `s` [m], held at the ends of an open path."""
        i, rest = self._locate(s)
        (ax, ay), (bx, by) = self._points[i], self._points[i + 1]
        share = rest / (self._starts[i + 1] - self._starts[i])
        return ax + share * (bx - ax), ay + share * (by - ay)

    def nearest(self, x: float, y: float, first: float, last: float) -> float:
        """Return the arc length of the point nearest to (x, y) among those from `first` to `last` [m]."""
        best, where = inf, first
        i, rest = self._locate(first)
        begin = first - rest  # arc length at the start of piece i
        while True:
            (ax, ay), (bx, by) = self._points[i], self._points[i + 1]
            size = self._starts[i + 1] - self._starts[i]
            along = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / size
            along = max(min(along, size, last - begin), rest)
            share = along / size
            distance = hypot(ax + share * (bx - ax) - x, ay + share * (by - ay) - y)
            if distance < best:
                best, where = distance, begin + along
            begin += size
            i, rest = i + 1, 0.0
            if i == len(self._points) - 1:
                if not self.closed:
                    return where
                i = 0
            if begin >= last:
                return where

    def _locate(self, s: float) -> tuple[int, float]:
        """Piece that holds arc length `s`, and the distance from its start."""
        s = s % self.length if self.closed else min(max(s, 0.0), self.length)
        i = min(bisect_right(self._starts, s) - 1, len(self._points) - 2)
        return i, s - self._starts[i]


@dataclass(frozen=True, slots=True)
class Limits:
    """How fast to go; the fields are those of the plugin's config."""

    speed: float
    yaw_rate: float
    lateral: float
    braking: float
    look_ahead: float
    turn_above: float
    tolerance: float


class Pursuit:
    """Steers at a point a little ahead on the path.

    Attributes
    ----------
    progress
        Arc length reached [m]; it never falls, so a path may cross itself.
    done
        The end of an open path has been reached.
    """

    def __init__(self, path: Polyline, limits: Limits) -> None:
        self.path = path
        self.limits = limits
        self.progress = 0.0
        self.done = False
        self._turning = False

    def command(self, pose: Sequence[float]) -> tuple[float, float]:
        """Return forward speed [m/s] and yaw rate [rad/s] at a pose (x, y, yaw) in the path's frame."""
        if self.done:
            return 0.0, 0.0
        at = self.limits
        x, y, yaw = pose
        # The search window is short: a later stretch of the path may pass close by.
        self.progress = self.path.nearest(x, y, self.progress, self.progress + 2.0 * at.look_ahead)
        remaining = inf if self.path.closed else self.path.length - self.progress
        tx, ty = self.path.point(self.progress + at.look_ahead)
        c, s = cos(yaw), sin(yaw)
        ahead, left = c * (tx - x) + s * (ty - y), -s * (tx - x) + c * (ty - y)
        distance = hypot(ahead, left)
        if remaining <= at.tolerance or (remaining < at.look_ahead and ahead <= at.tolerance):
            self.done = True
            return 0.0, 0.0
        bearing = atan2(left, ahead)
        # Turning on the spot goes on until well inside the limit, else it would chatter there.
        self._turning = abs(bearing) > (0.3 * at.turn_above if self._turning else at.turn_above)
        if self._turning:
            return 0.0, min(max(2.0 * bearing, -at.yaw_rate), at.yaw_rate)
        curvature = 2.0 * left / distance**2
        v = min(at.speed, sqrt(2.0 * at.braking * min(remaining, distance)))
        if curvature != 0.0:
            v = min(v, at.yaw_rate / abs(curvature), sqrt(at.lateral / abs(curvature)))
        return v, v * curvature
