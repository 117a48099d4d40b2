"""Emulated XL430 motors against their manual."""

import pytest
from electronics_bench import Bench

from knotwork.core.emulator.motor_bus import MotorBus
from knotwork.core.emulator.xl430_motor import Motor
from knotwork.core.protocols import dynamixel as dxl
from knotwork.core.protocols import xl430 as table
from knotwork.core.protocols.dynamixel import Error
from knotwork.core.protocols.registers import Register


class Bus(Bench):
    def __init__(self, right_mode: int = table.REVERSE) -> None:
        motors = (Motor(1, table.XL430, False, 0, 100), Motor(2, table.XL430, True, right_mode, 200))
        super().__init__(lambda line, robot, note: MotorBus(line, robot, motors, note))
        self.motors = motors

    def get(self, device: int, register: Register) -> float:
        (answer,) = self.send(dxl.read(device, register.address, register.size))
        assert answer.failure == 0
        return register.unpack(answer.data, register.address)

    def put(self, device: int, register: Register, value: float) -> int:
        (answer,) = self.send(dxl.write(device, register.address, register.pack(value)))
        assert answer.id == device
        return answer.error

    def arm(self, watchdog: int = 0) -> None:
        for device in (1, 2):
            assert self.put(device, table.TORQUE_ENABLE, 1) == 0
            if watchdog:
                assert self.put(device, table.BUS_WATCHDOG, watchdog) == 0

    def both(self, left: int, right: int) -> None:
        goals = {1: table.GOAL_VELOCITY.pack(left), 2: table.GOAL_VELOCITY.pack(right)}
        assert self.send(dxl.sync_write(104, goals)) == []


def test_positive_goals_drive_forward_on_both_sides() -> None:
    bus = Bus()
    bus.arm()
    bus.both(100, 200)
    bus.wait(1.0)
    rims = [u * table.VELOCITY_UNIT * 0.033 for u in (100, 200)]
    assert bus.robot.speeds == pytest.approx(rims)
    answers = bus.send(dxl.sync_read((1, 2), 126, 10))
    assert [p.id for p in answers] == [1, 2]
    assert [table.PRESENT_VELOCITY.unpack(p.data, 126) for p in answers] == [100, 200]
    (fast,) = bus.send(dxl.fast_sync_read((1, 2), 126, 10))
    assert [p[:4] for p in dxl.split_fast(fast, 10)] == [p[:4] for p in answers]
    assert bus.get(2, table.PRESENT_POSITION) - 200 == pytest.approx(rims[1] / 0.033 / 6.28319 * 4096, rel=0.06)


def test_a_motor_left_at_its_factory_drive_mode_turns_backwards() -> None:
    bus = Bus(right_mode=0)
    bus.arm()
    bus.both(100, 100)
    bus.wait(0.5)
    left, right = bus.robot.speeds
    assert left > 0.0
    assert right == pytest.approx(-left)
    assert bus.get(2, table.PRESENT_VELOCITY) == 100


def test_bus_watchdog_stops_and_locks_the_goals() -> None:
    bus = Bus()
    bus.arm(watchdog=10)
    bus.both(100, 100)
    for _ in range(10):  # any instruction packet on the bus feeds it
        bus.wait(0.15)
        bus.send(dxl.ping(1))
    assert bus.robot.speeds[0] > 0.0
    last = bus.now
    bus.wait(0.3)
    trips = [t for t, kind, _ in bus.notes if kind == "bus_watchdog"]
    assert len(trips) == 2
    assert all(0.2 <= (t - last) * 1e-9 <= 0.206 for t in trips)
    assert bus.robot.speeds == pytest.approx((0.0, 0.0), abs=1e-9)
    assert bus.get(1, table.BUS_WATCHDOG) == table.WATCHDOG_TRIPPED
    assert bus.put(1, table.GOAL_VELOCITY, 10) == Error.DATA_RANGE
    bus.both(100, 100)
    bus.wait(0.1)
    assert bus.robot.speeds == pytest.approx((0.0, 0.0), abs=1e-9)
    for device in (1, 2):
        assert bus.put(device, table.BUS_WATCHDOG, 0) == 0
    bus.both(100, 100)
    bus.wait(0.1)
    assert min(bus.robot.speeds) > 0.0


def test_watchdog_sleeps_without_torque() -> None:
    bus = Bus()
    assert bus.put(1, table.BUS_WATCHDOG, 5) == 0
    bus.wait(1.0)
    assert bus.get(1, table.BUS_WATCHDOG) == 5
    assert bus.put(1, table.BUS_WATCHDOG, -2) == Error.DATA_RANGE


def test_refusals() -> None:
    bus = Bus()
    bus.arm()
    assert bus.put(1, table.GOAL_VELOCITY, 265) == 0
    assert bus.put(1, table.GOAL_VELOCITY, 266) == Error.DATA_LIMIT
    assert bus.put(1, table.GOAL_VELOCITY, -266) == Error.DATA_LIMIT
    assert bus.get(1, table.GOAL_VELOCITY) == 265
    assert bus.put(1, table.DRIVE_MODE, 1) == Error.ACCESS  # EEPROM under torque
    assert bus.put(1, table.PRESENT_VELOCITY, 1) == Error.ACCESS
    assert bus.send(dxl.write(1, 104, b"\x01\x02"))[0].error == Error.ACCESS
    assert bus.send(dxl.read(1, 140, 100))[0].error == Error.ACCESS
    assert bus.send(dxl.encode(1, 0x77))[0].error == Error.INSTRUCTION
    assert bus.send(dxl.ping(77)) == []


def test_hardware_error_cuts_the_torque_and_shows_as_alert_until_reboot() -> None:
    bus = Bus()
    bus.arm()
    bus.both(100, 100)
    bus.wait(3.5)
    bus.motors[0].fail(0x20)
    assert bus.put(1, table.LED, 1) == dxl.ALERT
    assert bus.get(1, table.HARDWARE_ERROR) == 0x20
    assert bus.put(1, table.TORQUE_ENABLE, 1) == dxl.ALERT | Error.RESULT_FAIL
    bus.wait(0.2)
    assert bus.robot.speeds[0] == pytest.approx(0.0, abs=1e-9)
    assert bus.robot.speeds[1] > 0.0
    position = bus.get(1, table.PRESENT_POSITION)
    assert position > 4096
    assert len(bus.send(dxl.reboot(1))) == 1
    assert bus.send(dxl.ping(1)) == []
    assert [p.id for p in bus.send(dxl.sync_read((1, 2), 132, 4))] == []  # 2 waits for 1 in vain
    assert [p.id for p in bus.send(dxl.sync_read((2, 1), 132, 4))] == [2]
    bus.wait(0.4)
    assert bus.get(1, table.HARDWARE_ERROR) == 0
    assert bus.get(1, table.PRESENT_POSITION) == position % 4096
    assert bus.put(1, table.TORQUE_ENABLE, 1) == 0


def test_profile_and_mode() -> None:
    bus = Bus()
    assert bus.put(1, table.OPERATING_MODE, 3) == 0
    for device in (1, 2):
        assert bus.put(device, table.PROFILE_ACCELERATION, 40) == 0
    bus.arm()
    bus.both(200, 200)
    bus.wait(0.1)
    assert bus.robot.speeds == pytest.approx((0.0, 0.494 * 0.1), abs=0.006)  # 1 is in position mode


def test_status_return_level_and_broadcast() -> None:
    bus = Bus()
    assert [p.id for p in bus.send(dxl.ping(dxl.BROADCAST))] == [1, 2]
    assert bus.send(dxl.write(dxl.BROADCAST, 65, b"\x01")) == []
    assert bus.get(2, table.LED) == 1
    bus.send(dxl.write(1, 68, b"\x01"))
    assert bus.send(dxl.write(1, 65, b"\x00")) == []
    assert len(bus.send(dxl.read(1, 65, 1))) == 1
    bus.send(dxl.write(1, 68, b"\x00"))
    assert bus.send(dxl.read(1, 65, 1)) == []
    assert len(bus.send(dxl.ping(1))) == 1


def test_echo_and_old_firmware() -> None:
    bus = Bus()
    bus.board.echo = True
    answers = bus.send(dxl.ping(1))
    assert [p.is_status for p in answers] == [False, True]
    bus.board.echo = False
    bus.board.fast = False
    assert bus.send(dxl.fast_sync_read((1, 2), 132, 4)) == []
