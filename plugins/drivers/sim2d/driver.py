"""The simulator as a pulled driver in closed loop."""

from collections.abc import Iterator
from itertools import count

import numpy as np

from knotwork.core.contracts import Context, Driver
from knotwork.core.errors import InputError
from knotwork.core.geometry import relative
from knotwork.core.messages import Imu, Message, Pose, Twist, Wheels
from knotwork.core.world.base import Reading, SimulatedBase
from knotwork.core.world.files import load_world
from knotwork.core.world.kinematics import body_twist
from knotwork.core.world.lidar import SimulatedLidar
from knotwork.core.world.motion import Leg, Motion
from knotwork.core.world.odometry import DeadReckoning
from knotwork.core.world.raycast import RayCaster
from knotwork.plugins.drivers.sim2d import Config

_GRAVITY = 9.80665  # m/s^2


class Sim2d(Driver):
    """Steps the base at `rate`; a scan comes at the first step after its turn has ended.

    At step k it gives the twist applied over (k-1, k], then the measurements at k. The command that
    has arrived before it is resumed for step k is the one that holds over (k-1, k].
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: Config = context.config
        self.config = config
        self.world = load_world(config.world)
        self.start_pose = self.world.start if config.start is None else config.start
        base = config.base if config.noise else config.base.exact()
        lidar = config.lidar if config.noise else config.lidar.exact()
        obstacles = RayCaster(self.world)
        for what, pose in [("start", self.start_pose)] + [("kidnap", k.to) for k in config.kidnap]:
            room = obstacles.clearance(pose[0], pose[1])
            if room <= base.radius:
                raise InputError(
                    f"the robot cannot stand at its {what} pose {list(pose)}: an obstacle is {room:.3f} m "
                    f"away, its radius is {base.radius} m",
                    where=f"node {context.name}",
                )
        self.base = SimulatedBase(base, obstacles, self.start_pose, context.seed)
        self.lidar = SimulatedLidar(lidar, obstacles, context.seed)
        self._reckoning = DeadReckoning(base, config.odometry == "gyro", config.covariance)
        self._motion = Motion()
        self._kidnaps = sorted(config.kidnap, key=lambda k: k.at)
        self._command_stamp: int | None = None
        self._scan_id = 0
        self._blocked_before = False
        self._length = 0.0
        self._time = 0
        self._moved: int | None = None  # time of the last motion of a wheel [ns]

    def warm(self) -> None:
        """Compile the kernels of motion and ray casting."""
        motion = Motion()
        motion.append(Leg(0, 1, self.start_pose, 0.0, 0.0))
        # A lidar of its own: this one's noise must start at the first scan.
        SimulatedLidar(self.config.lidar, RayCaster(self.world), 0).scan(motion, 0, 0)

    def on_twist(self, message: Twist) -> None:
        """Take a command; it holds until the next one or until it is too old."""
        try:
            self.base.command(float(message.vx), float(message.wz))
        except ValueError as error:
            self.context.count("bad_commands")
            self.context.report("warning", f"command ignored: {error}")
            return
        self._command_stamp = message.stamp

    def events(self) -> Iterator[tuple[str, Message] | int]:
        """Yield the time of each step, then what is measured at it."""
        for k in count():
            stamp = self._stamp(k)
            if stamp > round(self.config.duration * 1e9):
                return
            yield stamp
            if k == 0:
                yield "wheels", Wheels(stamp=stamp, angle=np.zeros(2), velocity=np.zeros(2))
                yield "odometry", self._reckoning.start(stamp)
            else:
                yield from self._step(self._stamp(k - 1), stamp)
            self._time = stamp
            if self._idle(stamp):
                return

    def stop_motion(self) -> None:
        """Forget the command."""
        self.base.command(0.0, 0.0)

    def progress(self) -> float | None:
        """Return the share of the duration that has passed."""
        return min(1.0, self._time * 1e-9 / self.config.duration)

    def statistics(self) -> dict[str, float]:
        """Say how far the body truly moved [m] and which range error this run has."""
        return {"path_length_m": self._length, "range_scale": self.lidar.scale}

    def _idle(self, now: int) -> bool:
        if self.base.left != 0.0 or self.base.right != 0.0:
            self._moved = now
        patience = self.config.stop_when_idle * 1e9
        return patience > 0.0 and self._moved is not None and now - self._moved >= patience

    def _stamp(self, k: int) -> int:
        return round(k * 1e9 / self.config.rate)

    def _scan_start(self, scan_id: int) -> int:
        return round(scan_id * 1e9 / self.lidar.parameters.rate)

    def _step(self, start: int, end: int) -> Iterator[tuple[str, Message]]:
        parameters = self.base.parameters
        age = None if self._command_stamp is None else (start - self._command_stamp) * 1e-9
        if age is not None and age > parameters.command_timeout:
            self.base.command(0.0, 0.0)
            self._command_stamp = None
            self.context.count("command_timeouts")
        self._kidnap(start)
        leg, reading = self.base.step(start, end)
        self._motion.append(leg)
        self._length += abs(leg.v) * (end - start) * 1e-9
        if self.base.blocked and not self._blocked_before:
            self.context.count("collisions")
            self.context.report("warning", f"the robot touches an obstacle near {_place(leg)} of the world")
        self._blocked_before = self.base.blocked
        v, w = body_twist(self.base.left, self.base.right, parameters.wheel_separation)
        yield "applied", Twist(stamp=end, vx=v, wz=w)
        yield from self._measurements(end, (end - start) * 1e-9, reading)
        yield from self._scans(end)

    def _measurements(self, stamp: int, period: float, reading: Reading) -> Iterator[tuple[str, Message]]:
        yield (
            "imu",
            Imu(
                stamp=stamp,
                angular_velocity=np.array((0.0, 0.0, reading.yaw_rate)),
                linear_acceleration=np.array((reading.ax, reading.ay, _GRAVITY)),
            ),
        )
        odometry = self._reckoning.update(stamp, reading.left, reading.right, reading.yaw_rate, period)
        yield (
            "wheels",
            Wheels(
                stamp=stamp,
                angle=np.array((reading.left, reading.right)),
                velocity=np.array(self._reckoning.wheel_rates),
            ),
        )
        yield "odometry", odometry

    def _scans(self, now: int) -> Iterator[tuple[str, Message]]:
        sweep = round(self.lidar.parameters.sweep_time * 1e9)
        while (start := self._scan_start(self._scan_id)) + sweep <= now:
            pose = self._motion.pose(start)
            mapped = self.config.truth_frame == "map"
            if mapped:
                pose = relative(self.start_pose, pose)
            yield (
                "truth",
                Pose(
                    stamp=start,
                    role="truth",
                    pose=np.array(pose),
                    scan_id=self._scan_id,
                    frame="map" if mapped else "world",
                ),
            )
            yield "scan", self.lidar.scan(self._motion, start, self._scan_id)
            self._scan_id += 1
            self._motion.forget(self._scan_start(self._scan_id))

    def _kidnap(self, now: int) -> None:
        while self._kidnaps and self._kidnaps[0].at * 1e9 <= now:
            kidnap = self._kidnaps.pop(0)
            self.base.teleport(kidnap.to)
            self.context.report("info", f"the robot is put at {list(kidnap.to)} of the world")


def _place(leg: Leg) -> str:
    return f"({leg.pose[0]:.2f}, {leg.pose[1]:.2f})"
