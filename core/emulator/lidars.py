"""Emulated lidars: they measure each reading from where the robot was at its instant, and send bytes."""

from abc import ABC, abstractmethod
from math import sin, tau
from typing import Any

import numpy as np

from knotwork.core.emulator.line import Line
from knotwork.core.emulator.robot import Robot
from knotwork.core.messages import F64
from knotwork.core.protocols import lds01, lds02, lds03
from knotwork.core.world.lidar import SimulatedLidar
from knotwork.core.world.parameters import LidarParameters

_SLEPT = 50_000_000  # ns
_FORGOTTEN = 900_000_000  # ns; the robot's path before that is not known any more
_WOBBLE, _WOBBLE_PERIOD = 0.003, 7.0  # relative speed error of the motor, its period [s]


class Lidar(ABC):
    """A spinning lidar on a serial line.

    Parameters
    ----------
    line
        Where its bytes go.
    robot
        What carries it.
    parameters
        Mount, range and errors.
    seed
        Of its errors.
    spin_up
        From power-on to the first packet [s].
    """

    baud: int
    turn_rate: float

    def __init__(self, line: Line, robot: Robot, parameters: LidarParameters, seed: int, spin_up: float = 2.0) -> None:
        self.line = line
        self.spin_up = spin_up
        self.running = True
        self._robot = robot
        self._mount = parameters.mount
        # The sensor's own pose is worked out here, beam by beam.
        self._sensor = SimulatedLidar(parameters.model_copy(update={"mount": (0.0, 0.0, 0.0)}), robot.obstacles, seed)
        self._time = robot.time  # of the next packet's first reading

    @property
    def range_scale(self) -> float:
        """Factor by which this run's ranges are wrong."""
        return self._sensor.scale

    def begin(self) -> None:
        """Start a turn now, already spinning."""
        self._time = self._robot.time

    def power_on(self, now: int) -> None:
        """Spin up from rest, as after plugging in."""
        self.running = True
        self._time = now + round(self.spin_up * 1e9)

    def next_due(self) -> int | None:
        """Return when the next packet has been sent [ns]."""
        return self._ends() + self._on_the_wire() if self.running and self.line.plugged else None

    def run(self, now: int) -> None:
        """Send the packets that are complete by `now` [ns]."""
        while self.running and self.line.plugged and (late := now - self._ends() - self._on_the_wire()) >= 0:
            if late > _FORGOTTEN:
                self._time = now
                return
            packet = self._packet()
            # A device keeps time whatever its host does: what this process has slept through is lost, not late.
            if late < _SLEPT:
                self.line.send(packet, now)
        self._robot.motion.forget(min(self._time, now))

    def receive(self, data: bytes, now: int) -> None:  # noqa: B027
        """Take bytes from the host; a lidar that only sends ignores them."""

    def _speed(self) -> float:
        """Return the turns a second at the moment."""
        wobble = _WOBBLE * sin(tau * (self._time * 1e-9 % _WOBBLE_PERIOD) / _WOBBLE_PERIOD)
        return self.turn_rate * (1.0 + wobble)

    def _measure(
        self,
        offsets: F64,
        angles: F64,
        aside: tuple[float, float] = (0.0, 0.0),
        skew: float = 0.0,
    ) -> F64:
        """Return true-to-life ranges [m], 0 where there is none.

        Parameters
        ----------
        offsets : shape (n,)
            Instants after `_time` [s].
        angles : shape (n,)
            Counter-clockwise direction of the head [rad].
        aside
            Where on the head the ray starts [m].
        skew
            By how much the ray points left of the head's direction [rad].
        """
        poses = self._robot.motion.poses(self._time, offsets)
        mx, my, myaw = self._mount
        yaw = poses[:, 2]
        c, s = np.cos(yaw), np.sin(yaw)
        head = yaw + myaw + angles
        ch, sh = np.cos(head), np.sin(head)
        ax, ay = aside
        poses[:, 0] += c * mx - s * my + ch * ax - sh * ay
        poses[:, 1] += s * mx + c * my + sh * ax + ch * ay
        poses[:, 2] = 0.0
        ranges = self._sensor.measure(poses, head + skew)
        ranges[~np.isfinite(ranges)] = 0.0
        return ranges

    @abstractmethod
    def _ends(self) -> int:
        """Return when the last reading of the next packet is done [ns]."""

    @abstractmethod
    def _on_the_wire(self) -> int:
        """Return how long a packet takes on the wire [ns]."""

    @abstractmethod
    def _packet(self) -> bytes:
        """Measure and encode the next packet, and go on to the one after it."""


class Lds01(Lidar):
    """The LDS-01: 6 degrees a packet; 'b' and 'e' start and stop it.

    The raw clockwise sample n looks at 359 - n degrees counter-clockwise, plus `zero`.
    """

    baud = lds01.BAUD
    turn_rate = lds01.RATE
    zero = 0.0  # rad
    _sector = 0

    def receive(self, data: bytes, now: int) -> None:
        """Take start and stop commands."""
        for byte in data:
            if byte == lds01.STOP[0]:
                self.running = False
            elif byte == lds01.START[0] and not self.running:
                self.power_on(now)

    def _degree(self) -> float:
        return 1.0 / (360.0 * self._speed())  # s

    def _ends(self) -> int:
        return self._time + round((lds01.BEAMS - 1) * self._degree() * 1e9)

    def _on_the_wire(self) -> int:
        return lds01.PACKET * 10_000_000_000 // self.baud

    def _packet(self) -> bytes:
        step = self._degree()
        i = np.arange(lds01.BEAMS, dtype=np.float64)
        angles: F64 = np.radians(359.0 - (lds01.BEAMS * self._sector + i)) + self.zero
        ranges = self._measure(i * step, angles)
        distances = [round(1e3 * r) for r in ranges.tolist()]
        intensities = [min(20_000, 2_000_000 // (d + 100)) if d else 0 for d in distances]
        packet = lds01.encode(self._sector, 60.0 * self._speed(), distances, intensities)
        self._time += round(lds01.BEAMS * step * 1e9)
        self._sector = (self._sector + 1) % lds01.SECTORS
        return packet


class Lds02(Lidar):
    """The LDS-02: 12 points a packet at a fixed rate; its ray starts beside the axis and points askew."""

    baud = lds02.BAUD
    turn_rate = lds02.RATE
    _angle = 0.0  # of the next point, clockwise [degrees]
    _ASIDE = (5.9e-3, -20.14e-3)  # m
    _SLOPE = 0.11923

    def _ends(self) -> int:
        return self._time + round((lds02.POINTS - 1) / lds02.SAMPLE_RATE * 1e9)

    def _on_the_wire(self) -> int:
        return lds02.PACKET * 10_000_000_000 // self.baud

    def _packet(self) -> bytes:
        speed = round(360.0 * self._speed())
        step = speed / lds02.SAMPLE_RATE
        i = np.arange(lds02.POINTS, dtype=np.float64)
        clockwise = self._angle + i * step
        ranges = self._measure(
            i / lds02.SAMPLE_RATE,
            -np.radians(clockwise),
            self._ASIDE,
            float(np.arctan(self._SLOPE)),
        )
        # The device counts along the head's direction, not along its ray.
        distances = [round(1e3 * r / (1.0 + self._SLOPE**2) ** 0.5) for r in ranges.tolist()]
        confidences = [max(20, 240 - d // 50) if d else 0 for d in distances]
        first, last = round(100.0 * self._angle), round(100.0 * (self._angle + (lds02.POINTS - 1) * step))
        packet = lds02.encode(speed, first, last, distances, confidences, self._time // 1_000_000 % 30_000)
        self._angle = (self._angle + lds02.POINTS * step) % 360.0
        self._time += round(lds02.POINTS / lds02.SAMPLE_RATE * 1e9)
        return packet


class Lds03(Lidar):
    """The LDS-03: 40 samples a packet, ten packets a turn; silent until it is told to start."""

    baud = lds03.BAUD
    turn_rate = lds03.RATE
    _SAMPLES = 40
    _part = 0
    _heard = b""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.running = False

    def power_on(self, now: int) -> None:
        """Wait for the start command again."""
        self.running = False

    def receive(self, data: bytes, now: int) -> None:
        """Take start and stop commands."""
        self._heard = (self._heard + data)[-len(lds03.START) :]
        if self._heard == lds03.STOP:
            self.running = False
        elif self._heard == lds03.START and not self.running:
            super().power_on(now)
            self._part = 0

    def _step(self) -> float:
        return 1.0 / (10 * self._SAMPLES * self._speed())  # s

    def _ends(self) -> int:
        return self._time + round((self._SAMPLES - 1) * self._step() * 1e9)

    def _on_the_wire(self) -> int:
        return (10 + 3 * self._SAMPLES) * 10_000_000_000 // self.baud

    def _packet(self) -> bytes:
        step = self._step()
        i = np.arange(self._SAMPLES, dtype=np.float64)
        clockwise = 36.0 * self._part + 0.9 * i
        ranges = self._measure(i * step, -np.radians(clockwise))
        distances = [round(1e3 * r) for r in ranges.tolist()]
        intensities = [max(20, 250 - d // 50) if d else 0 for d in distances]
        packet = lds03.encode(self._part == 0, self._speed(), clockwise[0], clockwise[-1], distances, intensities)
        self._time += round(self._SAMPLES * step * 1e9)
        self._part = (self._part + 1) % 10
        return packet
