"""Our CDR and that of Eclipse Cyclone DDS, which ROS 2 itself can run on, byte for byte."""

from dataclasses import dataclass

import numpy as np
import pytest

from knotwork.core.messages import Grid, Odometry, Scan, Transform, Twist
from knotwork.core.ros2 import messages as ros2

idl = pytest.importorskip("cyclonedds.idl", reason="needs the extra `test`")
types = pytest.importorskip("cyclonedds.idl.types")
Endianness = pytest.importorskip("cyclonedds.idl._support").Endianness

STAMP = 1_700_000_000_123_456_789
FRAMES = {"base": "base_link"}
f32, f64, i8, i32, u32 = types.float32, types.float64, types.int8, types.int32, types.uint32


# The types of common_interfaces (ROS 2 Jazzy), field by field.
@dataclass
class Time(idl.IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: i32
    nanosec: u32


@dataclass
class Header(idl.IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(idl.IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: f64
    y: f64
    z: f64


@dataclass
class Quaternion(idl.IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: f64
    y: f64
    z: f64
    w: f64


@dataclass
class Pose(idl.IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Vector3
    orientation: Quaternion


@dataclass
class PoseWithCovariance(idl.IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose
    covariance: types.array[f64, 36]


@dataclass
class TwistOf6(idl.IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(idl.IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: TwistOf6
    covariance: types.array[f64, 36]


@dataclass
class OdometryOf(idl.IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class LaserScan(idl.IdlStruct, typename="sensor_msgs::msg::dds_::LaserScan_"):
    header: Header
    angle_min: f32
    angle_max: f32
    angle_increment: f32
    time_increment: f32
    scan_time: f32
    range_min: f32
    range_max: f32
    ranges: types.sequence[f32]
    intensities: types.sequence[f32]


@dataclass
class MapMetaData(idl.IdlStruct, typename="nav_msgs::msg::dds_::MapMetaData_"):
    map_load_time: Time
    resolution: f32
    width: u32
    height: u32
    origin: Pose


@dataclass
class OccupancyGrid(idl.IdlStruct, typename="nav_msgs::msg::dds_::OccupancyGrid_"):
    header: Header
    info: MapMetaData
    data: types.sequence[i8]


@dataclass
class TransformStamped(idl.IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    translation: Vector3  # the members of geometry_msgs/Transform
    rotation: Quaternion


@dataclass
class TFMessage(idl.IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: types.sequence[TransformStamped]


def read(cls, made):
    """Return our bytes as Cyclone reads them; written by Cyclone they are the same bytes."""
    found = cls.deserialize(made[1])
    again = found.serialize(endianness=Endianness.Little, use_version_2=False)
    assert again[:2] == made[1][:2] == b"\0\1"  # little-endian CDR
    assert again[4:] == made[1][4:]
    return found


@pytest.mark.parametrize("frame", ["", "a", "laser", "base"])  # lengths that need every alignment
@pytest.mark.parametrize("n", [0, 1, 5])
def test_laser_scan(n, frame):
    ranges = np.linspace(0.5, 3.0, n, dtype=np.float32)
    ours = Scan(
        stamp=STAMP, scan_id=0, ranges=ranges, angle_min=-1.5, angle_increment=0.25, range_min=0.125, range_max=3.5,
        intensities=ranges[::-1].copy(), frame=frame,
    )  # fmt: skip
    theirs = read(LaserScan, ros2.encode(ours, FRAMES))
    assert theirs.header.frame_id == FRAMES.get(frame, frame)
    assert theirs.header.stamp.sec * 10**9 + theirs.header.stamp.nanosec == STAMP
    assert list(theirs.ranges) == ranges.tolist()
    assert list(theirs.intensities) == ranges[::-1].tolist()
    assert (theirs.angle_min, theirs.angle_increment, theirs.range_min, theirs.range_max) == (-1.5, 0.25, 0.125, 3.5)


def test_odometry_map_and_command():
    pose = np.array([1.0, -2.0, 0.5])
    odometry = read(OdometryOf, ros2.encode(Odometry(stamp=STAMP, pose=pose, twist=np.array([0.1, 0.0, -0.2])), FRAMES))
    assert (odometry.child_frame_id, odometry.pose.pose.position.x, odometry.pose.pose.position.y) == (
        "base_link",
        1,
        -2,
    )
    assert odometry.pose.pose.orientation.z == np.sin(0.25)
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.angular.z) == (0.1, -0.2)

    cells = np.array([[0, 100, -1], [50, 1, 99]], np.int8)
    grid = read(OccupancyGrid, ros2.encode(Grid(stamp=STAMP, cells=cells, resolution=0.25, origin=(-1, 2, 0)), FRAMES))
    assert (grid.info.width, grid.info.height, grid.info.resolution, grid.info.origin.position.x) == (3, 2, 0.25, -1)
    assert list(grid.data) == [0, 100, -1, 50, 1, 99]

    command = read(TwistOf6, ros2.encode(Twist(stamp=0, vx=0.2, vy=-0.1, wz=0.5), {}))
    assert (command.linear.x, command.linear.y, command.angular.z) == (0.2, -0.1, 0.5)

    tf = read(TFMessage, ros2.encode_tf(Transform(stamp=STAMP, parent="map", child="odom", pose=pose), FRAMES))
    (transform,) = tf.transforms
    assert (transform.header.frame_id, transform.child_frame_id, transform.translation.y) == ("map", "odom", -2)


@pytest.mark.parametrize("endianness", [Endianness.Little, Endianness.Big])
def test_what_cyclone_writes_is_read(endianness):
    header = Header(Time(STAMP // 10**9, STAMP % 10**9), "base_scan")
    scan = LaserScan(header, -1.0, 1.0, 0.5, 0.0, 0.1, 0.125, 3.5, [1.0, 2.0, 3.0], [])
    ours = ros2.decode_scan(scan.serialize(endianness=endianness, use_version_2=False), 4, (0.1, 0.0, 0.0))
    assert (ours.stamp, ours.frame, ours.ranges.tolist()) == (STAMP, "base_scan", [1.0, 2.0, 3.0])

    pose = PoseWithCovariance(Pose(Vector3(1.0, 2.0, 0.0), Quaternion(0.0, 0.0, np.sin(0.2), np.cos(0.2))), [0.0] * 36)
    twist = TwistOf6(Vector3(0.3, 0.0, 0.0), Vector3(0.0, 0.0, 0.4))
    odometry = OdometryOf(header, "base_link", pose, TwistWithCovariance(twist, [0.0] * 36))
    given = ros2.decode_odometry(odometry.serialize(endianness=endianness, use_version_2=False))
    assert given.stamp == STAMP
    assert given.pose == pytest.approx([1.0, 2.0, 0.4])
    assert given.twist == pytest.approx([0.3, 0.0, 0.4])

    command = ros2.decode_twist(twist.serialize(endianness=endianness, use_version_2=False), 7)
    assert (command.stamp, command.vx, command.wz) == (7, 0.3, 0.4)
