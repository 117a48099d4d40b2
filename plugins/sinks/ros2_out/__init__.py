"""Plugin `ros2-out`: streams as ROS 2 topics, without ROS."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port


class Ros2OutConfig(PluginConfig):
    """What is published, as zenoh-bridge-ros2dds expects it: key = topic, payload = CDR."""

    listen: tuple[str, ...] = Field((), description="endpoints others connect to, e.g. tcp/0.0.0.0:7447")
    connect: tuple[str, ...] = Field((), description="endpoints to connect to: the bridge's, e.g. tcp/127.0.0.1:7447")
    scouting: bool = Field(False, description="also look for the bridge by multicast")
    namespace: str = Field("", pattern=r"^[\w/]*$", description="before every topic, e.g. robot1")
    topics: dict[str, tuple[str, ...]] = Field(
        description="topic to the streams (`node.port`) it takes: scan, odometry, grid, twist; `tf` takes transforms, "
        "odometry and the mounts of scans",
        min_length=1,
    )
    frames: dict[str, str] = Field({"base": "base_link"}, description="our frames to ROS's, where they differ")


MANIFEST = Manifest(
    name="ros2-out",
    kind="sink",
    summary="publishes scan, odometry, map, commands and tf as ROS 2 topics through a zenoh bridge",
    impl="knotwork.plugins.sinks.ros2_out.sink:Ros2Out",
    config=Ros2OutConfig,
    inputs={"all": Port("*", many=True, summary="every stream of the pipeline")},
    extra="zenoh",
    requires=("zenoh",),
    example="ros: {plugin: ros2-out, connect: [tcp/127.0.0.1:7447], "
    "topics: {scan: [lidar.scan], map: [map.grid], tf: [prior.transform, base.odometry, lidar.scan]}}",
)
