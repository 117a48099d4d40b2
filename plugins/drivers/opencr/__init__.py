"""Plugin `opencr`: the base of a TurtleBot3 with its stock (ROS 2) firmware, over USB."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, Use, quantity
from knotwork.core.safety.config import SafetyConfig


class Config(PluginConfig):
    """Where the board is and which robot it moves."""

    port: str = Field(
        "/dev/serial/by-id/usb-ROBOTIS_OpenCR_Virtual_ComPort_in_FS_Mode_FFFFFFFEFFFF-if00",
        description="serial device; a link below /dev/serial/by-id stays the same after replugging",
        min_length=1,
    )
    model: Literal["auto", "burger", "waffle", "waffle-pi"] = Field(
        "auto", description="auto: what the board says (it does not tell waffle from waffle-pi, nor need it)"
    )
    odometry: Literal["gyro", "wheels"] = Field("gyro", description="where the heading of odometry comes from")
    covariance: bool = Field(True, description="odometry says how uncertain it is")
    calibrate_gyro: bool = Field(True, description="at the start, standing still; takes 3 to 5 s")
    gyro_rest: float = quantity(
        10.0, "s", "after calibrating it stands on, to learn what is left of the gyro's bias", ge=0, le=120
    )
    profile_acceleration: float = quantity(
        3.0, "m/s^2", "ramp of the motors themselves, under the host's; 0: none", ge=0
    )
    battery_min: float = quantity(11.0, "V", "below it the base stops; 0: not watched", ge=0)
    torque_off: bool = Field(True, description="take the torque off when the run ends; false: hold, as on a slope")
    safety: SafetyConfig = Field(SafetyConfig(), description="limits, command time-out, re-arming")


MANIFEST = Manifest(
    name="opencr",
    kind="driver",
    summary="TurtleBot3 base (Burger, Waffle, Waffle Pi) with stock firmware on its OpenCR board",
    impl="knotwork.plugins.drivers.opencr.driver:OpenCr",
    config=Config,
    inputs={
        "twist": Port("twist", optional=True, summary="the command"),
        "control": Port("motion_control", optional=True, many=True, summary="emergency stop, re-arm"),
    },
    outputs={
        "odometry": Port("odometry", summary="dead reckoning from encoders, and gyro"),
        "imu": Port("imu"),
        "wheels": Port("wheels", summary="encoders"),
        "battery": Port("battery"),
        "state": Port("motion_state", summary="whether it may move, and why not"),
    },
    uses={"lidar": Use("packets", optional=True, summary="its silence stops the base")},
    push=True,
    example="base: {plugin: opencr, port: /dev/ttyACM0}",
)
