"""Driver of a Gazebo text log with true poses."""

from typing import Literal

from pydantic import Field

from knotwork.core.log_config import LogConfig
from knotwork.core.manifest import Manifest, Port, quantity


class GazeboTextConfig(LogConfig):
    """Lines of x, y, theta, angle_min, angle_max, angle_increment and ranges; LDS-01 by default."""

    odometry: Literal["none", "truth"] = Field("none", description="truth: give the true pose as odometry")
    rate: float = quantity(5.0, "Hz", "the log has no times: scan i is stamped i / rate", gt=0)
    range_min: float = quantity(0.12, "m", "shorter readings are invalid (NaN)", ge=0)
    range_max: float = quantity(3.5, "m", "longer readings are no return (inf)", gt=0, le=1e6)
    mount: tuple[float, float, float] = quantity((-0.032, 0.0, 0.0), "m, m, rad", "pose of the sensor on the robot")


MANIFEST = Manifest(
    name="gazebo-text",
    kind="driver",
    summary="Gazebo text log of a TurtleBot3: true poses and LDS-01 scans",
    impl="knotwork.plugins.drivers.gazebo_text.driver:GazeboTextDriver",
    config=GazeboTextConfig,
    outputs={
        "truth": Port("pose", role="truth", summary="the simulator's pose of the robot at each scan"),
        "odometry": Port("odometry", summary="the same as odometry; nothing with odometry: none"),
        "scan": Port("scan", summary="scans in log order"),
    },
    example="log: {plugin: gazebo-text, path: turtle_world.txt.xz}",
)
