"""A robot at a wrong place that looks half alike: lost, not localised with good quality."""

import math

import numpy as np
import pytest

from knotwork.core.conformance import RecordingContext
from knotwork.core.contracts import PriorEstimate
from knotwork.core.messages import Scan
from knotwork.plugins.localizers.gauss_newton import MANIFEST as LOCALIZER
from knotwork.plugins.localizers.gauss_newton.descent import discover
from knotwork.plugins.localizers.gauss_newton.localizer import GaussNewton
from knotwork.plugins.localizers.gauss_newton.starts import around
from knotwork.plugins.maps.spline_curve import MANIFEST
from knotwork.plugins.maps.spline_curve.barred import barred
from knotwork.plugins.maps.spline_curve.kernels import discount
from knotwork.plugins.maps.spline_curve.lines import line_normals
from knotwork.plugins.maps.spline_curve.map import SplineCurve

BEAMS = 180
HALL = [  # walls: corridor y in [-1, 1], closed at x = -3 and 12, a niche at x = 8 to 9
    (-3, 1, 12, 1), (12, 1, 12, -1), (12, -1, 9, -1), (9, -1, 9, -1.6), (9, -1.6, 8, -1.6), (8, -1.6, 8, -1),
    (8, -1, -3, -1), (-3, -1, -3, 1),
]  # fmt: skip
OFFICE = [  # the same left wall, but on the right a room in the place of the wall
    (-3, 1, 12, 1), (12, 1, 12, -5), (12, -5, -3, -5), (-3, -5, -3, 1),
]  # fmt: skip


def ranges(walls, pose, rng):
    """Exact distances to the nearest wall, with 1 cm of noise."""
    angles = pose[2] + np.linspace(-math.pi / 2, math.pi / 2, BEAMS, endpoint=False)
    ux, uy = np.cos(angles), np.sin(angles)
    out = np.full(BEAMS, 50.0)
    for ax, ay, bx, by in walls:
        ex, ey = bx - ax, by - ay
        cross = ux * ey - uy * ex
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((ax - pose[0]) * ey - (ay - pose[1]) * ex) / cross
            s = ((ax - pose[0]) * uy - (ay - pose[1]) * ux) / cross
        out = np.where((s >= 0) & (s <= 1) & (t > 0), np.minimum(out, t), out)
    return out + 0.01 * rng.standard_normal(BEAMS)


def scan(walls, pose, rng, number, farthest=30.0):
    return message(ranges(walls, pose, rng), number, farthest)


def message(distances, number, farthest=30.0):
    return Scan(
        stamp=number * 200_000_000, scan_id=number, ranges=distances.astype(np.float32),
        angle_min=-math.pi / 2, angle_increment=math.pi / BEAMS, range_min=0.05, range_max=farthest,
    ).sealed(number * 200_000_000, number)  # fmt: skip


class At:
    """A prior that believes in one pose, as odometry does over the centimetres between two scans."""

    def __init__(self):
        self.pose = np.zeros(3)

    def prior(self, time):
        del time
        return PriorEstimate(self.pose, np.diag([0.02, 0.02, 0.01]) ** 2, np.zeros(3))


@pytest.fixture
def hall(tmp_path):
    """The hall, mapped there and back from exact poses, and a localiser with the pose it is given as prior."""
    chart = SplineCurve(RecordingContext(MANIFEST, {}, out=tmp_path))
    rng = np.random.default_rng(0)
    way = [(x, 0.0, 0.0) for x in np.arange(-2.0, 10.0, 0.2)] + [(x, 0.0, math.pi) for x in np.arange(10.0, -2.0, -0.2)]
    for number, pose in enumerate(way):
        chart.update(scan(HALL, pose, rng, number), np.array(pose))
    prior = At()
    context = RecordingContext(LOCALIZER, {}, out=tmp_path, uses={"map": chart, "prior": prior})
    return chart, GaussNewton(context), context, prior


def drive(hall, walls, place):
    """Ten scans from `place` in `walls`, believed to be at the same place of the hall: the published poses."""
    _, localizer, context, prior = hall
    rng = np.random.default_rng(1)
    for number in range(10):
        pose = np.array([place[0] + 0.05 * number, place[1], place[2]])
        prior.pose = pose
        localizer.on_scan(scan(walls, pose, rng, 1000 + number))
    localizer.finish()
    return context.messages("pose")


# 0.53 to 0.59 of what is seen there looks alike; from 0.6 on, the localiser's `doubt`, a place is believed.
@pytest.mark.parametrize("place", [(1.0, 0.0, 0.0), (3.0, -0.3, 0.0), (7.0, -0.5, math.pi)])
def test_where_half_of_what_is_seen_lies_behind_walls_of_the_map_the_robot_is_lost(hall, place):
    poses = drive(hall, OFFICE, place)
    assert all(pose.quality < 0.6 for pose in poses)
    assert poses[-1].lost
    assert not any(pose.lost for pose in poses[:3])  # doubtful first


@pytest.mark.parametrize("place", [(1.0, 0.0, 0.0), (3.0, -0.3, 0.0), (6.0, -0.5, math.pi)])
def test_at_the_place_itself_it_is_not(hall, place):
    poses = drive(hall, HALL, place)
    assert all(pose.quality > 0.9 and not pose.lost for pose in poses)


def test_along_bare_walls_a_scan_neither_knows_nor_pulls_whatever_its_heading(hall):
    """The truth is 0: two parallel walls say nothing of the place along them.

    A heading that is off by t turns the beams' normals by t and moves their ends by t times the way to them:
    if the two are multiplied, t squared pulls along the walls, always the same way.
    """
    chart, *_ = hall
    bare = [(-40, 1, 50, 1), (-40, -1, 50, -1)]
    rng = np.random.default_rng(2)
    odometry = 0.02  # m: what a scan is weighed against
    for x in (2.0, 3.0, 4.0):
        for sideways, turn in ((0.0, 0.0), (0.01, 0.005), (-0.01, -0.005), (0.0, 0.03)):
            pose = np.array([x, sideways, turn])
            alignment = chart.alignment(scan(bare, (x, 0.0, 0.0), rng, 0, farthest=3.0), pose)
            for level in range(alignment.levels):
                equations = alignment.normal_equations(pose, level)
                assert equations.H[0, 0] < 0.01 / odometry**2
                assert abs(equations.g[0]) * odometry**2 < 0.2 * odometry
                assert equations.H[1, 1] > 30.0 / odometry**2  # across them it knows all


def test_what_one_scan_has_seen_says_less_of_the_pose_than_a_proven_wall(hall):
    chart, *_ = hall
    pose = np.array([2.0, 0.0, 0.0])
    view = scan(HALL, pose, np.random.default_rng(5), 0)
    proven = chart.alignment(view, pose).normal_equations(pose, 1)
    for level in range(3):
        chart.stores[level].weight[:] = 5  # units of one scan
    fresh = chart.alignment(view, pose).normal_equations(pose, 1)
    assert fresh.H[1, 1] / proven.H[1, 1] == pytest.approx(1.0 / (1.0 + 1.5**2), rel=0.05)
    assert fresh.cost > proven.cost  # a beam on it is not yet as good as explained
    assert fresh.n_used == proven.n_used


def test_behind_a_wall_nothing_is_drawn_until_it_is_forgotten(hall):
    chart, *_ = hall
    rng = np.random.default_rng(7)
    behind = np.array([[x, -5.0] for x in np.arange(0.0, 6.0, 0.5)])
    pose = np.array([3.0, 0.0, -0.5])
    chart.update(scan(OFFICE, pose, rng, 0), pose)
    assert np.isinf(chart.nearest(behind, reach=0.5).distance).all()
    for number in range(80):
        chart.update(scan(OFFICE, pose, rng, 1 + number), pose)
    assert np.isfinite(chart.nearest(behind, reach=0.5).distance).sum() > 3


def test_along_a_corridor_no_place_convinces(hall):
    chart, localizer, *_ = hall
    rng = np.random.default_rng(8)
    starts = around(np.array([3.0, 0.0, 0.0]), 4.0, math.pi, 2000)
    between = scan(HALL, (3.5, 0.0, 0.0), rng, 0, farthest=3.0)  # two bare walls
    niche = scan(HALL, (7.0, 0.2, -0.6), rng, 1)
    assert not discover(chart, between, starts, None, localizer._settings).convinces(0.75)
    found = discover(chart, niche, around(np.array([6.0, 0.0, 0.0]), 4.0, math.pi, 4000), None, localizer._settings)
    assert found.best.pose == pytest.approx([7.0, 0.2, -0.6], abs=0.05)
    assert found.convinces(0.75)


def test_a_robot_that_somebody_stands_around_is_found_where_odometry_says(hall):
    """Lost among people; then the map explains 0.65 to 0.75 of the beams: too few for any other place."""
    _, localizer, context, prior = hall
    rng = np.random.default_rng(9)
    for number in range(20):
        pose = np.array([6.0 + 0.02 * number, 0.1, 0.0])
        prior.pose = pose
        distances = ranges(HALL, pose, rng)
        hidden = slice(0, 110 if number < 10 else 55)
        distances[hidden] = np.minimum(distances[hidden], 0.5 + 0.01 * rng.standard_normal(BEAMS)[hidden])
        localizer.on_scan(message(distances, number))
    localizer.finish()
    poses = context.messages("pose")
    assert poses[9].lost
    assert all(0.6 <= pose.quality < 0.75 for pose in poses[10:12])
    assert not any(pose.lost for pose in poses[12:])
    assert poses[-1].pose == pytest.approx(prior.pose, abs=0.03)


def test_a_beam_is_barred_by_a_wall_that_several_scans_have_seen(hall):
    chart, *_ = hall
    store, pose, origin = chart.stores[1], np.array([2.0, 0.0, 0.3]), np.zeros(2)
    bearing = np.linspace(-math.pi / 2, math.pi / 2, 40)
    true = ranges(HALL, pose, np.random.default_rng(3))
    exact = np.interp(bearing, np.linspace(-math.pi / 2, math.pi / 2, BEAMS, endpoint=False), true)
    ends = exact[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    steep = np.abs(np.sin(bearing + pose[2])) > 0.5  # the walls beside; the flat ones do not count
    assert not barred(store, ends, origin, pose, 0.3).any()
    assert not barred(store, 0.5 * ends, origin, pose, 0.3).any()
    assert barred(store, ends + 0.5 * ends / exact[:, None], origin, pose, 0.3)[steep].all()
    store.weight[:] = 5  # seen by one scan only
    assert not barred(store, 3.0 * ends, origin, pose, 0.3).any()


def test_the_normal_of_a_dense_wall_is_that_of_the_whole_stretch():
    rng = np.random.default_rng(4)
    x = np.arange(0.0, 3.0, 0.01)
    wall = np.column_stack([x, 0.5 + 0.01 * rng.standard_normal(len(x)), np.zeros((len(x), 2))])
    corner = np.column_stack([np.full(100, 3.0), 0.5 + 0.02 * np.arange(1, 101), np.zeros((100, 2))])
    points = line_normals(np.concatenate([wall, corner]))
    assert points[:, :2] == pytest.approx(np.concatenate([wall, corner])[:, :2])
    tilt = points[: len(x) - 20, 2] / points[: len(x) - 20, 3]
    assert np.abs(tilt).max() < 0.02  # the noise of eight neighbours: 0.05 RMS
    assert np.abs(points[len(x) + 20 :, 3]).max() < 0.02
    apart = points[len(x) - 3 : len(x) + 3, 2:]
    assert np.abs(apart[:, 0] * apart[:, 1]).max() < 0.1  # of one wall or the other, or none


def test_discount_keeps_what_is_known_both_ways_and_takes_what_is_noise_of_the_walls_direction():
    turn = np.array([[math.cos(0.7), -math.sin(0.7), 0.0], [math.sin(0.7), math.cos(0.7), 0.0], [0.0, 0.0, 1.0]])
    for along, kept in ((1e5, 0.984), (160.0, 0.5), (1.6, 0.0099)):
        H = turn @ np.diag([along, 1e5, 4e4]) @ turn.T
        out = np.vstack([H, turn @ np.array([2.0, 3.0, 4.0])])
        discount(out, 0.04**2)
        inner = turn.T @ out[:3] @ turn
        assert inner[0, 0] == pytest.approx(kept * along, rel=0.01) or along == 1e5
        assert inner[1, 1] == pytest.approx(1e5, rel=0.02)
        assert inner[2, 2] == pytest.approx(4e4)
        assert out[:3] == pytest.approx(out[:3].T)
        assert np.linalg.eigvalsh(out[:3]).min() >= 0.0
        assert abs((turn.T @ out[3])[0]) <= 2.0 * math.sqrt(kept) * 1.01
