"""Driver of CARMEN logs (`*.clf`, `*.log`)."""

from typing import Literal

from pydantic import Field

from knotwork.core.log_config import LogConfig
from knotwork.core.manifest import Manifest, Port, quantity


class CarmenConfig(LogConfig):
    """A CARMEN log: FLASER, RLASER, ROBOTLASER1 and ODOM lines."""

    laser: Literal["auto", "FLASER", "RLASER", "ROBOTLASER1"] = Field(
        "auto", description="whose scans to give; auto: FLASER or ROBOTLASER1, whichever comes first"
    )
    odometry: bool = Field(True, description="false: withhold odometry, for runs on scans alone")
    angle_min: float | None = quantity(
        None,
        "rad",
        "direction of the first beam; null: from the message, else -90 deg for 180, 181, 360 and 361 beams",
    )
    angle_increment: float | None = quantity(
        None,
        "rad",
        "angle between beams; null: from the message, else 1 deg (180, 181 beams) or 0.5 deg (360, 361)",
        gt=0,
    )
    range_min: float = quantity(0.0, "m", "shorter readings, zeros and negative ones are invalid (NaN)", ge=0)
    no_return: float = quantity(
        40.0, "m", "readings of this and more are no return (inf); the scans' range_max", gt=0, le=1e6
    )
    mount: tuple[float, float, float] | None = quantity(
        None, "m, m, rad", "pose of the sensor on the robot; null: from the poses of the log's first scan"
    )


MANIFEST = Manifest(
    name="carmen",
    kind="driver",
    summary="CARMEN log: FLASER, RLASER, ROBOTLASER1 and ODOM lines, plain, .gz or .xz",
    impl="knotwork.plugins.drivers.carmen.driver:CarmenDriver",
    config=CarmenConfig,
    outputs={
        "odometry": Port("odometry", summary="robot pose of ODOM lines and of each scan, before that scan"),
        "scan": Port("scan", summary="scans in log order"),
    },
    example="log: {plugin: carmen, path: intel.clf.xz}",
)
