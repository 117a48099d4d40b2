"""A bus of Dynamixel motors behind a U2D2, as its host sees it."""

import struct

from knotwork.core.emulator.line import Line
from knotwork.core.emulator.opencr_board import Note
from knotwork.core.emulator.robot import Robot
from knotwork.core.emulator.xl430_motor import Motor, Wheel
from knotwork.core.protocols import dynamixel as dxl
from knotwork.core.protocols import xl430 as table
from knotwork.core.protocols.dynamixel import BROADCAST, Error, Instruction

_PERIOD = 5_000_000  # ns between looks at the watchdogs


class MotorBus:
    """Left and right motor on one line.

    Parameters
    ----------
    line
        To the host.
    robot
        What they drive.
    motors
        Left and right.
    note
        Called with time, what happened and figures, for whoever watches the robot.
    fast
        Their firmware knows Fast Sync Read.

    Attributes
    ----------
    echo
        The adapter gives back what the host sends, as some half-duplex adapters do.
    parser
        Of what the host sends.
    """

    def __init__(self, line: Line, robot: Robot, motors: tuple[Motor, Motor], note: Note, fast: bool = True) -> None:
        self.line = line
        self.parser = dxl.Parser()
        self.motors = motors
        self.echo = False
        self.fast = fast
        self._robot = robot
        self._note = note
        self._next = robot.time

    def next_due(self) -> int | None:
        """Return when the motors do something by themselves [ns]."""
        return self._next

    def run(self, now: int) -> None:
        """Let the motors drive the wheels, feel them, and look at their watchdogs."""
        if now < self._next:
            return
        self._next = max(self._next + _PERIOD, now + 1)
        self._drive(now)

    def receive(self, data: bytes, now: int) -> None:
        """Take bytes from the host."""
        if self.echo:
            self.line.send(data, now)
        for packet in self.parser.feed(data):
            if packet.is_status:
                continue
            self._drive(now)
            for motor in self.motors:
                motor.feed(now)
            self._answer(packet, now)
            self._drive(now)

    def _drive(self, now: int) -> None:
        radius = self._robot.parameters.wheel_radius
        for motor, speed, angle in zip(self.motors, self._robot.speeds, self._robot.angles, strict=True):
            motor.present = Wheel(speed / radius, angle)
            if motor.run(now):
                self._note(now, "bus_watchdog", {"id": float(motor.id)})
        self._robot.ramp(min(motor.acceleration for motor in self.motors) * radius)
        left, right = self.motors
        self._robot.drive(left.goal * radius, right.goal * radius)

    def _answer(self, packet: dxl.Packet, now: int) -> None:
        listening = [motor for motor in self.motors if motor.answers]
        data = packet.data
        if packet.instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
            if packet.id == BROADCAST and len(data) > 4:
                self._sync_read(packet, listening, now)
        elif packet.instruction == Instruction.SYNC_WRITE:
            if packet.id == BROADCAST and len(data) > 4:
                self._sync_write(data, listening, now)
        else:
            for motor in sorted(listening, key=lambda m: m.id):
                if packet.id in (motor.id, BROADCAST):
                    self._single(packet, motor, now)

    def _single(self, packet: dxl.Packet, motor: Motor, now: int) -> None:
        error: int = Error.NONE
        reply = b""
        level = motor.get(table.STATUS_RETURN_LEVEL)
        silent = packet.id == BROADCAST or level < 2
        identifier = motor.id
        if packet.instruction == Instruction.PING:
            reply = motor.read(0, 2)[1] + motor.read(table.FIRMWARE.address, 1)[1]
            silent = False
        elif packet.instruction == Instruction.READ:
            silent = packet.id == BROADCAST or level < 1
            if len(packet.data) == 4:
                error, reply = motor.read(*struct.unpack("<HH", packet.data))
            else:
                error = Error.DATA_LENGTH
        elif packet.instruction == Instruction.WRITE:
            error = self._write(motor, packet.data, now) if len(packet.data) > 2 else Error.DATA_LENGTH
        elif packet.instruction == Instruction.REBOOT:
            self._note(now, "reboot", {"id": float(identifier)})
            error = motor.error
            motor.reboot(now)
            error &= 0x7F
        elif packet.instruction == Instruction.CLEAR:
            error = Error.NONE
        else:
            error = Error.INSTRUCTION
        if not silent:
            self.line.send(dxl.status(identifier, error | motor.error, reply), now)

    def _write(self, motor: Motor, data: bytes, now: int) -> int:
        address, value = int.from_bytes(data[:2], "little"), data[2:]
        error = motor.write(address, value)
        if address == table.GOAL_VELOCITY.address and len(value) == 4:
            goal = table.GOAL_VELOCITY.unpack(value, address)
            self._note(now, "goal", {"id": float(motor.id), "units": goal, "error": float(error)})
        return error

    def _sync_write(self, data: bytes, listening: list[Motor], now: int) -> None:
        address, length = data[:2], int.from_bytes(data[2:4], "little")
        if (len(data) - 4) % (length + 1):
            return
        for at in range(4, len(data), length + 1):
            for motor in listening:
                if motor.id == data[at]:
                    self._write(motor, address + data[at + 1 : at + 1 + length], now)

    def _sync_read(self, packet: dxl.Packet, listening: list[Motor], now: int) -> None:
        address, length = struct.unpack_from("<HH", packet.data)
        parts = []
        for identifier in packet.data[4:]:
            motor = next((m for m in listening if m.id == identifier), None)
            if motor is None:
                break  # those after it wait for its answer in vain
            error, data = motor.read(address, length)
            parts.append(dxl.Packet(identifier, Instruction.STATUS, error | motor.error, data))
        if packet.instruction == Instruction.SYNC_READ:
            for part in parts:
                self.line.send(dxl.status(part.id, part.error, part.data), now)
        elif self.fast and len(parts) == len(packet.data) - 4:
            self.line.send(dxl.fast_status(parts), now)
