"""The OpenCR board of a TurtleBot3 with its stock ROS 2 firmware, as its host sees it."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin

import numpy as np

from knotwork.core.emulator.line import Line
from knotwork.core.emulator.robot import Robot
from knotwork.core.protocols import dynamixel as dxl
from knotwork.core.protocols import opencr as table
from knotwork.core.protocols.dynamixel import Error, Instruction
from knotwork.core.protocols.registers import Register
from knotwork.core.world.kinematics import wheel_speeds

_GRAVITY = 9.80665
_REFRESH = 20_000_000  # ns
_IMU_PERIOD = 5_000_000  # ns
_GYRO_STEP, _GYRO_DEAD_BAND = 0.0010642, 3  # rad/s, steps
_ACCELERATION_STEP = 0.00059855  # m/s^2
_UNITS = 1263.633  # velocity units of the motors in 1 m/s of rim speed
_UNITS_MAX = 337  # what the firmware lets through to either wheel
_POWER_CUT = 11.0  # V
_POWER_CUT_DELAY = 5_000_000_000  # ns

Note = Callable[[int, str, dict[str, float]], None]


@dataclass(frozen=True)
class Model:
    """What differs between the robots.

    Attributes
    ----------
    information
        Register 2.
    linear_max, angular_max
        Clamps of the firmware [m/s, rad/s].
    velocity_limit
        Of the motors; a faster goal is refused and the wheel keeps its speed.
    """

    information: int
    linear_max: float
    angular_max: float
    velocity_limit: int


MODELS = {
    "burger": Model(table.BURGER, 0.2108, 2.635, 265),
    "waffle": Model(table.WAFFLE, 0.2661, 1.854, 330),
}

_COMMON: tuple[Register, ...] = (
    table.MODEL, table.FIRMWARE, table.ID, table.PROTOCOL, table.MILLIS, table.DEVICE_STATUS,
    table.HEARTBEAT, *table.LEDS, *table.BUTTONS, *table.BUMPERS, table.ILLUMINATION, table.INFRARED,
    table.SONAR, table.BATTERY_VOLTAGE, table.BATTERY_PERCENTAGE, table.SOUND, table.IMU_RECALIBRATION,
    *table.ANGULAR_VELOCITY, *table.LINEAR_ACCELERATION, *table.MAGNETIC, *table.ORIENTATION,
    *table.PRESENT_CURRENT, *table.PRESENT_VELOCITY, *table.PRESENT_POSITION, table.TORQUE_ENABLE,
    *table.COMMAND_LINEAR, *table.COMMAND_ANGULAR, *table.PROFILE_ACCELERATION,
)  # fmt: skip
_FIRMWARE_4 = (table.MICROS,)
_FIRMWARE_5 = (
    table.DEBUG_MODE, table.CONNECT_ROS2, table.CONNECT_MANIPULATOR, table.MOTOR_CONNECT,
)  # fmt: skip


class OpenCr:
    """Answers ping, read and write; moves the robot's wheels as its firmware would.

    Parameters
    ----------
    line
        To the host.
    robot
        What it drives.
    model
        A key of `MODELS`.
    firmware
        5, or 4: which spoils what follows an FF FF FD in a read.
    random
        Of the encoders' start.
    note
        Called with time, what happened and figures, for whoever watches the robot.

    Attributes
    ----------
    voltage
        Of the battery [V].
    motors_found
        False: none answered at boot, the firmware leaves them alone.
    parser
        Of what the host sends.
    """

    def __init__(
        self, line: Line, robot: Robot, model: str, firmware: int, random: np.random.Generator, note: Note
    ) -> None:
        self.line = line
        self.parser = dxl.Parser()
        self.voltage = 12.0
        self.motors_found = True
        self.calibration_time = 2.56  # s
        self._robot = robot
        self._model = MODELS[model]
        self._old = firmware < 5
        self._note = note
        self._items = (*_COMMON, *(_FIRMWARE_4 if self._old else _FIRMWARE_5))
        self._bytes = bytearray(384)
        self._boot = robot.time
        self._next = robot.time
        self._imu_next = robot.time
        self._blocked: int | None = None  # until when the IMU is recalibrated
        self._waiting = b""
        self._calibration: list[float] = []
        self._bias = self._yaw = 0.0
        self._rate, self._acceleration = 0.0, (0.0, 0.0)
        self._beat_value, self._beat_time, self._alive = 0, 0, False
        self._goal = (0.0, 0.0)  # v, w as the firmware will command them
        self._units = [0, 0]  # what the motors accepted
        self._torque = True
        self._low_since: int | None = None
        self._power = True
        self._zero = [float(z) for z in random.integers(0, table.TICKS, 2)]  # encoder ticks at angle 0
        self._firmware = firmware
        self._set(table.ID, table.DEVICE)
        self._refresh(robot.time)

    def next_due(self) -> int | None:
        """Return when the firmware does something by itself [ns]."""
        return self._imu_next if self._blocked is not None else min(self._imu_next, self._next)

    def receive(self, data: bytes, now: int) -> None:
        """Take bytes from the host; while the IMU is recalibrated they wait."""
        if self._blocked is not None:
            self._waiting = (self._waiting + data)[-4096:]
            return
        for packet in self.parser.feed(data):
            self._take(packet, now)

    def run(self, now: int) -> None:
        """Do what the firmware does by itself; the robot must have been advanced to `now`."""
        if now >= self._imu_next:
            self._imu_next = _after(self._imu_next, _IMU_PERIOD, now)
            self._read_imu()
        if self._blocked is not None:
            if now < self._blocked:
                return
            self._end_calibration(now)
        if now >= self._next:
            self._next = _after(self._next, _REFRESH, now)
            self._beat(now)
            self._battery(now)
            self._motors()
            self._refresh(now)

    def _take(self, packet: dxl.Packet, now: int) -> None:
        if self._blocked is None:
            self._answer(packet, now)
        else:  # a recalibration has begun within this buffer
            self._waiting += dxl.encode(packet.id, packet.instruction, packet.data)

    # --- the protocol -------------------------------------------------------------------------

    def _answer(self, packet: dxl.Packet, now: int) -> None:
        if packet.id != self._bytes[table.ID.address]:
            return
        if packet.instruction == Instruction.PING:
            reply = bytes((*table.MODEL.pack(table.MODEL_NUMBER), self._bytes[table.FIRMWARE.address]))
            self.line.send(dxl.status(packet.id, 0, reply), now)
        elif packet.instruction == Instruction.READ:
            if len(packet.data) != 4:
                self.line.send(dxl.status(packet.id, Error.DATA_LENGTH), now)
                return
            address, length = struct.unpack("<HH", packet.data)
            self.line.send(dxl.status(packet.id, 0, self._read(address, length)), now)
        elif packet.instruction == Instruction.WRITE:
            if len(packet.data) < 3:
                self.line.send(dxl.status(packet.id, Error.DATA_LENGTH), now)
                return
            error = self._write(int.from_bytes(packet.data[:2], "little"), packet.data[2:], now)
            if self._blocked is None:
                self.line.send(dxl.status(packet.id, error), now)

    def _read(self, address: int, length: int) -> bytes:
        length = min(length, 1024)
        data = bytearray(length)
        for item in self._items:
            if address <= item.address and item.end <= address + length:
                data[item.address - address : item.end - address] = self._bytes[item.address : item.end]
        # Register 2 has a mapping of its own.
        info = table.MODEL_INFORMATION
        if address <= info.address and info.end <= address + length:
            data[info.address - address : info.end - address] = info.pack(self._model.information)
        if self._old and (at := data.find(b"\xff\xff\xfd")) >= 0:
            data[at + 3 :] = b"\xfd" * (length - at - 3)
        return bytes(data)

    def _write(self, address: int, data: bytes, now: int) -> int:
        end = address + len(data)
        info = table.MODEL_INFORMATION
        if address <= info.address and info.end <= end:
            return Error.ACCESS
        written = [item for item in self._items if address <= item.address and item.end <= end]
        for item in written:
            self._bytes[item.address : item.end] = data[item.address - address : item.end - address]
        for item in written:
            self._written(item, now)
        if {table.COMMAND_LINEAR[0], table.COMMAND_ANGULAR[2]}.intersection(written):
            self._command(now)
        return Error.NONE

    def _written(self, item: Register, now: int) -> None:
        if item == table.TORQUE_ENABLE:
            torque = bool(self._get(item)) and self._power
            if torque != self._torque:
                self._note(now, "torque", {"on": float(torque)})
            self._torque = torque
            if torque:
                self._units = [0, 0]
        elif item == table.IMU_RECALIBRATION and self._get(item):
            self._blocked = now + round(self.calibration_time * 1e9)
            self._calibration = []
            self._note(now, "imu_recalibration", {})

    def _command(self, now: int) -> None:
        v = self._get(table.COMMAND_LINEAR[0]) * table.COMMAND_UNIT
        w = self._get(table.COMMAND_ANGULAR[2]) * table.COMMAND_UNIT
        self._note(now, "command", {"v": v, "w": w})
        most = self._model
        self._goal = (
            min(max(v, -most.linear_max), most.linear_max),
            min(max(w, -most.angular_max), most.angular_max),
        )

    # --- what it does by itself ---------------------------------------------------------------

    def _beat(self, now: int) -> None:
        value = int(self._get(table.HEARTBEAT))
        if value != self._beat_value:
            self._beat_value, self._beat_time = value, now
            if not self._alive:
                self._note(now, "heartbeat", {"alive": 1.0})
            self._alive = True
        elif self._alive and now - self._beat_time >= table.HEARTBEAT_TIMEOUT * 1e9:
            self._alive = False
            self._note(now, "heartbeat", {"alive": 0.0})
        if not self._alive and (self._old or not self._get(table.DEBUG_MODE)):
            self._goal = (0.0, 0.0)

    def _battery(self, now: int) -> None:
        if self.voltage >= _POWER_CUT:
            self._low_since = None
            self._power = True
        elif self._low_since is None:
            self._low_since = now
        elif self._power and now - self._low_since >= _POWER_CUT_DELAY:
            self._power = self._torque = False
            self._note(now, "power_cut", {"voltage": self.voltage})
            for i in range(2):  # the motors wake within one turn
                ticks = self._ticks(i)
                self._zero[i] -= ticks - ticks % table.TICKS

    def _motors(self) -> None:
        radius = self._robot.parameters.wheel_radius
        acceleration = min(self._get(register) for register in table.PROFILE_ACCELERATION)
        self._robot.ramp(acceleration * table.ACCELERATION_UNIT * radius)
        if not (self._torque and self.motors_found):
            self._units = [0, 0]
            self._robot.drive(0.0, 0.0)
            return
        for i, speed in enumerate(wheel_speeds(*self._goal, self._robot.parameters.wheel_separation)):
            goal = min(max(int(speed * _UNITS), -_UNITS_MAX), _UNITS_MAX)
            if abs(goal) <= self._model.velocity_limit:  # else it is refused, and nobody is told
                self._units[i] = goal
        self._robot.drive(*(goal * table.VELOCITY_UNIT * radius for goal in self._units))

    def _read_imu(self) -> None:
        rate, ax, ay, span = self._robot.inertial()
        if self._blocked is not None:
            self._calibration.append(rate)
            return
        steps = round((rate - self._bias) / _GYRO_STEP)
        self._rate = 0.0 if abs(steps) <= _GYRO_DEAD_BAND else steps * _GYRO_STEP
        self._acceleration = (ax, ay)
        self._yaw += self._rate * span

    def _end_calibration(self, now: int) -> None:
        self._blocked = None
        self._bias = sum(self._calibration) / max(len(self._calibration), 1)
        self._set(table.IMU_RECALIBRATION, 0)
        self._next = now
        self.line.send(dxl.status(self._bytes[table.ID.address]), now)
        waiting, self._waiting = self._waiting, b""
        self.receive(waiting, now)

    def _refresh(self, now: int) -> None:
        since = now - self._boot
        self._set(table.MODEL, table.MODEL_NUMBER)
        self._set(table.FIRMWARE, self._firmware)
        self._set(table.PROTOCOL, 2)
        self._set(table.DEVICE_STATUS, 0 if self.motors_found else -1)
        self._set(table.MILLIS, since // 1_000_000 & 0xFFFFFFFF)
        if self._old:
            self._set(table.MICROS, since // 1_000 & 0xFFFFFFFF)
        else:
            self._set(table.CONNECT_ROS2, self._alive)
            self._set(table.MOTOR_CONNECT, self.motors_found)
        self._set(table.BATTERY_VOLTAGE, round(self.voltage / table.VOLTAGE_UNIT))
        if self.voltage >= 10.5:
            self._set(table.BATTERY_PERCENTAGE, round((self.voltage - 10.5) / 1.8 * 100.0 / table.PERCENT_UNIT))
        vectors = (
            (table.ANGULAR_VELOCITY, (0.0, 0.0, self._rate)),
            (table.LINEAR_ACCELERATION, (*(_stepped(a) for a in self._acceleration), _stepped(_GRAVITY))),
            (table.MAGNETIC, (2.0e-5 * cos(self._yaw), -2.0e-5 * sin(self._yaw), -4.0e-5)),
            (table.ORIENTATION, (cos(0.5 * self._yaw), 0.0, 0.0, sin(0.5 * self._yaw))),
        )
        for registers, values in vectors:
            for register, value in zip(registers, values, strict=True):
                self._set(register, value)
        radius = self._robot.parameters.wheel_radius
        for i, speed in enumerate(self._robot.speeds):
            units = round(speed / (radius * table.VELOCITY_UNIT)) if self._power else 0
            self._set(table.PRESENT_VELOCITY[i], units)
            self._set(table.PRESENT_CURRENT[i], units // 4)
            if self._power:
                self._set(table.PRESENT_POSITION[i], _int32(self._ticks(i)))
        self._set(table.TORQUE_ENABLE, self._torque)

    def _ticks(self, i: int) -> int:
        return round(self._robot.angles[i] / (2.0 * np.pi) * table.TICKS + self._zero[i])

    def _get(self, register: Register) -> float:
        return register.unpack(self._bytes, 0)

    def _set(self, register: Register, value: float) -> None:
        self._bytes[register.address : register.end] = register.pack(value)


def _after(due: int, period: int, now: int) -> int:
    """Return the next time of a periodic deed; what was slept through is not made up for."""
    return due + period if due + period > now else now + period


def _stepped(acceleration: float) -> float:
    return round(acceleration / _ACCELERATION_STEP) * _ACCELERATION_STEP


def _int32(value: int) -> int:
    return (value + 2**31) % 2**32 - 2**31
