"""Plugin `dynamixel-wheels`: two Dynamixel X motors as wheels, directly on a U2D2 or similar."""

from typing import Self

from pydantic import Field, model_validator

from knotwork.core.manifest import Manifest, PluginConfig, Port, Use, quantity
from knotwork.core.safety.config import SafetyConfig


class Config(PluginConfig):
    """Where the motors are and what they move; the defaults are a Burger's."""

    port: str = Field("/dev/ttyUSB0", description="serial device of the adapter", min_length=1)
    baud: int = quantity(1_000_000, "bit/s", "of the bus; motors from the factory have 57600", ge=9600, le=4_500_000)
    left: int = quantity(1, "1", "id of the left motor", ge=0, le=252)
    right: int = quantity(2, "1", "id of the right motor", ge=0, le=252)
    wheel_radius: float = quantity(0.033, "m", "radius of the wheels", gt=0)
    wheel_separation: float = quantity(0.160, "m", "distance between the wheels", gt=0)
    covariance: bool = Field(True, description="odometry says how uncertain it is")
    watchdog: float = quantity(
        0.2, "s", "without any packet for so long the motors stop by themselves, in steps of 20 ms", ge=0.1, le=2.5
    )
    profile_acceleration: float = quantity(
        3.0, "m/s^2", "ramp of the motors themselves, under the host's; 0: none", ge=0
    )
    voltage_min: float = quantity(11.0, "V", "below it the base stops; 0: not watched", ge=0)
    torque_off: bool = Field(True, description="take the torque off when the run ends; false: hold, as on a slope")
    safety: SafetyConfig = Field(SafetyConfig(), description="limits, command time-out, re-arming")

    @model_validator(mode="after")
    def _two_motors(self) -> Self:
        if self.left == self.right:
            raise ValueError("left and right must have different ids")
        return self


MANIFEST = Manifest(
    name="dynamixel-wheels",
    kind="driver",
    summary="two Dynamixel wheel motors (XL430, XM430) on a serial adapter",
    impl="knotwork.plugins.drivers.dynamixel_wheels.driver:DynamixelWheels",
    config=Config,
    inputs={
        "twist": Port("twist", optional=True, summary="the command"),
        "control": Port("motion_control", optional=True, many=True, summary="emergency stop, re-arm"),
    },
    outputs={
        "odometry": Port("odometry", summary="dead reckoning from encoders"),
        "wheels": Port("wheels", summary="encoders"),
        "battery": Port("battery", summary="voltage at the motors"),
        "state": Port("motion_state", summary="whether it may move, and why not"),
    },
    uses={"lidar": Use("packets", optional=True, summary="its silence stops the base")},
    push=True,
    example="base: {plugin: dynamixel-wheels, port: /dev/ttyUSB1}",
)
