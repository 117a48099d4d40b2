"""One XL430 (or XM430) wheel motor: its control table and what its firmware does with it."""

from dataclasses import dataclass
from math import pi

from knotwork.core.protocols import xl430 as table
from knotwork.core.protocols.dynamixel import ALERT, Error
from knotwork.core.protocols.registers import Register

_EEPROM_END = 64
_SIZE = 148
_FIRMWARE = 45
_REBOOT_TIME = 300_000_000  # ns without an answer

_WRITABLE: tuple[Register, ...] = (
    table.ID, table.BAUD_RATE, table.RETURN_DELAY, table.DRIVE_MODE, table.OPERATING_MODE,
    table.PWM_LIMIT, table.CURRENT_LIMIT, table.VELOCITY_LIMIT, table.SHUTDOWN, table.TORQUE_ENABLE,
    table.LED, table.STATUS_RETURN_LEVEL, table.BUS_WATCHDOG, table.GOAL_VELOCITY,
    table.PROFILE_ACCELERATION,
)  # fmt: skip
_GOALS = (table.GOAL_VELOCITY, table.PROFILE_ACCELERATION)
# What each register takes; a goal's range is the velocity limit.
_RANGES = {
    table.ID: (0, 252),
    table.BAUD_RATE: (0, 7),
    table.RETURN_DELAY: (0, 254),
    table.OPERATING_MODE: (0, 16),
    table.VELOCITY_LIMIT: (0, 1023),
    table.TORQUE_ENABLE: (0, 1),
    table.LED: (0, 1),
    table.STATUS_RETURN_LEVEL: (0, 2),
    table.BUS_WATCHDOG: (0, 127),
    table.PROFILE_ACCELERATION: (0, 32767),
}


@dataclass(frozen=True)
class Wheel:
    """What the motor feels of its wheel.

    Attributes
    ----------
    speed
        Rolling forward [rad/s].
    angle
        Forward [rad].
    """

    speed: float
    angle: float


class Motor:
    """A motor; `mirrored` sits on the right, where its own positive direction rolls the robot backwards.

    Parameters
    ----------
    identifier
        On the bus.
    model
        Model number.
    mirrored
        It is the right one.
    drive_mode
        As the set-up tool of the robot left it.

    Attributes
    ----------
    present
        Of its wheel, set from outside.
    voltage, temperature
        [V], [degrees C].
    """

    def __init__(self, identifier: int, model: int, mirrored: bool, drive_mode: int, zero: int) -> None:
        self.present = Wheel(0.0, 0.0)
        self.voltage, self.temperature = 12.0, 32
        self._mirrored = mirrored
        self._bytes = bytearray(_SIZE)
        self._fed = 0  # last instruction packet on the bus
        self._away: int | None = None  # until when it restarts
        self._zero = float(zero)  # ticks at angle 0
        for register, value in (
            (table.MODEL, model), (table.FIRMWARE, _FIRMWARE), (table.ID, identifier),
            (table.BAUD_RATE, 3), (table.RETURN_DELAY, 250), (table.DRIVE_MODE, drive_mode),
            (table.OPERATING_MODE, table.VELOCITY_MODE), (table.PWM_LIMIT, 885),
            (table.VELOCITY_LIMIT, table.VELOCITY_LIMITS[model]), (table.SHUTDOWN, 52),
        ):  # fmt: skip
            self._set(register, value)
        self._defaults()

    @property
    def id(self) -> int:
        """On the bus."""
        return int(self.get(table.ID))

    @property
    def goal(self) -> float:
        """Speed it wants its wheel to roll forward with [rad/s]."""
        if not self.get(table.TORQUE_ENABLE) or self.get(table.BUS_WATCHDOG) == table.WATCHDOG_TRIPPED:
            return 0.0
        if self.get(table.OPERATING_MODE) != table.VELOCITY_MODE:
            return 0.0
        return self._sign() * self.get(table.GOAL_VELOCITY) * table.VELOCITY_UNIT

    @property
    def acceleration(self) -> float:
        """Its profile [rad/s^2]; 0: none."""
        return self.get(table.PROFILE_ACCELERATION) * table.ACCELERATION_UNIT

    @property
    def error(self) -> int:
        """Error byte of an answer to a command that went well."""
        return ALERT if self.get(table.HARDWARE_ERROR) else 0

    @property
    def answers(self) -> bool:
        """Whether it is not restarting."""
        return self._away is None

    def get(self, register: Register) -> float:
        """Read a register."""
        return register.unpack(self._bytes, 0)

    def fail(self, bits: int) -> None:
        """Raise a hardware error, bits of `table.HARDWARE_ERRORS`; one of the shutdown bits cuts the torque."""
        self._set(table.HARDWARE_ERROR, int(self.get(table.HARDWARE_ERROR)) | bits)
        if bits & int(self.get(table.SHUTDOWN)):
            self._set(table.TORQUE_ENABLE, 0)

    def feed(self, now: int) -> None:
        """See an instruction packet on the bus: that feeds the watchdog."""
        self._fed = now

    def run(self, now: int) -> bool:
        """Do what it does by itself; returns whether the watchdog trips now."""
        if self._away is not None and now >= self._away:
            self._away = None
        ticks = self._ticks()
        speed = self._sign() * self.present.speed / table.VELOCITY_UNIT
        self._set(table.PRESENT_VELOCITY, round(speed))
        self._set(table.PRESENT_POSITION, (ticks + 2**31) % 2**32 - 2**31)
        self._set(table.PRESENT_LOAD, round(speed / 4))
        self._set(table.MOVING, int(round(speed) != 0))
        self._set(table.PRESENT_VOLTAGE, round(self.voltage / table.VOLTAGE_UNIT))
        self._set(table.PRESENT_TEMPERATURE, self.temperature)
        watchdog = self.get(table.BUS_WATCHDOG)
        if watchdog > 0 and self.get(table.TORQUE_ENABLE) and now - self._fed >= watchdog * table.WATCHDOG_UNIT * 1e9:
            self._set(table.BUS_WATCHDOG, table.WATCHDOG_TRIPPED)
            for register in _GOALS:
                self._set(register, 0)
            return True
        return False

    def reboot(self, now: int) -> None:
        """Restart: RAM is at its defaults, the error is gone, the position is within one turn."""
        self._away = now + _REBOOT_TIME
        self._bytes[_EEPROM_END:] = bytes(_SIZE - _EEPROM_END)
        self._defaults()
        ticks = self._ticks()
        self._zero += ticks % table.TICKS - ticks

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Return error code and bytes."""
        if length == 0 or address + length > _SIZE:
            return Error.ACCESS, b""
        return Error.NONE, bytes(self._bytes[address : address + length])

    def write(self, address: int, data: bytes) -> int:
        """Write whole registers; returns an error code, and then has written nothing."""
        end = address + len(data)
        items = [r for r in _WRITABLE if r.address < end and r.end > address]
        covered = sum(r.size for r in items if address <= r.address and r.end <= end)
        if not items or any(r.address < address or r.end > end for r in items) or covered != len(data):
            return Error.ACCESS
        for item in items:
            error = self._refusal(item, item.unpack(data, address))
            if error:
                return error
        for item in items:
            self._set(item, item.unpack(data, address))
            if item == table.OPERATING_MODE:
                for goal in _GOALS:
                    self._set(goal, 0)
        return Error.NONE

    def _refusal(self, item: Register, value: float) -> int:
        torque = bool(self.get(table.TORQUE_ENABLE))
        if item.address < _EEPROM_END and torque:
            return Error.ACCESS
        if item in _GOALS and self.get(table.BUS_WATCHDOG) == table.WATCHDOG_TRIPPED:
            return Error.DATA_RANGE
        if item == table.GOAL_VELOCITY and abs(value) > self.get(table.VELOCITY_LIMIT):
            return Error.DATA_LIMIT
        low, high = _RANGES.get(item, (value, value))
        if not low <= value <= high:
            return Error.DATA_RANGE
        if item == table.TORQUE_ENABLE and value and self._shut_down():
            return Error.RESULT_FAIL
        return Error.NONE

    def _shut_down(self) -> bool:
        return bool(int(self.get(table.HARDWARE_ERROR)) & int(self.get(table.SHUTDOWN)))

    def _sign(self) -> int:
        return -1 if self._mirrored != bool(int(self.get(table.DRIVE_MODE)) & table.REVERSE) else 1

    def _ticks(self) -> int:
        return round(self._sign() * self.present.angle / (2.0 * pi) * table.TICKS + self._zero)

    def _defaults(self) -> None:
        self._set(table.STATUS_RETURN_LEVEL, 2)

    def _set(self, register: Register, value: float) -> None:
        self._bytes[register.address : register.end] = register.pack(value)
