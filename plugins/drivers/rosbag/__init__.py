"""Plugin `rosbag`: feeds a pipeline from ROS bags, without ROS."""

from knotwork.core.manifest import Manifest
from knotwork.core.playback.config import PlaybackConfig


class Config(PlaybackConfig):
    """A ROS 1 `.bag`, or a ROS 2 bag: its folder, or its `.db3` or `.mcap` file."""


MANIFEST = Manifest(
    name="rosbag",
    kind="driver",
    summary="ROS 1 and ROS 2 bags (.bag, .db3, .mcap): scans, odometry, transforms, IMU, images; a port for each topic",
    impl="knotwork.plugins.drivers.rosbag.driver:Rosbag",
    config=Config,
    ports="knotwork.plugins.drivers.rosbag.driver:ports",
    extra="ros",
    requires=("rosbags",),
    example="log: {plugin: rosbag, path: lab.bag, streams: {scan: /scan, odometry: /odom}}",
)
