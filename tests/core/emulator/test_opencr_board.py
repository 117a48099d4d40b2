"""The emulated OpenCR against what is known of the real one's firmware."""

import struct

import numpy as np
import pytest
from electronics_bench import Bench

from knotwork.core.emulator.opencr_board import OpenCr
from knotwork.core.protocols import dynamixel as dxl
from knotwork.core.protocols import opencr as table
from knotwork.core.protocols.registers import Register


class Board(Bench):
    def __init__(self, model: str = "burger", firmware: int = 5) -> None:
        super().__init__(lambda line, robot, note: OpenCr(line, robot, model, firmware, np.random.default_rng(5), note))
        self.beats = 0

    def get(self, register: Register) -> float:
        (answer,) = self.send(dxl.read(200, register.address, register.size))
        assert answer.error == 0
        return register.unpack(answer.data, register.address)

    def put(self, register: Register, value: float) -> None:
        assert self.send(dxl.write(200, register.address, register.pack(value))) == [(200, 0x55, 0, b"", 11)]

    def drive(self, v: int, w: int = 0) -> None:
        """In hundredths."""
        data = struct.pack("<6i", v, 0, 0, 0, 0, w)
        assert len(self.send(dxl.write(200, 150, data))) == 1

    def live(self, seconds: float) -> None:
        """Let time pass with a heart that beats."""
        for _ in range(round(seconds / 0.1)):
            self.beats = (self.beats + 1) % 256
            self.put(table.HEARTBEAT, self.beats)
            self.wait(0.1)


def test_published_ping() -> None:
    board = Board()
    board.board.receive(bytes.fromhex("FF FF FD 00 C8 03 00 01 3B FA"), board.now)
    assert board.line.wire.hex(" ").upper() == "FF FF FD 00 C8 07 00 55 00 00 50 05 4C B7"


def test_answers_only_what_the_slave_library_knows() -> None:
    board = Board()
    for frame in (
        dxl.ping(dxl.BROADCAST), dxl.ping(1), dxl.reboot(200), dxl.sync_read((200,), 10, 4),
        dxl.fast_sync_read((200,), 10, 4), dxl.sync_write(150, {200: bytes(4)}),
        dxl.encode(200, dxl.Instruction.REG_WRITE, bytes(6)), dxl.encode(200, dxl.Instruction.BULK_READ, bytes(5)),
        dxl.read(200, 0, 2)[:-1] + b"\x00", dxl.status(200),
    ):  # fmt: skip
        assert board.send(frame) == []
    assert board.get(table.MODEL) == 0x5000


def test_items_that_a_read_covers_in_part_are_zeros() -> None:
    board = Board()
    (answer,) = board.send(dxl.read(200, 43, 6))  # cuts voltage (42 to 45) and percentage (46 to 49)
    assert answer.data == bytes(6)
    assert board.get(table.BATTERY_VOLTAGE) == 1200
    assert board.get(table.BATTERY_PERCENTAGE) == pytest.approx((12.0 - 10.5) / 1.8 * 1e4, abs=1)
    (answer,) = board.send(dxl.read(200, 10, 172))
    assert len(answer.data) == 172
    assert answer.data[42 - 10 : 46 - 10] == (1200).to_bytes(4, "little")


def test_a_write_in_part_does_nothing() -> None:
    board = Board()
    board.live(0.2)
    board.send(dxl.write(200, 150, b"\x0a\x00"))
    board.live(0.3)
    assert board.robot.speeds == (0.0, 0.0)
    assert board.get(table.COMMAND_LINEAR[0]) == 0


def test_register_protection() -> None:
    board = Board()
    assert board.get(table.MODEL_INFORMATION) == 1
    assert board.send(dxl.write(200, 2, bytes(4)))[0].error == dxl.Error.ACCESS
    board.put(table.MODEL, 7)
    assert board.get(table.MODEL) == 7
    board.wait(0.03)
    assert board.get(table.MODEL) == 0x5000
    board.put(table.ID, 9)
    assert board.send(dxl.ping(200)) == []
    assert len(board.send(dxl.ping(9))) == 1


def test_drives_as_told_and_counts_ticks() -> None:
    board = Board()
    board.wait(0.05)
    before = [board.get(r) for r in table.PRESENT_POSITION]
    board.live(0.2)
    board.drive(10, 50)
    board.live(2.0)
    left, right = 0.10 - 0.5 * 0.08, 0.10 + 0.5 * 0.08
    # Whole units of the motors, truncated by the firmware.
    units = [int(left * 1263.633), int(right * 1263.633)]
    assert [board.get(r) for r in table.PRESENT_VELOCITY] == units
    rims = [u * 0.229 * 2 * np.pi / 60 * 0.033 for u in units]
    assert board.robot.speeds == pytest.approx(rims)
    assert board.get(table.ANGULAR_VELOCITY[2]) == pytest.approx((rims[1] - rims[0]) / 0.16, abs=0.0011)
    moved = [board.get(r) - b for r, b in zip(table.PRESENT_POSITION, before, strict=True)]
    assert moved == pytest.approx([2.0 * r / 0.033 / (2 * np.pi) * 4096 for r in rims], rel=0.03)
    w, _, _, z = (board.get(r) for r in table.ORIENTATION)
    assert 2 * np.arctan2(z, w) == pytest.approx(board.robot.base.pose[2] - board.robot.start[2], abs=0.02)


def test_heart_stops_the_wheels_after_half_a_second_and_needs_a_new_command() -> None:
    board = Board()
    board.drive(10)
    board.wait(0.3)
    assert board.robot.speeds == (0.0, 0.0)  # no heartbeat yet
    board.put(table.HEARTBEAT, 0)
    board.wait(0.1)
    assert board.get(table.CONNECT_ROS2) == 0  # 0 is what it remembered: no beat
    board.live(0.2)
    board.drive(10)
    board.live(1.0)
    assert min(board.robot.speeds) > 0.09
    last = board.now - 100_000_000
    for _ in range(12):  # writes go on, the heartbeat does not change
        board.put(table.HEARTBEAT, board.beats)
        board.drive(10)
        board.wait(0.05)
    stop = next(t for t, kind, f in board.notes if kind == "heartbeat" and not f["alive"])
    assert 0.5 <= (stop - last) * 1e-9 <= 0.54
    assert board.robot.speeds == pytest.approx((0.0, 0.0), abs=1e-9)
    board.live(0.5)
    assert board.get(table.COMMAND_LINEAR[0]) == 10
    assert board.robot.speeds == pytest.approx((0.0, 0.0), abs=1e-9)
    board.drive(10)
    board.live(0.2)
    assert min(board.robot.speeds) > 0.09


def test_debug_mode_switches_the_heartbeat_off() -> None:
    board = Board()
    board.put(table.DEBUG_MODE, 1)
    board.drive(10)
    board.wait(1.0)
    assert min(board.robot.speeds) > 0.09


@pytest.mark.parametrize(
    ("model", "v", "w", "units"),
    [
        ("burger", 21, 0, (265, 265)),  # 0.21 m/s: the last that the motors take
        ("burger", 22, 0, (100, 100)),  # clamped to 0.2108 m/s, 266 units: refused, the old speed stays
        ("burger", 20, 50, (202, 100)),  # half executed: the right wheel refuses
        ("burger", 0, 284, (-266, 266)),  # 2.635 rad/s: 266 units
        ("waffle", 26, 0, (328, 328)),
        ("waffle", 27, 0, (100, 100)),
    ],
)
def test_goals_over_the_motors_limit_are_refused(model: str, v: int, w: int, units: tuple[int, int]) -> None:
    board = Board(model)
    board.live(0.2)
    board.drive(8)  # 101 units
    board.live(0.3)
    old = int(0.08 * 1263.633)
    board.drive(v, w)
    board.live(0.5)
    limit = {"burger": 265, "waffle": 330}[model]
    expected = [old if abs(u) > limit or u == 100 else u for u in units]
    assert [board.get(r) for r in table.PRESENT_VELOCITY] == expected


def test_profile_acceleration_ramps() -> None:
    board = Board()
    board.live(0.2)
    data = struct.pack("<2I", 40, 40)  # 0.5 m/s^2
    board.send(dxl.write(200, 174, data))
    board.wait(0.02)
    board.drive(20)
    begin = board.now
    board.live(0.2)
    elapsed = (board.now - begin) * 1e-9
    assert board.robot.speeds[0] == pytest.approx(0.4943 * elapsed, abs=0.4943 * 0.022)


def test_torque_off_lets_go() -> None:
    board = Board()
    board.live(0.2)
    board.drive(10)
    board.live(0.3)
    board.put(table.TORQUE_ENABLE, 0)
    board.live(0.3)
    assert board.robot.speeds == pytest.approx((0.0, 0.0), abs=1e-9)
    assert board.get(table.TORQUE_ENABLE) == 0
    board.put(table.TORQUE_ENABLE, 1)
    board.drive(10)
    board.live(0.3)
    assert min(board.robot.speeds) > 0.09


def test_recalibration_blocks_and_its_answer_comes_late() -> None:
    board = Board()
    board.live(0.2)
    board.drive(10)
    board.live(0.5)
    assert board.send(dxl.write(200, 59, b"\x01")) == []
    assert board.send(dxl.read(200, 0, 2)) == []
    board.wait(2.5)
    assert min(board.robot.speeds) > 0.09  # nobody looks after the wheels
    assert board.answers() == []
    board.wait(0.1)
    late = board.answers()
    assert [(p.end, p.data) for p in late[:1]] == [(11, b"")]
    assert late[1].data == b"\x00\x50"  # the read that waited
    board.wait(0.1)
    assert board.robot.speeds == pytest.approx((0.0, 0.0), abs=1e-9)  # the heart had stopped
    assert board.get(table.IMU_RECALIBRATION) == 0


def test_recalibration_while_turning_spoils_the_gyro() -> None:
    board = Board()
    board.live(0.2)
    board.drive(0, 50)
    board.live(0.5)
    turning = board.get(table.ANGULAR_VELOCITY[2])
    board.send(dxl.write(200, 59, b"\x01"))
    board.wait(3.0)
    assert turning > 0.45
    assert board.get(table.ANGULAR_VELOCITY[2]) == pytest.approx(-turning, abs=0.02)


def test_old_firmware_spoils_what_follows_ff_ff_fd() -> None:
    values = {}
    for firmware in (4, 5):
        board = Board(firmware=firmware)
        for register, value in zip((*table.PRESENT_VELOCITY, *table.PRESENT_POSITION), (-5, -3, 40, -700), strict=True):
            board.board._set(register, value)
        (answer,) = board.send(dxl.read(200, 128, 16))
        values[firmware] = struct.unpack("<4i", answer.data)
    assert values[5] == (-5, -3, 40, -700)
    spoilt = struct.unpack("<i", table.CORRUPT)[0]
    # FB FF FF FF | FD ... : the first value ends in FF FF FF, the next begins with FD.
    assert values[4][0] == -5
    assert values[4][1:] == (spoilt,) * 3


def test_power_cut_of_a_flat_battery() -> None:
    board = Board()
    board.live(0.2)
    board.drive(10)
    board.live(6.0)
    far = board.get(table.PRESENT_POSITION[0])
    assert far > 8192
    board.board.voltage = 10.9
    board.live(5.5)
    assert "power_cut" in board.kinds()
    board.board.voltage = 11.5
    board.drive(10)
    board.live(0.3)
    assert board.robot.speeds == pytest.approx((0.0, 0.0), abs=1e-9)  # the torque stays off
    assert 0 <= board.get(table.PRESENT_POSITION[0]) < 4096
    board.put(table.TORQUE_ENABLE, 1)
    board.live(0.3)
    assert min(board.robot.speeds) > 0.09


def test_firmware_versions_differ() -> None:
    old = Board(firmware=4)
    old.wait(1.0)
    assert old.get(table.FIRMWARE) == 4
    assert old.get(table.MICROS) == pytest.approx(1e6, abs=3e4)
    assert old.get(table.MILLIS) == pytest.approx(1e3, abs=30)
    assert old.get(table.MOTOR_CONNECT) == 0
    assert Board().get(table.MOTOR_CONNECT) == 1


def test_without_motors_nothing_moves() -> None:
    board = Board()
    board.board.motors_found = False
    board.live(0.2)
    board.drive(10)
    board.live(0.3)
    assert board.get(table.DEVICE_STATUS) == -1
    assert board.robot.speeds == (0.0, 0.0)
