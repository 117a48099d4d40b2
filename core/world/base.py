"""A simulated differential-drive base: commands in, true motion, encoders and inertial readings out."""

from math import floor, isfinite, pi, sqrt
from typing import NamedTuple

import numpy as np

from knotwork.core.geometry import Pose2
from knotwork.core.world.kinematics import arc, body_twist, limited, ramped, wheel_speeds
from knotwork.core.world.motion import Leg
from knotwork.core.world.parameters import BaseParameters, gyro_sigma
from knotwork.core.world.raycast import RayCaster
from knotwork.core.world.seeding import generator

_NS = 1e-9


class Reading(NamedTuple):
    """What the sensors of a base say of the time since the reading before."""

    left: float  # angle of the wheels since the start, as the encoders count it [rad]
    right: float
    yaw_rate: float  # mean over the step [rad/s]
    ax: float  # [m/s^2]
    ay: float


class SimulatedBase:
    """A base in a world, advanced step by step.

    A step goes: the wheels ramp towards the command, then hold their speed; each wheel slips by its
    own scale error and by white noise; the body follows the exact arc of the slipped rim distances.
    Encoders count the wheels, not the ground. A body that touches an obstacle turns on the spot while
    its wheels spin, unless the motion takes it away from the obstacle.

    Parameters
    ----------
    parameters
        Geometry, limits and errors.
    obstacles
        The world; None is open ground.
    pose
        Start pose in the world.
    seed
        Of all its errors.

    Attributes
    ----------
    pose
        True pose in the world: x [m], y [m], yaw [rad].
    left, right
        Rim speeds of the wheels over the last step [m/s].
    blocked
        The last step was stopped by an obstacle.
    """

    def __init__(self, parameters: BaseParameters, obstacles: RayCaster | None, pose: Pose2, seed: int) -> None:
        self.parameters = parameters
        self.pose = pose
        self.left = self.right = 0.0
        self.blocked = False
        self._obstacles = obstacles
        self._goal = (0.0, 0.0)
        self._turns = [0.0, 0.0]  # angle of the wheels [rad]
        self._speed = 0.0
        slip = generator(seed, "slip")
        self._scale = [float(1.0 + e) for e in parameters.slip_scale * slip.standard_normal(2)]
        self._slip = _Normals(slip)
        gyro = generator(seed, "gyro")
        self._bias = float(parameters.gyro_bias * gyro.standard_normal())
        self._inertial = _Normals(gyro)

    def command(self, v: float, w: float) -> tuple[float, float]:
        """Set the goal, forward speed [m/s] and yaw rate [rad/s]; returns it as limited by the wheels.

        Raises
        ------
        ValueError
            A goal that is not finite.
        """
        if not (isfinite(v) and isfinite(w)):
            raise ValueError(f"a command must be finite, got v = {v}, w = {w}")
        separation = self.parameters.wheel_separation
        return body_twist(*self.command_wheels(*wheel_speeds(v, w, separation)), separation)

    def command_wheels(self, left: float, right: float) -> tuple[float, float]:
        """Set the goal as rim speeds [m/s]; returns them as limited by the wheels."""
        self._goal = limited(left, right, self.parameters.wheel_speed_max)
        return self._goal

    def step(self, start: int, end: int) -> tuple[Leg, Reading]:
        """Move from time `start` to `end` [ns] under the goal; returns the motion and the readings."""
        p = self.parameters
        period = (end - start) * _NS
        up, down = p.acceleration * period, p.deceleration * period
        self.left = ramped(self.left, self._goal[0], up, down)
        self.right = ramped(self.right, self._goal[1], up, down)
        ground = []
        for i, speed in enumerate((self.left, self.right)):
            rolled = speed * period
            self._turns[i] += rolled / p.wheel_radius
            ground.append(rolled * self._scale[i] + p.slip * sqrt(abs(rolled)) * self._slip.next())
        length, turn = body_twist(ground[0], ground[1], p.wheel_separation)
        goal = arc(self.pose, length, turn)
        self.blocked = self._touches(goal)
        if self.blocked:
            length = 0.0
            goal = arc(self.pose, 0.0, turn)
        v, w = length / period, turn / period
        leg = Leg(start, end, self.pose, v, w)
        self.pose = goal
        white = p.accelerometer_noise / sqrt(period)
        reading = Reading(
            left=self._encoder(self._turns[0]),
            right=self._encoder(self._turns[1]),
            yaw_rate=w + self._bias + gyro_sigma(p, period) * self._inertial.next(),
            ax=(v - self._speed) / period + white * self._inertial.next(),
            ay=v * w + white * self._inertial.next(),
        )
        self._speed = v
        return leg, reading

    def teleport(self, pose: Pose2) -> None:
        """Put the body elsewhere; encoders and gyro do not notice."""
        self.pose = pose

    def _encoder(self, angle: float) -> float:
        ticks = self.parameters.ticks
        if ticks == 0:
            return angle
        tick = 2.0 * pi / ticks
        return floor(angle / tick) * tick

    def _touches(self, goal: Pose2) -> bool:
        if self._obstacles is None:
            return False
        room = self._obstacles.clearance(goal[0], goal[1])
        return room <= self.parameters.radius and room < self._obstacles.clearance(self.pose[0], self.pose[1])


class _Normals:
    """Standard normal numbers one by one, drawn in blocks: a call to a Generator costs as much as a block."""

    def __init__(self, source: np.random.Generator) -> None:
        self._source = source
        self._block: list[float] = []

    def next(self) -> float:
        if not self._block:
            self._block = self._source.standard_normal(512).tolist()
        return self._block.pop()
