"""The driver of a TurtleBot3's base."""

from contextlib import suppress
from math import atan2, tau
from time import sleep

import numpy as np

from knotwork.core import clock
from knotwork.core.contracts import Context
from knotwork.core.devices.base_driver import BaseDriver
from knotwork.core.devices.device_clock import DeviceClock
from knotwork.core.devices.dynamixel_bus import DynamixelBus, LineFigures
from knotwork.core.devices.errors import NoAnswer
from knotwork.core.devices.serial_port import SerialPort
from knotwork.core.devices.standing_gyro import StandingGyro
from knotwork.core.devices.wheel_odometry import WheelOdometry
from knotwork.core.errors import DriverError
from knotwork.core.geometry import wrap
from knotwork.core.messages import Battery, Imu
from knotwork.core.protocols import opencr as table
from knotwork.core.safety.frozen import FrozenWheels
from knotwork.core.world.kinematics import body_twist
from knotwork.plugins.drivers.opencr import Config
from knotwork.plugins.drivers.opencr.board import GEOMETRIES, Board, Inertial, Wheels, quantised

_REFRESH = 100_000_000  # ns between heartbeats, and between repeats of an unchanged command
_SLOW = 1_000_000_000  # ns between readings of battery and torque
_STALE = 200_000_000  # ns; the board refreshes its registers every 20 ms
_TICK = 500_000  # ns; the board's clock counts whole ms
_WITHIN = 5_000_000  # ns; by which its time may be off
_TUNE_IN, _BETWEEN = 20, 0.003  # reads of the board's clock before the first that counts, s between them
_GYRO_NOISE = 2.6e-4  # rad/s/sqrt(Hz)
_BIAS, _CALIBRATED_BIAS = 5e-4, 2e-4  # rad/s, sigma; calibrating takes 2.56 s
_LOOK = 0.05  # s between looks at the gyro while the robot rests
_LOW_FOR = 3_000_000_000  # ns; the battery's voltage dips when the robot sets off


class OpenCr(BaseDriver):
    """Reads wheels and IMU at 50 Hz, battery at 1 Hz; beats the heart, writes commands at once."""

    def __init__(self, context: Context) -> None:
        config: Config = context.config
        self.config = config
        # The board may correct this when it is identified.
        self.geometry = GEOMETRIES["burger" if config.model == "auto" else config.model]
        super().__init__(context, config.safety, self.geometry.separation, self.geometry.fastest)
        self._port: SerialPort | None = None
        self._line = LineFigures()
        self._frozen = FrozenWheels()
        self._guarded = 0
        self._odometry: WheelOdometry | None = None
        self._clock = DeviceClock()
        self._gyro = StandingGyro(_GYRO_NOISE, _CALIBRATED_BIAS if config.calibrate_gyro else _BIAS)
        self._last: tuple[int, float, tuple[int, int]] | None = None  # stamp, heading, ticks
        self._written: tuple[int, int] | None = None
        self._refreshed = self._slow = 0
        self._stands = True
        self._low_since: int | None = None

    def connect(self, first: bool) -> None:
        """Open the port and identify the board; the first time, calibrate its gyro."""
        self._port = SerialPort(self.config.port, table.BAUD)
        try:
            bus = DynamixelBus(self._port)
            self._line.attach(bus)
            self.board = Board(bus)
            self._port.flush_input()
            model, firmware = self.board.identify()
            if first:
                self._become(model, firmware)
            self.board.command(0, 0)
            if first and self.config.calibrate_gyro:
                self._calibrate()
            self._tune_in()
            if first and self.config.calibrate_gyro:
                self._rest(self.config.gyro_rest)
        except BaseException:
            self._port.close()
            raise

    def engage(self) -> None:
        """Two heartbeats that differ, torque, the motors' own ramp."""
        board = self.board
        board.command(0, 0)
        board.beat()
        board.beat()
        if not board.torque_is_on():
            board.torque(True)
        board.profile(self.config.profile_acceleration, self.geometry.radius)
        self._written = None

    def poll(self, now: int) -> bool:
        """Read wheels and IMU, now and then battery and torque."""
        stamp, yaw, inertial, wheels = self._read()
        if self._last is not None and stamp <= self._last[0]:
            return now - stamp < _STALE  # the board has not refreshed its registers since
        odometry = self._odometry
        assert odometry is not None
        if self.discontinuity:
            odometry.restart()
            self.discontinuity = False
            self._last = None  # whatever turned it meanwhile
        turn = self._turned(stamp, yaw, wheels)
        restarts = odometry.restarts
        found = odometry.update(stamp, wheels.ticks, wheels.velocity, turn, _WITHIN)
        if found is None:
            return False
        if odometry.restarts != restarts:
            self.supervisor.fault("the encoders have restarted (was the motors' power cut?)")
        self._last = stamp, yaw, wheels.ticks
        self._stands = wheels.velocity == (0.0, 0.0)
        self.context.emit("wheels", found[1])
        self.context.emit(
            "imu",
            Imu(
                stamp=stamp,
                angular_velocity=np.array(inertial.angular_velocity),
                linear_acceleration=np.array(inertial.acceleration),
                orientation_wxyz=np.array(inertial.orientation),
            ),
        )
        self.context.emit("odometry", found[0])
        if now - self._slow >= _SLOW:
            self._slow = now
            self._read_slowly(now)
        return True

    def drive(self, left: float, right: float, now: int) -> int:
        """Write the command if it is new, and the heartbeat, but only while readings are good."""
        command = quantised(*body_twist(left, right, self.geometry.separation), self.geometry)
        due = now - self._refreshed >= _REFRESH
        sent = now
        if command != self._written or due:
            self._written = None  # an unanswered write may or may not have arrived
            self.board.command(*command)
            self._written = command
            sent = self.board.bus.sent
        if due and self.reading_well(now):
            self.board.beat()
            self._refreshed = now
        odometry = self._odometry
        if odometry is not None and self._frozen.look(command != (0, 0), odometry.moved, odometry.read):
            self.supervisor.fault("the wheels do not turn though they are told to")
        return sent

    def standing(self) -> bool:
        """Whether both wheels were measured to stand."""
        return self._stands

    def trouble(self) -> str:
        """Say whether the battery is low."""
        if self._low_since is not None and clock.epoch() - self._low_since > _LOW_FOR:
            return f"the battery is below {self.config.battery_min:g} V"
        return ""

    def release(self) -> None:
        """Stand; torque off if wanted."""
        self.board.command(0, 0)
        if self.config.torque_off:
            self.board.torque(False)

    def disconnect(self) -> None:
        """Close the port."""
        if self._port is not None:
            self._guarded += self.board.guarded
            self._port.close()
            self._port = None

    def statistics(self) -> dict[str, float]:
        """Add what went wrong on the line."""
        figures = {**super().statistics(), **self._line.summary()}
        figures["guarded_reads"] = self._guarded + (self.board.guarded if self._port is not None else 0)
        if self._odometry is not None:
            figures["gyro_bias_mrad_s"] = round(1e3 * self._gyro.bias, 3)
            figures |= {"rejected_readings": self._odometry.rejected, "encoder_restarts": self._odometry.restarts}
        return figures

    def _read(self) -> tuple[int, float, Inertial, Wheels]:
        """Read the board; return when it took the reading [ns], its heading [rad], and the reading."""
        count, inertial, wheels = self.board.state()
        stamp = self._clock.hear(count, clock.epoch()) + _TICK
        w, x, y, z = inertial.orientation
        return stamp, atan2(x * y + w * z, 0.5 - y * y - z * z), inertial, wheels

    def _turned(self, stamp: int, yaw: float, wheels: Wheels) -> float | None:
        """Return the change of heading since the last reading [rad]."""
        if self._last is None:
            return None
        before, heading, ticks = self._last
        stands = ticks == wheels.ticks and wheels.velocity == (0.0, 0.0)
        return self._gyro.turn(wrap(yaw - heading), (stamp - before) * 1e-9, stands)

    def _become(self, model: str, firmware: int) -> None:
        config = self.config
        name: str = config.model
        if name == "auto":
            name = model or "burger"
        elif model and not name.startswith(model):
            self.context.report("warning", f"the board says it moves a {model}, the configuration says {name}")
        self.geometry = geometry = GEOMETRIES[name]
        self.supervisor.resize(geometry.separation, geometry.fastest)
        self._odometry = WheelOdometry(
            geometry.radius,
            geometry.separation,
            tau / table.TICKS,
            geometry.fastest,
            gyro=config.odometry == "gyro",
            gyro_bias=_CALIBRATED_BIAS if config.calibrate_gyro else _BIAS,
            covariance=config.covariance,
        )
        voltage, charge = self.board.battery()
        self.context.report("info", f"{name}, firmware {firmware}, battery {voltage:.1f} V ({charge:.0%})")

    def _calibrate(self) -> None:
        first = self.board.state()[2]
        sleep(0.1)
        if first.ticks != self.board.state()[2].ticks:
            raise DriverError(
                "the wheels turn, and the gyro can only be calibrated at standstill",
                where=self.config.port,
                hint="hold the robot still, or calibrate_gyro: false",
            )
        seconds = table.CALIBRATION_TIME + self.config.gyro_rest
        self.context.report("info", f"calibrating the gyro; keep the robot still for {seconds:.0f} s")
        self.board.calibrate_gyro()

    def _tune_in(self) -> None:
        """Read often enough for one answer to be hardly late."""
        self._clock = DeviceClock()
        for _ in range(_TUNE_IN):
            with suppress(NoAnswer):
                self._read()
            sleep(_BETWEEN)

    def _rest(self, seconds: float) -> None:
        """Learn what the calibration has left of the gyro's bias."""
        until = clock.monotonic() + round(seconds * 1e9)
        while clock.monotonic() < until:
            with suppress(NoAnswer):
                stamp, yaw, _, wheels = self._read()
                if self._last is None or stamp > self._last[0]:
                    self._turned(stamp, yaw, wheels)
                    self._last = stamp, yaw, wheels.ticks
            sleep(_LOOK)
        self._last = None

    def _read_slowly(self, now: int) -> None:
        voltage, charge = self.board.battery()
        self.context.emit("battery", Battery(stamp=now, voltage=voltage, charge=min(max(charge, 0.0), 1.0)))
        low = 0.0 < voltage < self.config.battery_min
        self._low_since = (self._low_since or now) if low else None
        if not self.board.torque_is_on() and self.supervisor.state == "ready":
            self.supervisor.fault("the motors' torque is off")
