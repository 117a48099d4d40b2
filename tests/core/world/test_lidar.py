"""The swept lidar: timing in closed form, noise by its statistics."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats

from knotwork.core.world.lidar import SimulatedLidar
from knotwork.core.world.motion import Leg, Motion
from knotwork.core.world.parameters import LidarParameters
from knotwork.core.world.raycast import RayCaster
from knotwork.core.world.scene import World, box

EXACT = LidarParameters().exact()
ROOM = RayCaster(World("room", box(-1.6, -1.6, 1.6, 1.6)))


def turning(v, w, pose=(0.2, -0.1, 0.3), seconds=0.2):
    motion = Motion()
    motion.append(Leg(0, round(seconds * 1e9), pose, v, w))
    return motion


def true_pose(pose, v, w, t):
    x, y, yaw = pose
    if w == 0.0:
        return x + v * t * np.cos(yaw), y + v * t * np.sin(yaw), yaw + 0 * t
    radius = v / w
    return (
        x + radius * (np.sin(yaw + w * t) - np.sin(yaw)),
        y - radius * (np.cos(yaw + w * t) - np.cos(yaw)),
        yaw + w * t,
    )


def points(scan, pose, v, w, times):
    """World points of a scan whose beams were measured at `times`, by the closed form of the motion."""
    x, y, yaw = true_pose(pose, v, w, times)
    mx, my, myaw = scan.mount
    beam = yaw + myaw + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    px = x + np.cos(yaw) * mx - np.sin(yaw) * my + scan.ranges * np.cos(beam)
    py = y + np.sin(yaw) * mx + np.cos(yaw) * my + scan.ranges * np.sin(beam)
    return px, py


def off_the_walls(px, py):
    return np.abs(np.maximum(np.abs(px), np.abs(py)) - 1.6).max()


@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize(("v", "w"), [(0.0, 2.5), (0.2, -1.5), (0.2, 0.0)])
def test_each_beam_is_cast_from_the_pose_of_its_instant(v, w, clockwise):
    pose = (0.2, -0.1, 0.3)
    sensor = EXACT.model_copy(update={"clockwise": clockwise})
    scan = SimulatedLidar(sensor, ROOM, 0).scan(turning(v, w), 0, 7)
    times = scan.time_offset + scan.time_increment * np.arange(360)
    assert off_the_walls(*points(scan, pose, v, w, times)) < 1e-6
    # The other sense of rotation, or no de-skewing at all, would show.
    assert off_the_walls(*points(scan, pose, v, w, times[::-1])) > 0.01
    assert off_the_walls(*points(scan, pose, v, w, 0 * times)) > 0.01


def test_the_lds_01_turns_clockwise():
    scan = SimulatedLidar(EXACT, ROOM, 0).scan(turning(0.0, 0.0), 0, 0)
    assert scan.stamp == 0
    assert scan.time_increment == pytest.approx(-0.2 / 360)
    assert scan.time_offset == pytest.approx(359 * 0.2 / 360)
    assert scan.time_offset + 359 * scan.time_increment == pytest.approx(0.0, abs=1e-15)  # the first measured
    assert (scan.angle_min, scan.angle_increment) == (0.0, 2 * np.pi / 360)
    assert scan.ranges.dtype == np.float32


def test_all_beams_at_once():
    sensor = EXACT.model_copy(update={"sweep": 0.0})
    scan = SimulatedLidar(sensor, ROOM, 0).scan(turning(0.2, 2.0), 0, 0)
    assert (scan.time_offset, scan.time_increment) == (0.0, 0.0)
    assert off_the_walls(*points(scan, (0.2, -0.1, 0.3), 0.2, 2.0, np.zeros(360))) < 1e-6


def test_a_sick_like_sensor():
    sensor = LidarParameters(
        beams=181, fov=np.pi, angle_min=-np.pi / 2, rate=10, sweep=0.0, clockwise=False, range_min=0.0,
        range_max=40.0, mount=(0.1, 0.0, 0.0), precision=(0.0, 0.0), accuracy=0.0,
    )  # fmt: skip
    assert sensor.angle_increment == pytest.approx(np.deg2rad(1.0))
    hall = RayCaster(World("hall", box(-50, -3, 50, 3)))
    scan = SimulatedLidar(sensor, hall, 0).scan(turning(0, 0, (0.0, 0.0, 0.0)), 0, 0)
    assert scan.ranges[0] == pytest.approx(3.0)
    assert scan.ranges[90] == np.inf  # 49.9 m
    assert scan.ranges[60] == pytest.approx(3.0 / np.sin(np.deg2rad(30)))


@pytest.mark.parametrize("distance", [0.5, 2.0, 3.2])
def test_white_noise_is_that_of_3_16(distance):
    wall = RayCaster(World("wall", np.array([[distance, -50.0, distance, 50.0]])))
    sensor = LidarParameters(accuracy=0.0, range_max=10.0)
    n = 20_000
    got = SimulatedLidar(sensor, wall, 3).measure(np.tile((0.032, 0.0, 0.0), (n, 1)), np.zeros(n))
    sigma = 0.0026 * distance + 0.00253
    assert abs(got.mean() - distance) < 4 * sigma / np.sqrt(n)
    low, high = stats.chi2.ppf((5e-5, 1 - 5e-5), n)
    assert low < np.sum((got - distance) ** 2) / sigma**2 < high
    assert stats.kstest((got - distance) / sigma, "norm").pvalue > 1e-4


def test_range_bias_is_one_factor_a_run_with_sigma_3_15():
    wall = RayCaster(World("wall", np.array([[2.0, -50.0, 2.0, 50.0]])))
    sensor = LidarParameters(precision=(0.0, 0.0))
    factors = []
    for seed in range(400):
        lidar = SimulatedLidar(sensor, wall, seed)
        got = lidar.measure(np.tile((0.032, 0.0, 0.0), (2, 1)), np.array([0.0, 0.5]))
        assert got[1] * np.cos(0.5) == pytest.approx(got[0])
        assert got[0] == pytest.approx(2.0 * lidar.scale)
        factors.append(got[0] / 2.0)
    low, high = stats.chi2.ppf((5e-5, 1 - 5e-5), 400)
    assert low < np.sum((np.array(factors) - 1) ** 2) / 0.05**2 < high
    assert SimulatedLidar(EXACT, wall, 3).scale == 1.0


def test_out_of_range():
    """Too far is no return, too near is invalid: the beam says nothing of what lies behind."""
    walls = RayCaster(World("walls", np.array([[0.1, -0.01, 0.1, 0.01], [-3.6, -1.0, -3.6, 1.0]])))
    lidar = SimulatedLidar(EXACT, walls, 0)
    got = lidar.measure(np.tile((0.032, 0.0, 0.0), (3, 1)), np.array([0.0, np.pi, np.pi / 2]))
    assert np.isnan(got[0])
    assert got[1] == np.inf
    assert got[2] == np.inf
    noisy = SimulatedLidar(LidarParameters(accuracy=0.0), walls, 0)
    ranges = noisy.measure(np.tile((-0.132, 0.0, np.pi), (4000, 1)), np.zeros(4000))  # 3.5 m from the wall
    assert 0.4 < np.isinf(ranges).mean() < 0.6
    assert ranges[np.isfinite(ranges)].max() <= 3.5


def test_same_seed_same_scan():
    def ranges(seed):
        return SimulatedLidar(LidarParameters(), ROOM, seed).scan(turning(0.1, 0.2), 0, 0).ranges

    assert np.array_equal(ranges(1), ranges(1))
    assert not np.array_equal(ranges(1), ranges(2))


@pytest.mark.parametrize(
    "bad",
    [
        {"fov": 7.0},
        {"range_min": 4.0},
        {"sweep": 0.3},
        {"precision": (-0.1, 0.0)},
        {"beams": 0},
        {"accuracy": 0.7},
    ],
)
def test_parameters_that_make_no_sense(bad):
    with pytest.raises(ValidationError):
        LidarParameters(**bad)
