"""The controllers of section 9.1 as a node."""

import numpy as np

from knotwork.core.contracts import Context, Policy
from knotwork.core.depth.single_point import (
    CONSTANT_DEPTH,
    NEAR_GOAL,
    SPICA14,
    VARYING_DEPTH,
    circle_goal,
    single_point_command,
)
from knotwork.core.messages import CameraTwist, Depths, ServoState
from knotwork.plugins.policies.single_point import Config

_VARIANTS = {"spica14": SPICA14, "varying-depth": VARYING_DEPTH, "constant-depth": CONSTANT_DEPTH}


class SinglePoint(Policy):
    """One command for each frame; stands while the feature is out of view for too long."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.config: Config = context.config
        self._variant = _VARIANTS[self.config.variant]
        self._memory = np.zeros(2)
        self._goal = np.zeros(2)
        self._rate = np.zeros(2)
        self._start: int | None = None
        self._last: int | None = None

    def warm(self) -> None:
        """Compile the kernels."""
        single_point_command(self._variant, 0.1, 0.1, 1.0, 0.1, 0.1, 0.1, 0.1, NEAR_GOAL, np.zeros(2), np.zeros(6))
        self._aim(0.0)

    def open(self) -> None:
        """Watch for silence."""
        self.context.every(self.config.timeout, self._watch)

    def on_depths(self, message: Depths) -> None:
        """Answer a frame of depths."""
        config = self.config
        self._start = message.stamp if self._start is None else self._start
        found = np.flatnonzero(message.ids == config.feature)
        if not found.size or not message.chi[found[0]] > 0.0:
            self.context.count("no_features")
            return
        self._last = message.stamp
        (x, y), chi = message.points[found[0]].tolist(), float(message.chi[found[0]])
        self._aim((message.stamp - self._start) * 1e-9)
        ex, ey = x - self._goal[0], y - self._goal[1]
        ahead = 1.0 if config.feed_forward else 0.0
        px, py = ahead * self._rate[0] - config.gain * ex, ahead * self._rate[1] - config.gain * ey
        u = np.zeros(6)
        share = single_point_command(
            self._variant, x, y, chi, px, py, config.v_max, config.w_max, NEAR_GOAL, self._memory, u
        )  # fmt: skip
        self.context.emit("twist", CameraTwist(stamp=self.context.now(), v=u[:3], w=u[3:]))
        state = ServoState(
            stamp=message.stamp, phase=1, error=float(np.hypot(ex, ey)), ids=message.ids[found[:1]],
            certainty=np.zeros(1), exciting=True, solved=share >= 0.0,
        )  # fmt: skip
        self.context.emit("state", state)

    def _aim(self, time: float) -> None:
        config = self.config
        circle_goal(time, *config.goal, config.radius, config.period, self._goal, self._rate)

    def _watch(self, time: int) -> None:
        if self._last is not None and (time - self._last) * 1e-9 > self.config.timeout:
            self.context.count("silences")
            self.context.emit("twist", CameraTwist(stamp=time, v=np.zeros(3), w=np.zeros(3)))
