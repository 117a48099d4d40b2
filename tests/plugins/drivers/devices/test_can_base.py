import math
import uuid
from pathlib import Path

import can
import pytest

from knotwork.core.clock import epoch
from knotwork.core.devices.errors import DeviceLost
from knotwork.core.emulator.agilex_base import AgilexBase, AgilexSettings
from knotwork.core.errors import DriverError
from knotwork.core.geometry import relative
from knotwork.core.messages import MotionControl
from knotwork.core.protocols import agilex
from knotwork.plugins.drivers.can_base import Config
from knotwork.plugins.drivers.can_base.bus import CanBus


@pytest.fixture
def robot(rig):
    channel = uuid.uuid4().hex
    return rig.enter(AgilexBase(AgilexSettings(interface="virtual", channel=channel, world="arena", noise=False)))


@pytest.fixture
def probe(rig, robot):
    return rig("can-base", interface="virtual", channel=robot._bus.channel_id)


def moves(robot):
    return lambda: min(map(abs, robot.robot.speeds)) > 0.05


def stands(robot):
    return lambda: robot.robot.speeds == (0.0, 0.0)


def test_odometry_is_the_true_motion(robot, probe, rig):
    probe.fresh("odometry")
    start = robot.pose()
    drive = rig.drive(probe, 0.4, 0.8)
    probe.until(lambda: math.hypot(*relative(start, robot.pose())[:2]) > 0.4)
    drive.__exit__()
    probe.until(stands(robot))
    odometry = probe.fresh("odometry", 5)
    error = relative(relative(start, robot.pose()), tuple(odometry.pose))
    assert math.hypot(*error[:2]) < 0.01  # the odometer counts millimetres
    assert abs(error[2]) < 0.02
    assert probe.last("battery").voltage == pytest.approx(25.6)


def test_who_takes_the_remote_control_has_the_base_until_it_is_rearmed(robot, probe, rig):
    rig.drive(probe, 0.3)
    probe.until(moves(robot))
    robot.remote = True
    probe.until(lambda: probe.last("state").state == "fault")
    assert "remote" in probe.last("state").reason
    probe.rearm()
    probe.until(lambda: any("cannot re-arm" in line for line in probe.lines))
    robot.remote = False
    probe.fresh("odometry", 20)
    assert robot.robot.speeds == (0.0, 0.0)
    probe.rearm()
    probe.until(moves(robot))


def test_the_emergency_button_is_seen(robot, probe, rig):
    rig.drive(probe, 0.3)
    probe.until(moves(robot))
    robot.emergency = True
    probe.until(lambda: "emergency stop button" in probe.last("state").reason)
    robot.emergency = False
    probe.fresh("odometry", 20)
    assert robot.robot.speeds == (0.0, 0.0)


def test_a_silent_base_is_waited_for(robot, probe, rig):
    rig.drive(probe, 0.3)
    probe.until(moves(robot))
    robot.silent = True
    probe.until(lambda: probe.counts.get("lost"))
    probe.until(stands(robot))  # by its own watchdog
    robot.silent = False
    probe.until(lambda: probe.counts.get("reconnects"))
    probe.until(lambda: any(o.discontinuity for o in probe.given["odometry"]))
    probe.fresh("odometry", 10)
    assert robot.robot.speeds == (0.0, 0.0)
    probe.rearm()
    probe.until(moves(robot))


def test_a_base_that_falls_into_standby_is_a_fault(robot, probe, rig):
    rig.drive(probe, 0.3)
    probe.until(moves(robot))
    probe.fresh("odometry", 20)  # the base has said that it listens
    robot._can_mode = False
    probe.until(lambda: probe.last("state").state == "fault")
    assert "standby" in probe.last("state").reason
    probe.rearm()
    probe.until(moves(robot))


def test_at_the_end_the_base_stands_in_standby(robot, probe, rig):
    rig.drive(probe, 0.3)
    probe.until(moves(robot))
    probe.driver.on_control(MotionControl(stamp=epoch(), action="stop"))
    probe.until(stands(robot))
    probe.__exit__()
    probe.until(lambda: not robot._can_mode)


def test_a_bus_without_a_base_says_so(rig):
    with pytest.raises(DriverError, match="no AgileX base"):
        rig("can-base", interface="virtual", channel=uuid.uuid4().hex)


def test_the_kernels_own_bus_is_opened_by_its_name_and_nothing_else(monkeypatch):
    """Bit rate and the rest are set with `ip link`; python-can would refuse or ignore them."""
    asked = {}

    class Bus:
        def __init__(self, **options):
            asked.update(options)

        def fileno(self):
            return 7

    monkeypatch.setattr(can, "Bus", Bus)
    bus = CanBus(Config(channel="can1", bitrate=250_000))
    assert asked == {"interface": "socketcan", "channel": "can1"}
    assert bus._descriptor == 7


def test_an_interface_that_python_can_does_not_know_is_said(rig):
    with pytest.raises(DriverError, match="cannot open the CAN bus") as error:
        rig("can-base", interface="pigeon", channel="x")
    assert "ip link" not in error.value.hint


def test_what_is_not_of_the_base_is_left_out_and_trouble_on_the_bus_counted():
    channel = uuid.uuid4().hex
    bus = CanBus(Config(interface="virtual", channel=channel))
    with can.Bus(interface="virtual", channel=channel) as other:
        identifier, data = agilex.encode("SystemState", battery=25.0, mode=1)
        other.send(can.Message(is_error_frame=True, data=b"\0" * 8))
        other.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=True))
        other.send(can.Message(arbitration_id=identifier, is_remote_frame=True, is_extended_id=False))
        other.send(can.Message(arbitration_id=0x7FF, data=b"?", is_extended_id=False))
        other.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        frames = [bus.frame() for _ in range(6)]
    assert [arrived for arrived, _ in frames] == [True] * 5 + [False]
    assert [frame.name for _, frame in frames if frame is not None] == ["SystemState"]
    assert bus.error_frames == 1
    bus.close()
    with pytest.raises(DeviceLost):
        bus.send("MotionCommand", linear=0.1)
    with pytest.raises(DeviceLost):
        bus.frame()


@pytest.mark.skipif(Path("/sys/class/net/can77").exists(), reason="there is a can77")
def test_a_can_interface_that_is_not_there_is_said_with_its_cure(rig):
    with pytest.raises(DriverError, match="cannot open the CAN bus") as error:
        rig("can-base", channel="can77")
    assert "ip link set can77 up" in error.value.hint


@pytest.mark.skipif(not Path("/sys/class/net/vcan0").exists(), reason="ip link add dev vcan0 type vcan; set it up")
def test_the_base_drives_on_a_virtual_bus_of_the_kernel(rig):
    robot = rig.enter(AgilexBase(AgilexSettings(interface="socketcan", channel="vcan0", world="arena", noise=False)))
    probe = rig("can-base", channel="vcan0")
    rig.drive(probe, 0.3)
    probe.until(moves(robot))
    assert probe.driver.statistics()["rejected_frames"] == 0
