"""What the emulated lidars say, decoded, against the geometry of a room in closed form."""

import numpy as np
import pytest
from electronics_bench import BODY, FakeLine

from knotwork.core.emulator.lidars import Lds01, Lds02, Lds03, Lidar
from knotwork.core.emulator.robot import Robot
from knotwork.core.protocols import lds01, lds02, lds03
from knotwork.core.world.parameters import LidarParameters
from knotwork.core.world.scene import World, box

MOUNT = (-0.032, 0.0, 0.0)
WALLS = (-1.0, -0.8, 1.6, 1.2)  # x1, y1, x2, y2


def make(kind: type[Lidar], start: tuple[float, float, float], reach: float) -> tuple[Lidar, Robot]:
    world = World("room", box(*WALLS), start=start)
    robot = Robot(world, BODY, None, 0, 10**18)
    parameters = LidarParameters(mount=MOUNT, range_max=reach).exact()
    return kind(FakeLine(), robot, parameters, 0), robot


def live(lidar: Lidar, robot: Robot, seconds: float) -> bytes:
    end = robot.time + round(seconds * 1e9)
    while robot.time < end:
        due = lidar.next_due()
        assert due is not None
        robot.advance(min(due, end))
        lidar.run(robot.time)
    return lidar.line.wire


def to_wall(x: float, y: float, heading: np.ndarray) -> np.ndarray:
    """Distance from inside the room to its walls along directions."""
    c, s = np.cos(heading), np.sin(heading)
    with np.errstate(divide="ignore"):
        along_x = np.maximum((WALLS[2] - x) / c, (WALLS[0] - x) / c)
        along_y = np.maximum((WALLS[3] - y) / s, (WALLS[1] - y) / s)
    return np.minimum(along_x, along_y)


def sensor(pose: tuple[float, float, float]) -> tuple[float, float, float]:
    return pose[0] + np.cos(pose[2]) * MOUNT[0], pose[1] + np.sin(pose[2]) * MOUNT[0], pose[2]


@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (0.3, -0.2, 2.0)])
def test_lds01_standing(start: tuple[float, float, float]) -> None:
    lidar, robot = make(Lds01, start, 3.5)
    packets = lds01.Parser().feed(live(lidar, robot, 1.02))
    assert 295 <= len(packets) <= 306
    turns = lds01.Revolutions()
    (turn, *_) = [t for p in packets for t in turns.add(p, 0)]
    x, y, yaw = sensor(start)
    # The official driver puts the raw clockwise sample n at 359 - n degrees.
    truth = to_wall(x, y, yaw + np.radians(359.0 - np.arange(360)))
    np.testing.assert_allclose(turn.distances * 1e-3, truth, atol=0.0006)
    assert turn.rpm == pytest.approx(300.0, rel=0.004)


def test_lds01_turning_measures_each_reading_at_its_own_instant() -> None:
    lidar, robot = make(Lds01, (0.0, 0.0, 0.0), 3.5)
    robot.drive(-0.08, 0.08)  # 1 rad/s
    live(lidar, robot, 0.6)
    lidar.line.wire = b""
    begin, yaw, sector = lidar._time, robot.motion.pose(lidar._time)[2], lidar._sector
    packets = lds01.Parser().feed(live(lidar, robot, 0.1))
    n = np.arange(6 * len(packets))
    times = n / 360 / 5.0
    raw = (6 * sector + n) % 360
    heading = yaw + times + np.radians(359.0 - raw)
    x, y = MOUNT[0] * np.cos(yaw + times), MOUNT[0] * np.sin(yaw + times)
    measured = np.array([d for p in packets for d in p.distances]) * 1e-3
    assert begin > 10**18
    np.testing.assert_allclose(measured, to_wall(x, y, heading), atol=0.004)  # the motor's speed wobbles by 0.3 %


def test_lds01_out_of_range_and_commands() -> None:
    lidar, robot = make(Lds01, (0.0, 0.0, 0.0), 1.0)
    packets = lds01.Parser().feed(live(lidar, robot, 0.5))
    distances = np.array([d for p in packets for d in p.distances])
    assert (distances == 0).any()
    assert distances.max() <= 1000
    assert all(i == 0 for p in packets for d, i in zip(p.distances, p.intensities, strict=True) if d == 0)
    lidar.receive(b"xe", robot.time)
    assert lidar.next_due() is None
    lidar.receive(b"b", robot.time)
    due = lidar.next_due()
    assert due is not None
    assert due - robot.time > 2_000_000_000  # it spins up


@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (0.3, -0.2, 2.0)])
def test_lds02_points_lie_on_the_walls_after_correction(start: tuple[float, float, float]) -> None:
    """The emulator starts its rays beside the axis; the codec's correction was published by the maker."""
    lidar, robot = make(Lds02, start, 8.0)
    packets = lds02.Parser().feed(live(lidar, robot, 0.6))
    assert len(packets) == pytest.approx(0.6 * 2300 / 12, abs=2)
    turns = lds02.Revolutions()
    over = [t for k, p in enumerate(packets) for t in turns.add(p, k * 5_217_391)]
    turn = over[1]
    assert turn.missing == 0
    angles, ranges = lds02.corrected(turn.angles, turn.distances)
    x, y, yaw = sensor(start)
    px, py = x + ranges * np.cos(yaw + angles), y + ranges * np.sin(yaw + angles)
    off = np.min(np.abs([px - WALLS[0], px - WALLS[2], py - WALLS[1], py - WALLS[3]]), axis=0)
    assert off.max() < 0.0015
    beams, _ = lds02.binned(angles, ranges, turn.confidences, 360)
    truth = to_wall(x, y, yaw + np.radians(np.arange(360)))
    good = np.isfinite(beams)
    assert good.sum() > 340
    assert np.median(np.abs(beams - truth)[good]) < 0.01


def test_lds03_waits_for_its_command_and_measures_clockwise() -> None:
    lidar, robot = make(Lds03, (0.3, -0.2, 2.0), 12.0)
    assert lidar.next_due() is None
    lidar.spin_up = 0.1
    for byte in lds03.START:  # in any chunks
        lidar.receive(bytes((byte,)), robot.time)
    packets = lds03.Parser().feed(live(lidar, robot, 0.35))
    turns = lds03.Revolutions()
    (turn, *_) = [t for p in packets for t in turns.add(p, 0)]
    x, y, yaw = sensor((0.3, -0.2, 2.0))
    assert len(turn.angles) == 400
    np.testing.assert_allclose(turn.distances * 1e-3, to_wall(x, y, yaw - turn.angles), atol=0.003)
    lidar.receive(lds03.STOP, robot.time)
    assert lidar.next_due() is None
