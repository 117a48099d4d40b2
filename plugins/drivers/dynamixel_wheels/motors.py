"""What one asks two wheel motors."""

from time import sleep
from typing import NamedTuple

from knotwork.core.devices.dynamixel_bus import DynamixelBus, Refused
from knotwork.core.devices.errors import NoAnswer
from knotwork.core.errors import DriverError
from knotwork.core.protocols import dynamixel
from knotwork.core.protocols import xl430 as table
from knotwork.core.protocols.registers import Register, span

_FEEDBACK = (table.PRESENT_LOAD, table.PRESENT_VELOCITY, table.PRESENT_POSITION)
_REBOOT_TIME = 0.6  # s
_MODELS = {table.XL430: "XL430", table.XM430: "XM430"}


class Wheels(NamedTuple):
    """Velocities [rad/s] and positions [ticks], left and right, positive is forward."""

    velocity: tuple[float, float]
    ticks: tuple[int, int]


class Motors:
    """A left and a right motor on a bus.

    Attributes
    ----------
    models
        Names, left and right.
    limit
        Fastest goal that both take [0.229 rev/min].
    """

    def __init__(self, bus: DynamixelBus, left: int, right: int) -> None:
        self.bus = bus
        self.ids = (left, right)
        self.models = ("", "")
        self.limit = 0
        self._signs = (1, 1)
        self._fast = True

    def identify(self) -> None:
        """Ask both who they are; raises DriverError when one is missing, NoAnswer."""
        # A motor that was told to keep quiet about writes would seem dead.
        level = table.STATUS_RETURN_LEVEL
        self.bus.sync_write(level.address, dict.fromkeys(self.ids, level.pack(2)))
        models = []
        for side, device in zip(("left", "right"), self.ids, strict=True):
            answer = self.bus.ping(device)
            if answer is None:
                raise DriverError(
                    f"the {side} motor (id {device}) does not answer",
                    where=self.bus.port.path,
                    hint="power, id, baud? `knotwork doctor --port` asks all",
                )
            models.append(_MODELS.get(answer[0], f"model {answer[0]}"))
        self.models = (models[0], models[1])
        self.limit = int(min(self._each(table.VELOCITY_LIMIT)))
        # On a TurtleBot3 the right motor sits the other way round, and its drive mode makes up for it.
        left, right = (bool(int(mode) & table.REVERSE) for mode in self._each(table.DRIVE_MODE))
        self._signs = (-1 if left else 1, 1 if right else -1)

    def mirrored(self) -> bool:
        """Tell whether a drive mode is not as a TurtleBot3's set-up leaves it."""
        return self._signs != (1, 1)

    def engage(self, acceleration: float, watchdog: float) -> None:
        """Make both obey, standing: velocity mode, ramp [rad/s^2], torque, bus watchdog [s]."""
        for device in self.ids:
            if self._number(device, table.HARDWARE_ERROR):
                self.bus.port.write(dynamixel.reboot(device))
                sleep(_REBOOT_TIME)
            self._set(device, table.BUS_WATCHDOG, 0)  # clears a watchdog that has tripped
            self._set(device, table.TORQUE_ENABLE, 0)
            if self._number(device, table.OPERATING_MODE) != table.VELOCITY_MODE:
                self._set(device, table.OPERATING_MODE, table.VELOCITY_MODE)
            if self._number(device, table.RETURN_DELAY) != 0:
                self._set(device, table.RETURN_DELAY, 0)
            self._set(device, table.PROFILE_ACCELERATION, round(acceleration / table.ACCELERATION_UNIT))
            self._set(device, table.GOAL_VELOCITY, 0)
            self._set(device, table.TORQUE_ENABLE, 1)
        for device in self.ids:
            self._set(device, table.BUS_WATCHDOG, max(1, int(watchdog / table.WATCHDOG_UNIT + 1e-9)))

    def goal(self, left: int, right: int) -> None:
        """Write goal velocities [0.229 rev/min]; nobody answers."""
        register = table.GOAL_VELOCITY
        values = {
            device: register.pack(sign * units)
            for device, sign, units in zip(self.ids, self._signs, (left, right), strict=True)
        }
        self.bus.sync_write(register.address, values)

    def wheels(self) -> Wheels:
        """Read both wheels in one packet, or two where the firmware does not know how."""
        address, length = span(*_FEEDBACK)
        try:
            blocks = self.bus.sync_read(self.ids, address, length, self._fast)
        except NoAnswer:
            if not self._fast:
                raise
            self._fast = False
            blocks = self.bus.sync_read(self.ids, address, length, fast=False)
        velocity, ticks = [], []
        for device, sign in zip(self.ids, self._signs, strict=True):
            velocity.append(sign * table.PRESENT_VELOCITY.unpack(blocks[device], address) * table.VELOCITY_UNIT)
            ticks.append(sign * int(table.PRESENT_POSITION.unpack(blocks[device], address)))
        return Wheels((velocity[0], velocity[1]), (ticks[0], ticks[1]))

    def watchdog_tripped(self) -> bool:
        """Tell whether a motor has stopped by itself."""
        return any(value == table.WATCHDOG_TRIPPED for value in self._each(table.BUS_WATCHDOG))

    def hardware_error(self) -> str:
        """Return what the motors complain of, "" for nothing."""
        found = []
        for side, value in zip(("left", "right"), self._each(table.HARDWARE_ERROR), strict=True):
            names = [name for bit, name in table.HARDWARE_ERRORS.items() if int(value) & bit]
            found += [f"{side} motor: {', '.join(names)}"] if names else []
        return "; ".join(found)

    def voltage(self) -> float:
        """Return the lower of the motors' supply voltages [V]."""
        return min(self._each(table.PRESENT_VOLTAGE)) * table.VOLTAGE_UNIT

    def release(self, torque_off: bool) -> None:
        """Stand; then the watchdogs off, so that the motors do not trip when nobody speaks to them any more."""
        self.goal(0, 0)
        for device in self.ids:
            self._set(device, table.BUS_WATCHDOG, 0)
            if torque_off:
                self._set(device, table.TORQUE_ENABLE, 0)

    def _each(self, register: Register) -> list[float]:
        blocks = self.bus.sync_read(self.ids, register.address, register.size, fast=False)
        return [register.unpack(blocks[device], register.address) for device in self.ids]

    def _number(self, device: int, register: Register) -> float:
        return register.unpack(self.bus.read(device, register.address, register.size), register.address)

    def _set(self, device: int, register: Register, value: float) -> None:
        try:
            self.bus.write(device, register.address, register.pack(value))
        except Refused as refused:
            raise DriverError(
                str(refused), where=self.bus.port.path, hint="see the motor's hardware error"
            ) from refused
