"""What a 2D world is made of: straight segments and circular arcs, a start pose and named paths."""

from dataclasses import dataclass, field

import numpy as np

from knotwork.core.geometry import IDENTITY, Pose2
from knotwork.core.messages import F64
from knotwork.core.obstacle import Obstacle

_CHORD = 0.3  # rad; a longer arc is planned around as several chords
_DISC = 2.0  # m; a smaller circle is a pillar and nobody stands in it


@dataclass(frozen=True, eq=False)
class World:
    """Obstacles of a planar world, in its own frame.

    Attributes
    ----------
    segments : shape (n, 4)
        x1, y1, x2, y2 [m] of each straight obstacle.
    arcs : shape (m, 5)
        Centre x, y [m], radius [m], first angle and signed sweep [rad] of each arc; a sweep of 2 pi
        is a circle.
    start
        Where a robot starts unless it is told otherwise.
    paths
        Named lists of waypoints, each of shape (k, 2) [m], in the world's frame.
    """

    name: str
    segments: F64
    arcs: F64 = field(default_factory=lambda: np.empty((0, 5)))
    start: Pose2 = IDENTITY
    paths: dict[str, F64] = field(default_factory=dict)
    about: str = ""

    def bounds(self) -> tuple[float, float, float, float]:
        """Return the smallest x, y and largest x, y of all obstacles (whole circles for arcs) [m]."""
        x = [self.segments[:, 0::2].ravel()]
        y = [self.segments[:, 1::2].ravel()]
        for sign in (-1.0, 1.0):
            x.append(self.arcs[:, 0] + sign * self.arcs[:, 2])
            y.append(self.arcs[:, 1] + sign * self.arcs[:, 2])
        xs, ys = np.concatenate(x), np.concatenate(y)
        return float(xs.min()), float(ys.min()), float(xs.max()), float(ys.max())

    def obstacles(self) -> list[Obstacle]:
        """Return everything as shapes to plan around, in the world's frame; arcs as chords grown by their sagitta."""
        shapes = [Obstacle(segment.reshape(2, 2)) for segment in self.segments]
        for x, y, radius, first, sweep in self.arcs.tolist():
            if abs(sweep) >= 2 * np.pi - 1e-9 and radius < _DISC:
                shapes.append(Obstacle(np.array([[x, y]]), radius))
                continue
            count = max(int(np.ceil(abs(sweep) / _CHORD)), 1)
            angle = first + sweep * np.arange(count + 1) / count
            ends = np.column_stack((x + radius * np.cos(angle), y + radius * np.sin(angle)))
            sagitta = radius * (1.0 - np.cos(0.5 * abs(sweep) / count))
            shapes += [Obstacle(ends[k : k + 2], sagitta) for k in range(count)]
        return shapes


def polyline(points: F64, closed: bool = False) -> F64:
    """Return the segments (k, 4) that join `points` (n, 2) in order; `closed` joins the last to the first."""
    points = np.asarray(points, dtype=np.float64)
    ends = np.roll(points, -1, axis=0)
    segments = np.hstack((points, ends))
    return segments if closed else segments[:-1]


def box(x1: float, y1: float, x2: float, y2: float) -> F64:
    """Return the four segments of the rectangle with opposite corners (x1, y1) and (x2, y2) [m]."""
    return polyline(np.array([(x1, y1), (x2, y1), (x2, y2), (x1, y2)]), closed=True)
