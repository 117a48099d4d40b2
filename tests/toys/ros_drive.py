"""Recordings as other people's tools write them."""

import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from knotwork.core.conformance.context import RecordingContext
from knotwork.core.registry import Registry, load_object

SECOND = 10**9
START = 1_700_000_000 * SECOND
MOUNT = (-0.03, 0.02, 0.5)  # of the lidar on the footprint
RANGES = np.array([1.0, 2.0, np.inf, 0.01, np.nan, 5.0], np.float32)  # range_min 0.1, range_max 4


def played(out: Path, plugin: str, path: Path, **config):
    """Play a recording with a driver; returns its messages by port and its context."""
    manifest = Registry(third_parties=False).find(plugin)
    context = RecordingContext(manifest, {"path": str(path), **config}, out=out)
    driver = load_object(manifest.impl, plugin)(context)
    driver.open()
    given: dict[str, list] = {port: [] for port in context.manifest.outputs}
    context.order = []
    for item in driver.events():
        if not isinstance(item, int):
            port, message = item
            declared = context.manifest.outputs[port]
            assert (message.type_name, getattr(message, "role", "")) == (declared.message, declared.role)
            given[port].append(message)
            context.order.append((port, message))
    driver.close()
    return given, context


class Ros:
    """Messages of one ROS generation, made by `rosbags`."""

    def __init__(self, store: Stores) -> None:
        self.store = get_typestore(store)
        self.ros1 = store == Stores.ROS1_NOETIC
        if self.ros1:
            self.store.register(
                get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
            )
        self.types = self.store.types

    def make(self, name, **fields):
        return self.types[name](**fields)

    def header(self, stamp, frame):
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // SECOND, nanosec=stamp % SECOND)
        extra = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame, **extra)

    def vector(self, x=0.0, y=0.0, z=0.0, kind="Vector3"):
        return self.make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)

    def turn(self, yaw):
        return self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))

    def scan(self, stamp, frame="base_scan"):
        return self.make(
            "sensor_msgs/msg/LaserScan", header=self.header(stamp, frame), angle_min=-1.0, angle_max=1.5,
            angle_increment=0.5, time_increment=0.01, scan_time=0.2, range_min=0.1, range_max=4.0, ranges=RANGES,
            intensities=np.arange(6, dtype=np.float32),
        )  # fmt: skip

    def odometry(self, stamp, x):
        zero = np.zeros(36)
        pose = self.make(
            "geometry_msgs/msg/Pose", position=self.vector(x, 2.0, 0.3, "Point"), orientation=self.turn(3.0)
        )
        twist = self.make("geometry_msgs/msg/Twist", linear=self.vector(0.2), angular=self.vector(z=0.1))
        return self.make(
            "nav_msgs/msg/Odometry", header=self.header(stamp, "odom"), child_frame_id="base_footprint",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=zero),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=zero),
        )  # fmt: skip

    def transforms(self, stamp, *edges):
        return self.make(
            "tf2_msgs/msg/TFMessage",
            transforms=[
                self.make(
                    "geometry_msgs/msg/TransformStamped", header=self.header(stamp, parent), child_frame_id=child,
                    transform=self.make(
                        "geometry_msgs/msg/Transform", translation=self.vector(x, y, 0.1), rotation=self.turn(yaw)
                    ),
                )
                for parent, child, (x, y, yaw) in edges
            ],
        )  # fmt: skip

    def imu(self, stamp, known=True):
        covariance = np.zeros(9)
        covariance[0] = 0.0 if known else -1.0
        return self.make(
            "sensor_msgs/msg/Imu", header=self.header(stamp, "imu_link"), orientation=self.turn(0.5),
            orientation_covariance=covariance, angular_velocity=self.vector(z=0.3),
            angular_velocity_covariance=np.zeros(9), linear_acceleration=self.vector(z=9.8),
            linear_acceleration_covariance=np.zeros(9),
        )  # fmt: skip

    def image(self, stamp, data):
        return self.make(
            "sensor_msgs/msg/CompressedImage", header=self.header(stamp, "camera"), format="jpeg",
            data=np.frombuffer(data, np.uint8),
        )  # fmt: skip

    def drive(self, n=5):
        """Yield topic, type, time of arrival and message of a short drive; scans arrive 30 ms late."""
        yield (
            "/tf_static",
            "tf2_msgs/msg/TFMessage",
            START,
            self.transforms(START, ("base_link", "base_scan", MOUNT), ("base_footprint", "base_link", (0.0, 0.0, 0.0))),
        )
        for i in range(n):
            stamp = START + i * SECOND // 5
            yield "/odom", "nav_msgs/msg/Odometry", stamp + 1, self.odometry(stamp, 0.1 * i)
            yield (
                "/tf",
                "tf2_msgs/msg/TFMessage",
                stamp + 2,
                self.transforms(stamp, ("odom", "base_footprint", (0.1 * i, 2.0, 3.0))),
            )
            yield "/imu", "sensor_msgs/msg/Imu", stamp + 3, self.imu(stamp, known=i % 2 == 0)
            yield "/scan", "sensor_msgs/msg/LaserScan", stamp + 30_000_000, self.scan(stamp)


def check_drive(given, n=5):
    """Compare what a driver gave of `Ros.drive` with what was put in."""
    assert [m.stamp for m in given["scan"]] == [START + i * SECOND // 5 for i in range(n)]
    assert [m.scan_id for m in given["scan"]] == list(range(n))
    for scan in given["scan"]:
        np.testing.assert_array_equal(scan.ranges, np.array([1, 2, np.inf, np.nan, np.nan, np.inf], np.float32))
        assert (scan.angle_min, scan.angle_increment, scan.range_max) == (-1.0, 0.5, 4.0)
        assert scan.time_increment == pytest.approx(0.01)
        assert scan.mount == pytest.approx(MOUNT)
        np.testing.assert_array_equal(scan.intensities, np.arange(6))
    np.testing.assert_allclose([m.pose for m in given["odom"]], [[0.1 * i, 2.0, 3.0] for i in range(n)], atol=1e-12)
    np.testing.assert_allclose([m.twist for m in given["odom"]], [[0.2, 0.0, 0.1]] * n)
    assert all((m.parent, m.child) == ("odom", "base") for m in given["tf"])
    np.testing.assert_allclose(given["tf"][-1].pose, [0.1 * (n - 1), 2.0, 3.0], atol=1e-12)
    assert [m.orientation_wxyz is None for m in given["imu"]] == [i % 2 == 1 for i in range(n)]
    np.testing.assert_allclose(given["imu"][0].linear_acceleration, [0, 0, 9.8])
