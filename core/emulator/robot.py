"""The body of an emulated robot: wheels that follow goals of their motors, in a simulated world."""

from collections import deque
from typing import NamedTuple

import numpy as np

from knotwork.core.geometry import Pose2, relative
from knotwork.core.world.base import SimulatedBase
from knotwork.core.world.kinematics import body_twist
from knotwork.core.world.motion import Leg, Motion
from knotwork.core.world.parameters import BaseParameters
from knotwork.core.world.raycast import RayCaster
from knotwork.core.world.scene import World

_STEP = 10_000_000  # ns; longest step of the motion
_HISTORY = 1_000_000_000  # ns of motion that a late lidar may look back
_PAUSE = 2_000_000_000  # ns; a process that slept longer than this has missed it, and so has its robot
_SAMPLES = 30_000


class WheelSample(NamedTuple):
    """True rim speeds [m/s] from the last sample to `stamp` [ns since 1970]."""

    stamp: int
    left: float
    right: float


class Robot:
    """Moves with the clock: `advance` brings it to the present.

    Parameters
    ----------
    world
        Where it drives.
    parameters
        Of the base; its limits are those of the motors' mechanics, the firmware's are not its business.
    start
        Pose in the world; None: the world's own.
    seed
        Of slip and sensors.
    now
        Time [ns since 1970].

    Attributes
    ----------
    time
        Of the last step's end [ns since 1970].
    motion
        True path of the last second, or since a lidar looked at it.
    angles
        Of the wheels as the encoders count them, left and right [rad].
    wheels
        The last samples of the true rim speeds.
    """

    def __init__(self, world: World, parameters: BaseParameters, start: Pose2 | None, seed: int, now: int) -> None:
        self.parameters = parameters
        self.obstacles = RayCaster(world)
        self.start = world.start if start is None else start
        self.base = SimulatedBase(parameters, self.obstacles, self.start, seed)
        self.begin(now)
        self.angles = (0.0, 0.0)
        self.wheels: deque[WheelSample] = deque(maxlen=_SAMPLES)
        self._yaw = self._ax = self._ay = self._span = 0.0
        # Compiled now, not when the first reply is due.
        self.motion.poses(now, np.zeros(1))
        self.obstacles.cast(np.zeros((1, 2)), np.array([[1.0, 0.0]]), 1.0)
        self.obstacles.clearance(*self.start[:2])

    @property
    def speeds(self) -> tuple[float, float]:
        """True rim speeds, left and right [m/s]."""
        return self.base.left, self.base.right

    def drive(self, left: float, right: float) -> None:
        """Set the rim speeds that the motors aim at [m/s]."""
        self.base.command(*body_twist(left, right, self.parameters.wheel_separation))

    def ramp(self, acceleration: float) -> None:
        """Set the motors' profile, up and down [m/s^2]; 0: as fast as the mechanics allow."""
        most = self.parameters.acceleration
        rate = min(acceleration, most) if acceleration > 0.0 else most
        if rate != self.base.parameters.acceleration:
            self.base.parameters = self.parameters.model_copy(update={"acceleration": rate, "deceleration": rate})

    def begin(self, now: int) -> None:
        """Set the clock [ns since 1970] without moving; what took time before is not made up for."""
        self.time = now
        self.motion = Motion()
        self.motion.append(Leg(now - _HISTORY, now, self.base.pose, 0.0, 0.0))

    def advance(self, now: int) -> None:
        """Move until `now` [ns]."""
        if now - self.time > _PAUSE:
            self.motion.append(Leg(self.time, now - _STEP, self.base.pose, 0.0, 0.0))
            self.time = now - _STEP
        while self.time < now:
            end = min(self.time + _STEP, now)
            leg, reading = self.base.step(self.time, end)
            period = (end - self.time) * 1e-9
            self.motion.append(leg)
            self.angles = (reading.left, reading.right)
            self._yaw += reading.yaw_rate * period
            self._ax += reading.ax * period
            self._ay += reading.ay * period
            self._span += period
            self.wheels.append(WheelSample(end, self.base.left, self.base.right))
            self.time = end
        self.motion.forget(now - _HISTORY)

    def inertial(self) -> tuple[float, float, float, float]:
        """Return yaw rate [rad/s] and acceleration x, y [m/s^2], means over the time since the last call [s]."""
        span = self._span
        if span <= 0.0:
            return 0.0, 0.0, 0.0, 0.0
        mean = self._yaw / span, self._ax / span, self._ay / span, span
        self._yaw = self._ax = self._ay = self._span = 0.0
        return mean

    def pose(self, frame: str = "map") -> Pose2:
        """Return the true pose at `time`; in "map" the start is the origin, else in the world's frame."""
        return relative(self.start, self.base.pose) if frame == "map" else self.base.pose
