import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.clock import epoch
from knotwork.core.emulator.turtlebot3 import Settings, TurtleBot3
from knotwork.core.errors import DriverError
from knotwork.core.geometry import relative
from knotwork.core.messages import MotionControl
from knotwork.plugins.drivers.opencr.board import GEOMETRIES, damaged, quantised


@pytest.fixture
def robot(rig):
    def build(**settings) -> TurtleBot3:
        return rig.enter(TurtleBot3(Settings(world="arena", noise=False, **settings)))

    return build


@pytest.fixture
def base(rig):
    def build(robot, **config):
        return rig("opencr", port=robot.base_path, **{"calibrate_gyro": False} | config)

    return build


def moves(robot):
    return lambda: min(map(abs, robot.robot.speeds)) > 0.05


def stands(robot):
    return lambda: robot.robot.speeds == (0.0, 0.0)


@pytest.mark.parametrize("heading", ["gyro", "wheels"])
def test_odometry_is_the_true_motion(robot, base, rig, heading):
    robot = robot()
    probe = base(robot, odometry=heading)
    start = robot.pose()
    drive = rig.drive(probe, 0.15, 0.8)
    probe.until(lambda: robot.path_length > 0.5)
    drive.__exit__()
    probe.until(stands(robot))
    odometry = probe.fresh("odometry", 5)
    error = relative(relative(start, robot.pose()), tuple(odometry.pose))
    assert math.hypot(*error[:2]) < 0.005
    # the gyro counts in steps of 0.001 rad/s and has a dead band
    assert abs(error[2]) < (0.02 if heading == "gyro" else 0.005)
    assert not any(o.discontinuity for o in probe.given["odometry"])
    stamps = np.array([o.stamp for o in probe.given["odometry"]])
    assert (np.diff(stamps) > 0).all()
    assert probe.last("battery").voltage == pytest.approx(12.0)
    assert probe.last("imu").linear_acceleration[2] == pytest.approx(9.8, abs=0.1)
    assert probe.last("wheels").velocity.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("model", "fastest"), [("burger", 0.2097), ("waffle", 0.2611)])
def test_commands_over_the_limit_keep_their_curve_and_no_wheel_refuses_them(robot, base, rig, model, fastest):
    robot = robot(model=model)
    probe = base(robot)
    assert any(model in line for line in probe.lines)
    rig.drive(probe, 1.0, 1.0)
    separation = GEOMETRIES[model].separation
    left, right = 1.0 - separation / 2, 1.0 + separation / 2
    # commands come in steps of 0.01 m/s and 0.01 rad/s
    probe.until(lambda: robot.robot.speeds[1] > 0.95 * fastest)
    probe.fresh("odometry", 10)
    speeds = robot.robot.speeds
    assert speeds[1] <= fastest + 1e-4
    assert speeds[0] / speeds[1] == pytest.approx(left / right, rel=0.03)


@given(
    v=st.floats(-0.3, 0.3),
    w=st.floats(-3.0, 3.0),
    geometry=st.sampled_from([GEOMETRIES["burger"], GEOMETRIES["waffle"]]),
)
def test_a_rounded_command_is_one_that_the_motors_take(v, w, geometry):
    factor = min(1.0, geometry.fastest / (abs(v) + abs(w) * geometry.separation / 2 + 1e-12))
    v, w = v * factor, w * factor
    a, b = quantised(v, w, geometry)
    for side in (-1, 1):
        rim = a * 0.01 + side * b * 0.01 * geometry.separation / 2
        assert int(abs(rim) * 1263.633) <= geometry.units
    assert abs(a * 0.01 - v) <= 0.01
    assert abs(b * 0.01 - w) <= 0.01


def test_reads_that_old_firmware_spoils_are_repeated_register_by_register(robot, base):
    robot = robot(firmware=4)
    # left -5 ticks, right 253: FF FF | FD, and everything after it reads FD, under a valid checksum
    robot.board._zero[:] = [-5.0, 253.0]
    probe = base(robot)
    probe.fresh("odometry", 20)
    assert probe.driver.statistics()["guarded_reads"] > 10
    poses = np.array([o.pose for o in probe.given["odometry"]])
    assert np.abs(poses).max() == 0.0
    assert probe.driver.statistics()["encoder_restarts"] == 0


@given(data=st.binary(max_size=60))
def test_whatever_old_firmware_spoils_is_noticed(data):
    at = data.find(b"\xff\xff\xfd")
    if 0 <= at < len(data) - 3:
        assert damaged(data[: at + 3] + b"\xfd" * (len(data) - at - 3))


def test_an_unplugged_base_is_waited_for_and_stands_until_rearmed(robot, base, rig):
    robot = robot()
    probe = base(robot)
    rig.drive(probe, 0.1)
    probe.until(moves(robot))
    robot.unplug("base")
    probe.until(lambda: probe.last("state").state == "fault")
    probe.rearm()
    probe.until(lambda: any("cannot re-arm" in line for line in probe.lines))
    before = probe.last("odometry").pose
    robot.replug("base")
    probe.until(lambda: any(o.discontinuity for o in probe.given["odometry"]))
    again = next(o for o in probe.given["odometry"] if o.discontinuity)
    assert again.pose.tolist() == before.tolist()  # it goes on from where it was, and says so
    probe.fresh("odometry", 20)
    assert robot.robot.speeds == (0.0, 0.0)  # though commands keep coming
    assert (probe.counts["lost"], probe.counts["reconnects"]) == (1, 1)
    probe.rearm()
    probe.until(moves(robot))
    assert probe.last("state").state == "ready"


def test_encoders_that_restart_are_a_discontinuity_and_a_fault(robot, base, rig):
    robot = robot()
    probe = base(robot)
    probe.fresh("odometry", 5)

    def restart() -> None:
        robot.board._zero[0] += 50_000

    robot._loop.call(restart)
    probe.until(lambda: any(o.discontinuity for o in probe.given["odometry"]))
    assert np.abs(probe.last("odometry").pose).max() == 0.0
    probe.until(lambda: "encoders" in probe.last("state").reason)


def test_torque_that_goes_off_is_noticed_and_comes_back_with_rearming(robot, base, rig):
    robot = robot()
    probe = base(robot)
    probe.fresh("odometry")
    robot._loop.call(lambda: setattr(robot.board, "_torque", False))
    probe.until(lambda: "torque" in probe.last("state").reason)
    probe.rearm()
    rig.drive(probe, 0.1)
    probe.until(moves(robot))


def test_the_emergency_stop_holds_until_rearmed(robot, base, rig):
    robot = robot()
    probe = base(robot)
    rig.drive(probe, 0.1)
    probe.until(moves(robot))
    probe.driver.on_control(MotionControl(stamp=epoch(), action="stop"))
    probe.until(stands(robot))
    probe.fresh("odometry", 20)
    assert robot.robot.speeds == (0.0, 0.0)
    assert probe.last("state").state == "emergency"
    probe.rearm()
    probe.until(moves(robot))


def test_lost_bytes_cost_retries_and_nothing_else(robot, base, rig):
    robot = robot(seed=3)
    probe = base(robot)
    robot.disturb("base", drop=0.002, flip=0.0002)
    rig.drive(probe, 0.1, 0.2)
    probe.until(lambda: robot.path_length > 0.3)
    assert probe.driver.statistics()["retries"] > 0
    assert not any(o.discontinuity for o in probe.given["odometry"])


def test_at_the_end_the_robot_stands_and_the_torque_is_off(robot, base, rig):
    robot = robot()
    probe = base(robot)
    drive = rig.drive(probe, 0.2)
    probe.until(moves(robot))
    probe.driver.stop_motion()
    assert robot.robot.speeds == (0.0, 0.0)
    drive.__exit__()
    probe.driver.stop()
    probe.driver.close()
    assert not robot.board._torque


def test_the_gyro_is_calibrated_at_the_start(robot, base):
    robot = robot()
    robot.board.calibration_time = 0.2
    robot.robot.base._bias = 0.02  # rad/s
    probe = base(robot, calibrate_gyro=True)
    assert any(event.kind == "imu_recalibration" for event in robot.events)
    probe.fresh("imu", 10)
    assert abs(probe.last("imu").angular_velocity[2]) < 0.004


def test_a_port_that_is_not_there_says_so(tmp_path, rig):
    with pytest.raises(DriverError, match="no such device"):
        rig("opencr", port=str(tmp_path / "nothing"))


def test_another_device_is_refused(robot, rig):
    robot = robot()
    with pytest.raises(DriverError, match="no TurtleBot3 answers"):
        rig("opencr", port=robot.lidar_path)


def test_a_mistake_in_the_thread_stops_the_wheels_and_ends_the_run(robot, base, rig, monkeypatch):
    robot = robot()
    probe = base(robot)
    rig.drive(probe, 0.1)
    probe.until(moves(robot))

    def mistaken(now: int) -> bool:
        raise ValueError("a mistake")

    monkeypatch.setattr(probe.driver, "poll", mistaken)
    probe.until(stands(robot))
    with pytest.raises(ValueError, match="a mistake"):
        probe.timers[0](0)  # the run's own thread hears of it
    probe.timers.clear()


def test_two_programs_cannot_drive_one_base(robot, base, rig):
    robot = robot()
    base(robot)
    with pytest.raises(DriverError, match="in use by another program"):
        rig("opencr", port=robot.base_path)


def test_a_low_battery_stops_the_base(robot, base, rig):
    robot = robot()
    probe = base(robot)
    rig.drive(probe, 0.1)
    probe.until(moves(robot))
    robot.board.voltage = 10.9
    probe.until(lambda: "battery" in probe.last("state").reason)
    probe.until(stands(robot))
    robot.board.voltage = 12.0
    probe.fresh("battery", 2)
    assert robot.robot.speeds == (0.0, 0.0)


def test_wheels_that_do_not_turn_are_noticed(robot, base, rig):
    robot = robot()
    probe = base(robot)
    robot._loop.call(lambda: setattr(robot.board, "_motors", lambda: None))  # as if the motors were stuck
    rig.drive(probe, 0.1)
    probe.until(lambda: "do not turn" in probe.last("state").reason)
