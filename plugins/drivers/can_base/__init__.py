"""Plugin `can-base`: a base that speaks AgileX protocol v2 on a CAN bus."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, Use, quantity
from knotwork.core.safety.config import SafetyConfig


class Config(PluginConfig):
    """Which bus, and what the base looks like; the defaults are a Scout Mini's."""

    interface: str = Field(
        "socketcan", description="of python-can: socketcan, udp_multicast, virtual, ...", min_length=1
    )
    channel: str = Field("can0", description="of the interface: can0, 239.74.163.2, ...", min_length=1)
    bitrate: int = quantity(500_000, "bit/s", "for interfaces that set it themselves", gt=0)
    udp_port: int = quantity(43113, "1", "of udp_multicast", ge=1, le=65535)
    wheel_radius: float = quantity(0.08, "m", "radius of the wheels", gt=0)
    wheel_separation: float = quantity(0.36, "m", "distance between left and right wheels", gt=0)
    wheel_speed_max: float = quantity(1.5, "m/s", "fastest rim speed", gt=0)
    covariance: bool = Field(True, description="odometry says how uncertain it is")
    battery_min: float = quantity(0.0, "V", "below it the base stops; 0: not watched", ge=0)
    standby: bool = Field(True, description="put the base in standby when the run ends")
    safety: SafetyConfig = Field(SafetyConfig(), description="limits, command time-out, re-arming")


MANIFEST = Manifest(
    name="can-base",
    kind="driver",
    summary="AgileX base (Scout, Bunker, Tracer, Ranger; protocol v2) on a CAN bus",
    impl="knotwork.plugins.drivers.can_base.driver:CanBase",
    config=Config,
    inputs={
        "twist": Port("twist", optional=True, summary="the command"),
        "control": Port("motion_control", optional=True, many=True, summary="emergency stop, re-arm"),
    },
    outputs={
        "odometry": Port("odometry", summary="dead reckoning from the base's odometer"),
        "wheels": Port("wheels", summary="the odometer"),
        "battery": Port("battery"),
        "state": Port("motion_state", summary="whether it may move, and why not"),
    },
    uses={"lidar": Use("packets", optional=True, summary="its silence stops the base")},
    push=True,
    extra="can",
    requires=("can", "cantools"),
    example="base: {plugin: can-base, channel: can0, safety: {speed: 0.5}}",
)
