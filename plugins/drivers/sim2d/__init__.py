"""A simulated robot with a lidar in a 2D world of segments and arcs."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity
from knotwork.core.world.parameters import BaseParameters, LidarParameters


class Kidnap(PluginConfig):
    """The robot is lifted and put elsewhere; odometry does not notice."""

    at: float = quantity(..., "s", "time of the run", ge=0)
    to: tuple[float, float, float] = quantity(..., "m, m, rad", "new pose in the world's frame")


class Config(PluginConfig):
    """A TurtleBot3 Burger with an LDS-01, unless `base` and `lidar` say otherwise."""

    world: str = Field("apartment", description="name of a shipped world, or path of a world's YAML file")
    start: tuple[float, float, float] | None = quantity(
        None, "m, m, rad", "start pose in the world's frame; none: the world's own"
    )
    duration: float = quantity(60.0, "s", "length of the run", gt=0)
    stop_when_idle: float = quantity(
        0.0, "s", "end the run when the robot has stood this long after it has moved; 0: never", ge=0
    )
    rate: float = quantity(50.0, "Hz", "steps a second: of commands, odometry, wheels and imu", gt=0, le=1000)
    noise: bool = Field(True, description="false: no slip, no sensor errors, no encoder ticks")
    odometry: Literal["gyro", "wheels"] = Field("gyro", description="where the heading of odometry comes from")
    covariance: bool = Field(True, description="odometry says how uncertain it is")
    truth_frame: Literal["map", "world"] = Field(
        "map", description="frame of `truth`; map: the first true pose is its origin"
    )
    base: BaseParameters = Field(BaseParameters(), description="the base")
    lidar: LidarParameters = Field(LidarParameters(), description="the lidar")
    kidnap: tuple[Kidnap, ...] = Field((), description="times at which the robot is put elsewhere")


MANIFEST = Manifest(
    name="sim2d",
    kind="driver",
    summary="simulated TurtleBot3 in a 2D world: lidar, odometry, IMU, wheels and the truth",
    impl="knotwork.plugins.drivers.sim2d.driver:Sim2d",
    config=Config,
    inputs={"twist": Port("twist", optional=True, summary="the command; the base brakes when it is too old")},
    outputs={
        "scan": Port("scan", summary="each turn, at its end; the stamp is its first-measured beam's time"),
        "odometry": Port("odometry", summary="dead reckoning from encoders, and gyro"),
        "imu": Port("imu", summary="mean yaw rate and acceleration of each step"),
        "wheels": Port("wheels", summary="encoders"),
        "truth": Port("pose", role="truth", summary="true pose at each scan's stamp"),
        "applied": Port("twist", summary="what the motors did in each step: limits, ramp and time-out applied"),
    },
    closed_loop=True,
    example="sim: {plugin: sim2d, world: apartment, duration: 300, lidar: {accuracy: 0}}",
)
