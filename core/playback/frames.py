"""The tree of frames of a foreign recording, in the plane."""

import math
from typing import Any

from knotwork.core.geometry import Pose2, compose, inverse
from knotwork.core.playback.config import FrameConfig

_DEPTH = 32  # frames on the way to the base


class Frames:
    """What is known of frames: their names, and where each is in its parent."""

    def __init__(self, config: FrameConfig) -> None:
        self._config = config
        self._parents: dict[str, tuple[str, Pose2]] = {}
        self.unknown: set[str] = set()  # sensor frames whose place nobody has told

    def learn(self, parent: str, child: str, pose: Pose2) -> None:
        """Take a transform; the pose is the child's in the parent."""
        self._parents[_plain(child)] = (_plain(parent), pose)

    def is_base(self, frame: str) -> bool:
        """Whether this is the robot's base."""
        return _plain(frame) in self._config.base

    def is_odom(self, frame: str) -> bool:
        """Whether this is the odometry frame."""
        return _plain(frame) in self._config.odom

    def ours(self, frame: str) -> str:
        """Return the name of a frame as a pipeline's messages use it."""
        if self.is_base(frame):
            return "base"
        return "odom" if self.is_odom(frame) else _plain(frame)

    def mount(self, frame: str) -> Pose2:
        """Return the pose of a sensor on the base; the identity, and `unknown` grows, when nobody has told."""
        known = self._config.mounts.get(frame) or self._config.mounts.get(_plain(frame))
        if known is not None:
            return known
        frame = _plain(frame)
        pose: Pose2 = (0.0, 0.0, 0.0)
        at = frame
        for _ in range(_DEPTH):
            if at in self._config.base:
                return pose
            above = self._parents.get(at)
            if above is None:
                break
            at, step = above
            pose = compose(step, pose)
        # Robots differ in whether the footprint is above the link or below it.
        for name in self._config.base:
            below = self._parents.get(name)
            if below is not None and below[0] == at:
                return compose(inverse(below[1]), pose)
        self.unknown.add(frame)
        return (0.0, 0.0, 0.0)


def planar(translation: Any, rotation: Any) -> Pose2:
    """Return x, y and yaw of a position with x, y and a quaternion with x, y, z, w."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return float(translation.x), float(translation.y), yaw


def _plain(frame: str) -> str:
    return frame.lstrip("/")
