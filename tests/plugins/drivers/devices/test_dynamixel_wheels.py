import math

import numpy as np
import pytest

from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3
from knotwork.core.errors import DriverError
from knotwork.core.geometry import relative
from knotwork.core.protocols import xl430


@pytest.fixture
def robot(rig):
    def build(**settings) -> TurtleBot3:
        return rig.enter(TurtleBot3(Settings(world="arena", noise=False, base="dynamixel", **settings)))

    return build


@pytest.fixture
def base(rig):
    def build(robot, **config):
        return rig("dynamixel-wheels", port=robot.base_path, **config)

    return build


def moves(robot):
    return lambda: min(map(abs, robot.robot.speeds)) > 0.05


@pytest.mark.parametrize("fast", [True, False])
def test_odometry_is_the_true_motion(robot, base, rig, fast):
    robot = robot()
    robot.board.fast = fast
    probe = base(robot)
    start = robot.pose()
    drive = rig.drive(probe, 0.15, -0.8)
    probe.until(lambda: robot.path_length > 0.4)
    drive.__exit__()
    probe.until(lambda: robot.robot.speeds == (0.0, 0.0))
    odometry = probe.fresh("odometry", 5)
    error = relative(relative(start, robot.pose()), tuple(odometry.pose))
    assert math.hypot(*error[:2]) < 0.003
    assert abs(error[2]) < 0.005
    assert probe.last("battery").voltage == pytest.approx(12.0)


def test_a_motor_left_in_the_normal_drive_mode_still_rolls_forward(robot, base, rig):
    robot = robot()
    right = robot.board.motors[1]
    right._set(xl430.DRIVE_MODE, 0)
    probe = base(robot)
    start = robot.pose()
    drive = rig.drive(probe, 0.1)
    probe.until(lambda: robot.path_length > 0.1)
    assert min(robot.robot.speeds) >= 0.0
    drive.__exit__()
    probe.until(lambda: robot.robot.speeds == (0.0, 0.0))
    odometry = probe.fresh("odometry", 5)
    assert odometry.pose[0] > 0.1
    np.testing.assert_allclose(odometry.pose, relative(start, robot.pose()), atol=0.003)
    assert any("drive mode" in line for line in probe.lines)


def test_the_bus_watchdog_is_armed_and_its_trip_is_a_fault(robot, base, rig):
    robot = robot()
    probe = base(robot, watchdog=0.2)
    rig.drive(probe, 0.1)
    probe.until(moves(robot))
    assert [motor.get(xl430.BUS_WATCHDOG) for motor in robot.board.motors] == [10, 10]

    def trip() -> None:  # as if the host had been away for a moment
        for motor in robot.board.motors:
            motor._fed -= 10**9

    robot._loop.call(trip)
    probe.until(lambda: probe.last("state").state == "fault")
    assert "watchdog" in probe.last("state").reason
    probe.fresh("odometry", 10)
    assert robot.robot.speeds == (0.0, 0.0)
    probe.rearm()
    probe.until(moves(robot))


def test_a_hardware_error_stops_the_base_and_rearming_reboots_the_motor(robot, base, rig):
    robot = robot()
    probe = base(robot)
    rig.drive(probe, 0.1)
    probe.until(moves(robot))
    robot._loop.call(lambda: robot.board.motors[0].fail(0x20))
    probe.until(lambda: probe.last("state").state == "fault")
    assert probe.last("state").reason == "left motor: overload"
    probe.fresh("odometry", 10)
    assert robot.robot.speeds == (0.0, 0.0)
    probe.rearm()
    probe.until(moves(robot))
    assert any(o.discontinuity for o in probe.given["odometry"])


def test_an_unplugged_adapter_is_waited_for(robot, base, rig):
    robot = robot()
    probe = base(robot)
    rig.drive(probe, 0.1)
    probe.until(moves(robot))
    robot.unplug("base")
    probe.until(lambda: probe.counts.get("lost"))
    robot.replug("base")
    probe.until(lambda: probe.counts.get("reconnects"))
    probe.fresh("odometry", 10)
    assert robot.robot.speeds == (0.0, 0.0)
    assert any(o.discontinuity for o in probe.given["odometry"])
    probe.rearm()
    probe.until(moves(robot))


def test_lost_bytes_cost_retries_and_nothing_else(robot, base, rig):
    robot = robot(seed=5)
    probe = base(robot)
    robot.disturb("base", drop=0.002)
    rig.drive(probe, 0.1, 0.2)
    probe.until(lambda: robot.path_length > 0.3)
    assert probe.driver.statistics()["retries"] > 0
    assert not any(o.discontinuity for o in probe.given["odometry"])


def test_at_the_end_watchdog_and_torque_are_off(robot, base, rig):
    robot = robot()
    probe = base(robot)
    rig.drive(probe, 0.2)
    probe.until(moves(robot))
    probe.__exit__()
    assert robot.robot.speeds == (0.0, 0.0)
    for motor in robot.board.motors:
        assert motor.get(xl430.TORQUE_ENABLE) == 0
        assert motor.get(xl430.BUS_WATCHDOG) == 0


def test_a_missing_motor_is_named(robot, rig):
    robot = robot()
    with pytest.raises(DriverError, match=r"right motor \(id 7\) does not answer"):
        rig("dynamixel-wheels", port=robot.base_path, right=7)
