"""Driver of the Paris Mines Tech rover's logs."""

import math
from typing import Literal

from pydantic import Field

from knotwork.core.log_config import LogConfig
from knotwork.core.manifest import Manifest, Port, quantity


class MinesroverConfig(LogConfig):
    """Time, encoder ticks and 682 ranges of a URG-04LX a line; defaults after BreezySLAM's rover model."""

    odometry: bool = Field(True, description="false: withhold odometry, for runs on scans alone")
    wheel_radius: float = quantity(0.077, "m", "radius of the wheels", gt=0)
    axle: float = quantity(0.330, "m", "distance between the wheels", gt=0)
    ticks_per_turn: float = quantity(2000.0, "1", "encoder ticks of one wheel turn", gt=0)
    largest_step: float = quantity(1.0, "m", "a wheel that seems to roll further between records was reset", gt=0)
    mount: tuple[float, float, float] = quantity((0.145, 0.0, 0.0), "m, m, rad", "pose of the sensor on the robot")
    angle_min: float = quantity(math.radians(-120.0), "rad", "direction of the first beam")
    angle_increment: float = quantity(math.radians(240.0 / 681.0), "rad", "angle between beams", gt=0)
    margin: int = quantity(70, "1", "beams disregarded (NaN) at either end", ge=0, le=340)
    range_min: float = quantity(0.02, "m", "shorter readings are invalid (NaN)", ge=0)
    range_max: float = quantity(4.0, "m", "longer readings are no return (inf)", gt=0, le=1e6)
    zero: Literal["no-return", "invalid"] = Field("no-return", description="what a reading of 0 means")


MANIFEST = Manifest(
    name="minesrover",
    kind="driver",
    summary="log of the Paris Mines Tech rover: wheel encoders and URG-04LX scans",
    impl="knotwork.plugins.drivers.minesrover.driver:MinesroverDriver",
    config=MinesroverConfig,
    outputs={
        "odometry": Port("odometry", summary="robot pose from the encoders, before its scan"),
        "scan": Port("scan", summary="scans in log order"),
    },
    example="log: {plugin: minesrover, path: exp1.dat.xz}",
)
