"""Back up (conditions 1 and 3 of Theorem 8.2 for two inputs), localise the goal, drive there."""

import math

import numpy as np

from knotwork.core import geometry
from knotwork.core.contracts import Context, Policy
from knotwork.core.depth.base import backing_up, drive_to, goal_pose, move_goal, swing_rate
from knotwork.core.errors import InputError
from knotwork.core.geometry import Pose2
from knotwork.core.messages import F64, Depths, Odometry, ServoState, Twist
from knotwork.plugins.policies.active_base import Config

BACKING, DRIVING, THERE = 1, 2, 3


class ActiveBase(Policy):
    """One command for each frame of depths; without enough features it goes on by odometry or its own commands."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.config: Config = context.config
        if not all(math.isfinite(value) for point in self.config.goal.values() for value in point):
            raise InputError("goal: coordinates must be finite", where=context.name)
        self._goal = dict(self.config.goal)
        self._phase = BACKING
        self._pose = np.zeros(3)
        self._known = False
        self._command = np.zeros(2)
        self._way = 0.0
        self._begun = 0.0
        self._stopped = -1.0
        self._last: int | None = None
        self._odometry: Pose2 | None = None
        self._before: Pose2 | None = None  # at the last frame

    def warm(self) -> None:
        """Compile the kernels."""
        s = np.array(((0.1, 0.1), (-0.1, 0.1), (0.1, -0.1)))
        goal_pose(s, np.ones(3), s.copy(), 0.0, np.zeros(3))
        backing_up(0.0, 0.0, False, 1.0, 0.0, 0.1, -1.0)
        swing_rate(0.0, 1.0, 0.1, 0.1)
        move_goal(np.zeros(3), 0.0, 0.0, 0.0)
        drive_to(np.ones(3), 1.0, 1.0, 1.0, np.zeros(2))

    def open(self) -> None:
        """Watch for silence."""
        self.context.every(self.config.timeout, self._watch)

    def on_odometry(self, message: Odometry) -> None:
        """Take a pose of the base: what it has really driven, also when something stopped it."""
        if message.discontinuity or not np.isfinite(message.pose).all():
            self._odometry = self._before = None
            return
        x, y, yaw = message.pose.tolist()
        self._odometry = (x, y, yaw)

    def on_depths(self, message: Depths) -> None:
        """Answer a frame of depths."""
        config = self.config
        step = 0.0 if self._last is None else max(0.0, (message.stamp - self._last) * 1e-9)
        self._last = message.stamp
        v, w = self._moved(step)
        move_goal(self._pose, v, w, step)
        if self._phase == BACKING and self._command[0] < 0.0:
            self._way += max(0.0, -v) * step
        usable = np.isfinite(message.chi) & (message.chi > 0.0)
        if not self._goal and len(message.ids) >= config.needed:
            points = message.points.tolist()
            self._goal = {name: (x, y) for name, (x, y) in zip(message.ids.tolist(), points, strict=True)}
            self._pose[:], self._known = 0.0, True  # here; should its features be lost, the way leads back
            self.context.report("info", f"the goal is the view of this frame, {len(points)} features")
        chosen = [i for i, name in enumerate(message.ids.tolist()) if name in self._goal and usable[i]]
        ids = message.ids[chosen]
        s, chi = np.ascontiguousarray(message.points[chosen]), message.chi[chosen]
        goal = np.array([self._goal[name] for name in ids.tolist()]).reshape(-1, 2)
        error = float(np.linalg.norm(s - goal))
        certain = np.zeros(len(chosen))
        if message.variance is not None:
            certain = np.minimum(1.0, config.deviation * chi / np.sqrt(message.variance[chosen]))
        if self._phase == BACKING:
            self._back_up(step, len(chosen) > 0, bool((certain >= 1.0).all()))
        if self._phase != BACKING:
            self._drive(s, chi, goal, error)
        v, w = self._command.tolist()
        self.context.emit("twist", Twist(stamp=self.context.now(), vx=v, wz=w))
        state = ServoState(
            stamp=message.stamp, phase=self._phase, error=error, ids=ids, certainty=certain,
            exciting=bool(self._phase == BACKING and self._command.any()),
        )  # fmt: skip
        self.context.emit("state", state)

    def _moved(self, step: float) -> tuple[float, float]:
        """Return the velocities (v, w) [m/s, rad/s] since the last frame: by odometry, or as commanded without it."""
        v, w = self._command.tolist()
        if self._odometry is not None:
            if self._before is not None and step > 0.0:
                forward, _, turn = geometry.log(geometry.relative(self._before, self._odometry))
                v, w = forward / step, turn / step
            self._before = self._odometry
        return v, w

    def _back_up(self, step: float, any_seen: bool, certain: bool) -> None:
        config = self.config
        self._command[:] = 0.0
        if not any_seen:
            self.context.count("no_features")
            return
        self._begun += step  # the pause counts frames with features only
        stride = config.v_max * step
        moving = backing_up(self._begun, self._way, certain, config.back, config.pause, stride, self._stopped)
        if moving < 0.0:
            self._phase = DRIVING
            which = "all" if certain else "not all"
            self.context.report("info", f"{which} depths are certain after {self._way:.2f} m back")
        elif moving > 0.0:
            rate = swing_rate(self._way + 0.5 * stride, config.back, config.swing, config.v_max)
            self._command[:] = -config.v_max, min(max(rate, -config.w_max), config.w_max)
        elif self._way > 0.0 and self._stopped < 0.0:
            self._stopped = self._begun

    def _drive(self, s: F64, chi: F64, goal: F64, error: float) -> None:
        config = self.config
        if len(s) >= config.needed and goal_pose(s, chi, goal, config.offset, self._pose):
            self._known = True
        else:
            self.context.count("frames_without_goal_pose")
        self._command[:] = 0.0
        if self._known:
            drive_to(self._pose, config.gain, config.v_max, config.w_max, self._command)
        # Stopping asks for a small error, going on again for twice that.
        bound = config.tolerance * math.sqrt(2.0 * max(len(s), 1)) * (2.0 if self._phase == THERE else 1.0)
        self._phase = THERE if len(s) >= config.needed and error < bound else DRIVING
        if self._phase == THERE:
            self._command[:] = 0.0

    def _watch(self, time: int) -> None:
        if self._last is not None and (time - self._last) * 1e-9 > self.config.timeout:
            self.context.count("silences")
            self._command[:] = 0.0
            self.context.emit("twist", Twist(stamp=time, vx=0.0))
