"""The driver of two wheel motors."""

from math import tau

from knotwork.core import clock
from knotwork.core.contracts import Context
from knotwork.core.devices.base_driver import BaseDriver
from knotwork.core.devices.dynamixel_bus import DynamixelBus, LineFigures
from knotwork.core.devices.serial_port import SerialPort
from knotwork.core.devices.wheel_odometry import WheelOdometry
from knotwork.core.messages import Battery
from knotwork.core.protocols import xl430 as table
from knotwork.core.safety.frozen import FrozenWheels
from knotwork.plugins.drivers.dynamixel_wheels import Config
from knotwork.plugins.drivers.dynamixel_wheels.motors import Motors

_SLOW = 1_000_000_000  # ns between readings of the voltage
_CHECK = 100_000_000  # ns between looks at the bus watchdogs
_LOW_FOR = 3_000_000_000  # ns; the voltage dips when the robot sets off


class DynamixelWheels(BaseDriver):
    """Reads both wheels at 50 Hz, writes goals at once; the motors' own watchdogs stop a dead host's robot."""

    def __init__(self, context: Context) -> None:
        config: Config = context.config
        self.config = config
        self._unit = table.VELOCITY_UNIT * config.wheel_radius  # m/s of the rim
        fastest = table.VELOCITY_LIMITS[table.XL430] * self._unit
        super().__init__(context, config.safety, config.wheel_separation, fastest)
        self._port: SerialPort | None = None
        self._line = LineFigures()
        self._frozen = FrozenWheels()
        self._odometry = self._reckoning(fastest)
        self._slow = self._checked = 0
        self._stands = True
        self._low_since: int | None = None

    def connect(self, first: bool) -> None:
        """Open the port and ask both motors who they are."""
        self._port = SerialPort(self.config.port, self.config.baud)
        try:
            bus = DynamixelBus(self._port)
            self._line.attach(bus)
            self.motors = Motors(bus, self.config.left, self.config.right)
            self._port.flush_input()
            self.motors.identify()
            if first:
                fastest = self.motors.limit * self._unit
                self.supervisor.resize(self.config.wheel_separation, fastest)
                self._odometry = self._reckoning(fastest)
                names = " and ".join(dict.fromkeys(self.motors.models))
                self.context.report("info", f"{names}, {self.motors.voltage():.1f} V, at most {fastest:.3f} m/s")
                if self.motors.mirrored():
                    self.context.report("warning", "a drive mode is not a TurtleBot3's; its direction is turned here")
        except BaseException:
            self._port.close()
            raise

    def engage(self) -> None:
        """Velocity mode, ramp, torque, watchdog."""
        self.motors.engage(self.config.profile_acceleration / self.config.wheel_radius, self.config.watchdog)
        self._odometry.restart()  # a motor that had to be restarted counts anew

    def poll(self, now: int) -> bool:
        """Read the wheels; now and then watchdogs, hardware errors and voltage."""
        wheels = self.motors.wheels()
        within = (clock.epoch() - self.motors.bus.sent) // 2
        stamp = self.motors.bus.sent + within
        if self.discontinuity:
            self._odometry.restart()
            self.discontinuity = False
        restarts = self._odometry.restarts
        found = self._odometry.update(stamp, wheels.ticks, wheels.velocity, None, within)
        if found is None:
            return False
        if self._odometry.restarts != restarts:
            self.supervisor.fault("the encoders have restarted (was the motors' power cut?)")
        self._stands = wheels.velocity == (0.0, 0.0)
        self.context.emit("wheels", found[1])
        self.context.emit("odometry", found[0])
        if self.motors.bus.alerts and self.supervisor.state == "ready":
            self.supervisor.fault(self.motors.hardware_error() or "a motor reports an error")
        if now - self._checked >= _CHECK:
            self._checked = now
            if self.supervisor.state == "ready" and self.motors.watchdog_tripped():
                self.supervisor.fault("a motor's bus watchdog has stopped it")
        if now - self._slow >= _SLOW:
            self._slow = now
            self._read_voltage(now)
        return True

    def drive(self, left: float, right: float, now: int) -> int:
        """Write the goals; a goal over the limit would be refused silently, so it is cut."""
        limit = self.motors.limit
        units = [min(max(round(speed / self._unit), -limit), limit) for speed in (left, right)]
        self.motors.goal(units[0], units[1])
        if self._frozen.look(units != [0, 0], self._odometry.moved, self._odometry.read):
            self.supervisor.fault("the wheels do not turn though they are told to")
        return self.motors.bus.sent

    def standing(self) -> bool:
        """Whether both wheels were measured to stand."""
        return self._stands

    def trouble(self) -> str:
        """Say whether the voltage is low."""
        if self._low_since is not None and clock.epoch() - self._low_since > _LOW_FOR:
            return f"the voltage is below {self.config.voltage_min:g} V"
        return ""

    def release(self) -> None:
        """Stand, watchdogs off, torque off if wanted."""
        self.motors.release(self.config.torque_off)

    def disconnect(self) -> None:
        """Close the port."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def statistics(self) -> dict[str, float]:
        """Add what went wrong on the line."""
        own = {"rejected_readings": self._odometry.rejected, "encoder_restarts": self._odometry.restarts}
        return {**super().statistics(), **self._line.summary(), **own}

    def _reckoning(self, fastest: float) -> WheelOdometry:
        config = self.config
        return WheelOdometry(
            config.wheel_radius,
            config.wheel_separation,
            tau / table.TICKS,
            fastest,
            gyro=False,
            covariance=config.covariance,
        )

    def _read_voltage(self, now: int) -> None:
        voltage = self.motors.voltage()
        self.context.emit("battery", Battery(stamp=now, voltage=voltage))
        low = 0.0 < voltage < self.config.voltage_min
        self._low_since = (self._low_since or now) if low else None
