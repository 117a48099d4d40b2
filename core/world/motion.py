"""Where a robot was at any instant: a history of circular arcs."""

from math import cos, sin
from typing import NamedTuple

import numpy as np

from knotwork.core.geometry import Pose2
from knotwork.core.kernel import kernel
from knotwork.core.messages import F64
from knotwork.core.world.kinematics import arc


class Leg(NamedTuple):
    """A stretch of time at constant speed: from `pose` at `start` [ns] with v [m/s] and w [rad/s]."""

    start: int
    end: int
    pose: Pose2
    v: float
    w: float


class Motion:
    """Legs in the order of time, without gaps; a teleport is a leg that starts elsewhere."""

    def __init__(self) -> None:
        self._legs: list[Leg] = []

    def append(self, leg: Leg) -> None:
        """Add the next leg."""
        self._legs.append(leg)

    def forget(self, before: int) -> None:
        """Drop the legs that end at or before a time [ns]; the last leg stays."""
        drop = 0
        while drop < len(self._legs) - 1 and self._legs[drop].end <= before:
            drop += 1
        del self._legs[:drop]

    def pose(self, time: int) -> Pose2:
        """Return the pose at `time` [ns]; at a border of two legs, the later one's."""
        leg = self._legs[0]
        for later in self._legs[1:]:
            if later.start > time:
                break
            leg = later
        seconds = (time - leg.start) * 1e-9
        return arc(leg.pose, leg.v * seconds, leg.w * seconds)

    def poses(self, start: int, offsets: F64) -> F64:
        """Return poses at many instants.

        Parameters
        ----------
        start
            Time the offsets count from [ns].
        offsets : shape (n,) [s]

        Returns
        -------
        shape (n, 3), x [m], y [m], yaw [rad], not wrapped
        """
        rows = np.array([((leg.start - start) * 1e-9, *leg.pose, leg.v, leg.w) for leg in self._legs])
        return _poses(rows, offsets)


@kernel
def _poses(legs: F64, offsets: F64) -> F64:
    out = np.empty((offsets.shape[0], 3))
    last = legs.shape[0] - 1
    k = 0
    for i in range(offsets.shape[0]):
        t = offsets[i]
        while k < last and legs[k + 1, 0] <= t:
            k += 1
        while k > 0 and legs[k, 0] > t:
            k -= 1
        dt = t - legs[k, 0]
        half = 0.5 * legs[k, 5] * dt
        chord = legs[k, 4] * dt
        if abs(half) > 1e-3:
            chord *= sin(half) / half
        else:
            chord *= 1.0 - half * half / 6.0
        yaw = legs[k, 3] + half
        out[i, 0] = legs[k, 1] + chord * cos(yaw)
        out[i, 1] = legs[k, 2] + chord * sin(yaw)
        out[i, 2] = yaw + half
    return out
