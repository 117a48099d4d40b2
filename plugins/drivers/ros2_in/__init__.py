"""Plugin `ros2-in`: ROS 2 topics as streams, without ROS."""

from typing import Literal

from pydantic import Field, field_validator

from knotwork.core.manifest import Manifest, PluginConfig, quantity


class Topic(PluginConfig):
    """One topic."""

    topic: str = Field(description="its name, e.g. scan or robot1/scan", pattern=r"^/?[\w/]+$")
    message: Literal["scan", "odometry", "twist"] = Field(
        description="LaserScan, nav_msgs Odometry or geometry_msgs Twist"
    )
    mount: tuple[float, float, float] = quantity(
        (0.0, 0.0, 0.0), "m, m, rad", "of a scan: pose of the scanner in the robot's frame"
    )


class Ros2InConfig(PluginConfig):
    """What is taken, as zenoh-bridge-ros2dds gives it: key = topic, payload = CDR."""

    listen: tuple[str, ...] = Field((), description="endpoints others connect to, e.g. tcp/0.0.0.0:7447")
    connect: tuple[str, ...] = Field((), description="endpoints to connect to: the bridge's, e.g. tcp/127.0.0.1:7447")
    scouting: bool = Field(False, description="also look for the bridge by multicast")
    topics: dict[str, Topic] = Field(description="output ports, by names of your own", min_length=1)

    @field_validator("topics")
    @classmethod
    def _names(cls, value: dict[str, Topic]) -> dict[str, Topic]:
        for name in value:
            if not name.replace("-", "").replace("_", "").isalnum():
                raise ValueError(f"{name!r} cannot be the name of a port (letters, digits, - and _)")
        return value


MANIFEST = Manifest(
    name="ros2-in",
    kind="driver",
    summary="takes scans, odometry and commands from ROS 2 topics through a zenoh bridge",
    impl="knotwork.plugins.drivers.ros2_in.driver:Ros2In",
    config=Ros2InConfig,
    ports="knotwork.plugins.drivers.ros2_in.ports:outputs",
    push=True,
    extra="zenoh",
    requires=("zenoh",),
    example="ros: {plugin: ros2-in, connect: [tcp/127.0.0.1:7447], topics: {scan: {topic: /scan, message: scan}}}",
)
