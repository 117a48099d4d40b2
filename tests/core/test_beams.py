import numpy as np
import pytest

from knotwork.core.beams import beams_of
from knotwork.core.messages import Scan

DEGREE = np.pi / 180


def square_room(pose, half=2.0, beams=360, sweep=0.0, twist=(0.0, 0.0, 0.0)):
    """A scan of the square |x|, |y| <= half from `pose`, in closed form; each beam from its own pose."""
    angles = np.arange(beams) * 2 * np.pi / beams
    times = np.arange(beams) * sweep / beams
    vx, _, w = twist
    yaw = pose[2] + w * times
    if w:
        x = pose[0] + vx / w * (np.sin(yaw) - np.sin(pose[2]))
        y = pose[1] - vx / w * (np.cos(yaw) - np.cos(pose[2]))
    else:
        x, y = pose[0] + vx * times * np.cos(pose[2]), pose[1] + vx * times * np.sin(pose[2])
    c, s = np.cos(angles + yaw), np.sin(angles + yaw)
    with np.errstate(divide="ignore"):
        to_x = np.where(c > 0, (half - x) / c, (-half - x) / c)
        to_y = np.where(s > 0, (half - y) / s, (-half - y) / s)
    return Scan(
        stamp=0,
        scan_id=0,
        ranges=np.minimum(to_x, to_y).astype(np.float32),
        angle_min=0.0,
        angle_increment=2 * np.pi / beams,
        range_min=0.05,
        range_max=10.0,
        time_increment=sweep / beams,
    )


def test_deskewed_points_lie_on_the_walls_and_skewed_ones_do_not():
    twist = np.array([0.3, 0.0, 0.8])
    scan = square_room((0.2, -0.1, 0.4), sweep=0.2, twist=twist)
    pose = np.array([0.2, -0.1, 0.4])
    c, s = np.cos(pose[2]), np.sin(pose[2])

    def off_the_wall(points):
        x = pose[0] + c * points[:, 0] - s * points[:, 1]
        y = pose[1] + s * points[:, 0] + c * points[:, 1]
        return np.abs(np.maximum(np.abs(x), np.abs(y)) - 2.0).max()

    assert off_the_wall(beams_of(scan, 0.0, 20.0, twist).points) < 1e-6
    assert off_the_wall(beams_of(scan, 0.0, 20.0).points) > 0.05


def test_normals_are_those_of_the_walls_except_at_the_corners():
    points = beams_of(square_room((0.0, 0.0, 0.0)), 0.0, 20.0).points
    known = np.hypot(points[:, 2], points[:, 3]) > 0.5
    assert known.mean() > 0.85
    # the wall x = 2 has the normal (+-1, 0), the wall y = 2 the normal (0, +-1)
    on_x = np.abs(np.abs(points[:, 0]) - 2.0) < 1e-5
    inner = known & (np.minimum(np.abs(points[:, 0]), np.abs(points[:, 1])) < 1.8)
    assert np.abs(points[inner & on_x, 2]) == pytest.approx(1.0, abs=1e-6)
    assert np.abs(points[inner & ~on_x, 3]) == pytest.approx(1.0, abs=1e-6)


def test_beams_without_return_and_invalid_ones():
    scan = square_room((0.0, 0.0, 0.0), beams=8)
    ranges = scan.ranges.copy()
    ranges[:4] = [np.nan, np.inf, 0.01, 9.9]
    marked = Scan(
        stamp=0, scan_id=0, ranges=ranges, angle_min=0.0, angle_increment=45 * DEGREE, range_min=0.05, range_max=10.0
    )
    beams = beams_of(marked, 0.05, 5.0)
    assert len(beams.points) == 4  # NaN and too near say nothing; inf and beyond range_max are no return
    assert sorted(beams.rays[:, 5].tolist()) == [0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    assert beams.rays[beams.rays[:, 5] == 0.0, 4].tolist() == [5.0, 5.0]
