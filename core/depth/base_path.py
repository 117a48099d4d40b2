"""Where the base was when a picture was taken: odometry comes at its own stamps, and often later than the picture."""

from collections import deque

from knotwork.core import geometry
from knotwork.core.geometry import Pose2
from knotwork.core.messages import Odometry

_KEPT = 256  # poses: 5 s at 50 Hz


class BasePath:
    """Recent odometry, asked for the pose at any stamp."""

    def __init__(self) -> None:
        self._poses: deque[tuple[int, Pose2]] = deque(maxlen=_KEPT)

    def add(self, message: Odometry) -> None:
        """Take a pose; one that is not newer than the last is of no use. A discontinuity begins anew."""
        if message.discontinuity:
            self._poses.clear()
        if not self._poses or message.stamp > self._poses[-1][0]:
            x, y, yaw = message.pose.tolist()
            self._poses.append((message.stamp, (x, y, yaw)))

    def covers(self, stamp: int) -> bool:
        """Say whether the newest pose is as late as `stamp` [ns], or there is none at all."""
        return not self._poses or self._poses[-1][0] >= stamp

    def at(self, stamp: int) -> Pose2 | None:
        """Return x [m], y [m], yaw [rad] in the odom frame at `stamp` [ns]; None outside the poses that are kept.

        Between two poses the base moves with a constant twist.
        """
        poses = self._poses
        if not poses or not poses[0][0] <= stamp <= poses[-1][0]:
            return None
        k = len(poses) - 1
        while k > 0 and poses[k - 1][0] >= stamp:
            k -= 1
        if poses[k][0] == stamp:
            return poses[k][1]
        (start, first), (end, second) = poses[k - 1], poses[k]
        return geometry.interpolate(first, second, (stamp - start) / (end - start))
