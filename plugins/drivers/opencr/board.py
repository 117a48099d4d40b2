"""What one asks an OpenCR board, register by register."""

import struct
from contextlib import suppress
from typing import NamedTuple, Self

from knotwork.core.devices.dynamixel_bus import DynamixelBus, Refused
from knotwork.core.devices.errors import NoAnswer
from knotwork.core.errors import DriverError
from knotwork.core.protocols import opencr as table
from knotwork.core.protocols.registers import Register, span

_FIRST_PATIENCE = 0.3  # s; the host is busy while a run starts
_WHEELS = (*table.PRESENT_CURRENT, *table.PRESENT_VELOCITY, *table.PRESENT_POSITION)
_INERTIAL = (*table.ANGULAR_VELOCITY, *table.LINEAR_ACCELERATION, *table.MAGNETIC, *table.ORIENTATION)
_BATTERY = (table.BATTERY_VOLTAGE, table.BATTERY_PERCENTAGE)


class Geometry(NamedTuple):
    """Figures of a robot: lengths [m], fastest goal a wheel motor takes [0.229 rev/min]."""

    name: str
    radius: float
    separation: float
    units: int

    @property
    def units_per_speed(self) -> float:
        """Motor units for 1 m/s of the rim."""
        return 1.0 / (table.VELOCITY_UNIT * self.radius)

    @property
    def fastest(self) -> float:
        """Limit of a rim [m/s]."""
        return self.units / self.units_per_speed


GEOMETRIES = {
    "burger": Geometry("burger", 0.033, 0.160, 265),
    "waffle": Geometry("waffle", 0.033, 0.287, 330),
    "waffle-pi": Geometry("waffle-pi", 0.033, 0.287, 330),
}


class Wheels(NamedTuple):
    """Velocities [rad/s] and positions [ticks], left and right."""

    velocity: tuple[float, float]
    ticks: tuple[int, int]

    @classmethod
    def of(cls, values: tuple[float, ...]) -> Self:
        """Convert the registers' values."""
        _, _, left, right, *ticks = values
        return cls((left * table.VELOCITY_UNIT, right * table.VELOCITY_UNIT), (int(ticks[0]), int(ticks[1])))


class Inertial(NamedTuple):
    """Angular velocity [rad/s], acceleration [m/s^2], orientation (w, x, y, z)."""

    angular_velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    orientation: tuple[float, ...]

    @classmethod
    def of(cls, values: tuple[float, ...]) -> Self:
        """Convert the registers' values; the magnetometer's are left out."""
        return cls(values[0:3], values[3:6], values[9:13])


class Board:
    """The board behind a bus.

    Attributes
    ----------
    guarded
        Reads that looked damaged by old firmware and were repeated register by register.
    """

    def __init__(self, bus: DynamixelBus) -> None:
        self.bus = bus
        self.guarded = 0
        self._beat = 0

    def identify(self) -> tuple[str, int]:
        """Return the model, "" when the board does not say, and the firmware's version.

        Raises
        ------
        DriverError
            It is another device, or its motors are missing.
        NoAnswer
        """
        answer = self.bus.ping(table.DEVICE, _FIRST_PATIENCE)
        where = self.bus.port.path
        if answer is None:
            raise DriverError(
                "no TurtleBot3 answers there",
                where=where,
                hint="is it the right port, and does the board carry the ROS 2 firmware?",
            )
        if answer[0] != table.MODEL_NUMBER:
            raise DriverError(f"model number {answer[0]:#x}, expected an OpenCR's {table.MODEL_NUMBER:#x}", where=where)
        if self._number(table.DEVICE_STATUS) < 0:
            raise DriverError(
                "the board has found no wheel motors", where=where, hint="switch the battery on, then press RESET"
            )
        try:
            kind = self._number(table.MODEL_INFORMATION)
        except Refused:
            kind = 0
        models = {table.BURGER: "burger", table.WAFFLE: "waffle", table.WAFFLE_MANIPULATOR: "waffle"}
        return models.get(int(kind), ""), int(self._number(table.FIRMWARE))

    def calibrate_gyro(self) -> None:
        """Have the board take the gyro's bias; it must stand still, and is deaf for 3 to 5 s."""
        register = table.IMU_RECALIBRATION
        # The acknowledgement may be lost; whether the board is back, the next question tells.
        with suppress(NoAnswer):
            self.bus.write(table.DEVICE, register.address, register.pack(1), patience=table.CALIBRATION_TIME + 1.0)
        self.bus.port.flush_input()

    def beat(self) -> None:
        """Change the heartbeat."""
        self._beat = self._beat % 255 + 1
        self._write(table.HEARTBEAT, self._beat)

    def torque(self, on: bool) -> None:
        """Switch the torque of the wheels."""
        self._write(table.TORQUE_ENABLE, int(on))

    def torque_is_on(self) -> bool:
        """Return whether the motors hold."""
        return self._number(table.TORQUE_ENABLE) != 0

    def profile(self, acceleration: float, radius: float) -> None:
        """Set the motors' own ramp [m/s^2 of the rim]; 0: none."""
        raw = round(acceleration / radius / table.ACCELERATION_UNIT)
        left, right = table.PROFILE_ACCELERATION
        self.bus.write(table.DEVICE, left.address, left.pack(raw) + right.pack(raw))

    def command(self, v: int, w: int) -> None:
        """Write a velocity [0.01 m/s, 0.01 rad/s]."""
        values = struct.pack("<6i", v, 0, 0, 0, 0, w)
        self.bus.write(table.DEVICE, table.COMMAND_LINEAR[0].address, values)

    def state(self) -> tuple[int, Inertial, Wheels]:
        """Read the board's clock [ms], IMU and wheels, in one request: all are then of one instant."""
        address, length = span(table.MILLIS, *_INERTIAL, *_WHEELS)
        block = self.bus.read(table.DEVICE, address, length)
        if damaged(block):
            # The clock is asked first: what comes after it may be newer, but not by more than a refresh.
            return int(self._number(table.MILLIS)), Inertial.of(self._block(_INERTIAL)), Wheels.of(self._block(_WHEELS))
        values = [tuple(r.unpack(block, address) for r in registers) for registers in (_INERTIAL, _WHEELS)]
        return int(table.MILLIS.unpack(block, address)), Inertial.of(values[0]), Wheels.of(values[1])

    def battery(self) -> tuple[float, float]:
        """Read voltage [V] and charge in [0, 1]."""
        voltage, percentage = self._block(_BATTERY)
        return voltage * table.VOLTAGE_UNIT, percentage * table.PERCENT_UNIT * 0.01

    def _block(self, registers: tuple[Register, ...]) -> tuple[float, ...]:
        address, length = span(*registers)
        block = self.bus.read(table.DEVICE, address, length)
        if damaged(block):
            self.guarded += 1
            return tuple(self._number(register) for register in registers)
        return tuple(register.unpack(block, address) for register in registers)

    def _number(self, register: Register) -> float:
        return register.unpack(self.bus.read(table.DEVICE, register.address, register.size), register.address)

    def _write(self, register: Register, value: int) -> None:
        self.bus.write(table.DEVICE, register.address, register.pack(value))


def damaged(block: bytes) -> bool:
    """Tell whether a read may be one of old firmware: after the first FF FF FD all bytes are FD, CRC correct."""
    start = block.find(b"\xff\xff\xfd")
    rest = block[start + 3 :]
    return start >= 0 and len(rest) > 0 and rest.strip(b"\xfd") == b""


def quantised(v: float, w: float, geometry: Geometry) -> tuple[int, int]:
    """Return the nearest command [0.01 m/s, 0.01 rad/s] that no wheel refuses.

    A wheel that is asked for more than its limit keeps its last speed, so rounding up must not reach it.
    """
    half = 0.5 * geometry.separation

    def taken(command: tuple[int, int]) -> bool:
        rim = (abs(command[0]) + abs(command[1]) * half) * 0.01
        return int(rim * geometry.units_per_speed) <= geometry.units

    def error(command: tuple[int, int]) -> float:
        return abs(command[0] * 0.01 - v) + abs(command[1] * 0.01 - w) * half

    choices = [(a, b) for a in (round(v * 100.0), int(v * 100.0)) for b in (round(w * 100.0), int(w * 100.0))]
    return min(filter(taken, choices), key=error, default=choices[-1])
