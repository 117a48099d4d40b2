"""Our CDR bytes read by `rosbags`, and those of `rosbags` read by us."""

import math
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knotwork.core.conformance.samples import core_types, sample
from knotwork.core.errors import InputError
from knotwork.core.messages import Grid, Odometry, Scan, Transform, Twist
from knotwork.core.ros2 import messages as ros2

typesys = pytest.importorskip("rosbags.typesys", reason="needs the extra `test`")
STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
T = STORE.types
FRAMES = {"base": "base_link"}
STAMP = 1_700_000_000_123_456_789


def read(made):
    name, data = made
    found = STORE.deserialize_cdr(data, name)
    assert bytes(STORE.serialize_cdr(found, name)) == data  # not a byte more or less
    return found


def yaw(q):
    assert q.x == q.y == 0
    return 2 * math.atan2(q.z, q.w)


def scan(n=5, intensities=None, frame="laser"):
    ranges = np.linspace(0.5, 3, n, dtype=np.float32)
    if n:
        ranges[0] = np.inf
    return Scan(
        stamp=STAMP, scan_id=3, ranges=ranges, angle_min=-1.5, angle_increment=0.25, range_min=0.125, range_max=3.5,
        mount=(-0.032, 0.0, 0.5), time_offset=-0.2, time_increment=0.0005, intensities=intensities, frame=frame,
    )  # fmt: skip


@pytest.mark.parametrize("n", [0, 1, 5])
@pytest.mark.parametrize("frame", ["", "a", "laser", "base"])  # lengths that need every alignment
def test_laser_scan(n, frame):
    ours = scan(n, np.arange(n, dtype=np.float32), frame)
    theirs = read(ros2.encode(ours, FRAMES))
    at = theirs.header.stamp.sec * 10**9 + theirs.header.stamp.nanosec
    assert at == STAMP - 200_000_000  # ROS stamps the first beam
    assert theirs.header.frame_id == FRAMES.get(frame, frame)
    assert np.array_equal(theirs.ranges, ours.ranges)
    assert np.array_equal(theirs.intensities, ours.intensities)
    assert (theirs.angle_min, theirs.angle_increment, theirs.range_max) == (-1.5, 0.25, 3.5)
    assert theirs.angle_max == -1.5 + max(n - 1, 0) * 0.25


@settings(max_examples=50, deadline=None)
@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-math.pi, math.pi))
def test_odometry(x, y, angle):
    ours = Odometry(stamp=STAMP, pose=np.array([x, y, angle]), twist=np.array([0.1, 0.0, -0.2]))
    theirs = read(ros2.encode(ours, FRAMES))
    assert (theirs.header.frame_id, theirs.child_frame_id) == ("odom", "base_link")
    position = theirs.pose.pose.position
    assert (position.x, position.y, position.z) == (x, y, 0)
    assert yaw(theirs.pose.pose.orientation) == pytest.approx(angle, abs=1e-9)
    assert (theirs.twist.twist.linear.x, theirs.twist.twist.angular.z) == (0.1, -0.2)
    back = ros2.decode_odometry(ros2.encode(ours, FRAMES)[1])
    assert back.stamp == STAMP
    assert back.pose == pytest.approx(ours.pose, abs=1e-9)
    assert back.twist.tolist() == ours.twist.tolist()


def test_map():
    cells = np.array([[0, 100, -1], [50, 1, 99]], np.int8)
    ours = Grid(stamp=STAMP, cells=cells, resolution=0.05, origin=(-1.0, 2.0, 0.5))
    theirs = read(ros2.encode(ours, FRAMES))
    assert (theirs.info.width, theirs.info.height) == (3, 2)
    assert theirs.info.resolution == np.float32(0.05)
    assert theirs.data.tolist() == [0, 100, -1, 50, 1, 99]  # row by row from the lowest y, as ROS wants
    assert (theirs.info.origin.position.x, theirs.info.origin.position.y) == (-1, 2)
    assert yaw(theirs.info.origin.orientation) == pytest.approx(0.5)
    assert theirs.header.frame_id == "map"


def test_command_both_ways():
    ours = Twist(stamp=0, vx=0.2, vy=-0.1, wz=0.5)
    name, data = ros2.encode(ours, {})
    theirs = read((name, data))
    assert (theirs.linear.x, theirs.linear.y, theirs.angular.z) == (0.2, -0.1, 0.5)
    back = ros2.decode_twist(data, 77)
    assert (back.stamp, back.vx, back.vy, back.wz) == (77, 0.2, -0.1, 0.5)


@pytest.mark.parametrize(
    ("message", "names"),
    [
        (Transform(stamp=STAMP, parent="map", child="odom", pose=np.array([1, 2, 0.3])), ("map", "odom")),
        (Odometry(stamp=STAMP, pose=np.array([1, 2, 0.3])), ("odom", "base_link")),
        (scan(), ("base_link", "laser")),
    ],
)
def test_tf(message, names):
    (theirs,) = read(ros2.encode_tf(message, FRAMES)).transforms
    assert (theirs.header.frame_id, theirs.child_frame_id) == names
    expected = message.mount if isinstance(message, Scan) else message.pose.tolist()
    assert (theirs.transform.translation.x, theirs.transform.translation.y) == (expected[0], expected[1])
    assert yaw(theirs.transform.rotation) == pytest.approx(expected[2])


def stamp():
    return T["builtin_interfaces/msg/Time"](sec=STAMP // 10**9, nanosec=STAMP % 10**9)


def their_scan(ranges, **more):
    values = {"angle_min": -1.0, "angle_max": 1.0, "angle_increment": 0.5, "time_increment": 0.0, "scan_time": 0.1}
    header = T["std_msgs/msg/Header"](stamp=stamp(), frame_id="base_scan")
    return T["sensor_msgs/msg/LaserScan"](
        header=header, range_min=0.1, range_max=3.5, ranges=np.array(ranges, np.float32),
        intensities=np.zeros(0, np.float32), **(values | more),
    )  # fmt: skip


@pytest.mark.parametrize("little", [True, False])
def test_their_scan(little):
    theirs = their_scan([1.0, np.inf, 0.0, 4.0, np.nan])
    data = bytes(STORE.serialize_cdr(theirs, ros2.SCAN, little_endian=little))
    ours = ros2.decode_scan(data, 9, (0.1, 0.0, 0.0))
    assert (ours.stamp, ours.scan_id, ours.frame, ours.mount) == (STAMP, 9, "base_scan", (0.1, 0.0, 0.0))
    assert np.array_equal(ours.ranges, np.array([1, np.inf, np.nan, np.inf, np.nan], np.float32), equal_nan=True)
    assert ours.angle_min == -1.0
    assert ours.intensities is None


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=200), st.integers(0, 60))
def test_damaged_messages_are_refused_or_read(junk, cut):
    whole = ros2.encode(scan(), FRAMES)[1]
    for data in (junk, b"\x00\x01\x00\x00" + junk, whole[:cut]):
        for take in (
            lambda d: ros2.decode_scan(d, 0, (0, 0, 0)),
            ros2.decode_odometry,
            lambda d: ros2.decode_twist(d, 0),
        ):
            with suppress(InputError):
                take(data)


def test_what_has_no_counterpart():
    rng = np.random.default_rng(0)
    for kind in core_types():
        made = ros2.encode(sample(kind, rng, 0, 0), FRAMES)
        assert (made is not None) == (kind in ("scan", "odometry", "grid", "twist"))
