"""Plugin `teleop-gamepad`: a person drives with a gamepad, read from the kernel's joystick device."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Config(PluginConfig):
    """Which stick and button does what; the defaults are those of an Xbox pad. `jstest` shows the numbers."""

    device: str = Field("/dev/input/js0", description="joystick device", min_length=1)
    speed: float = quantity(0.2, "m/s", "forward speed at the end of the stick", gt=0)
    yaw_rate: float = quantity(1.0, "rad/s", "turning at the end of the stick", gt=0)
    forward: int = quantity(1, "1", "axis that drives; up is forward", ge=0, le=255)
    turn: int = quantity(0, "1", "axis that turns; left is left", ge=0, le=255)
    hold: int = quantity(4, "1", "button that must be held for the robot to move (left shoulder)", ge=0, le=255)
    stop: int = quantity(1, "1", "button of the emergency stop (B)", ge=0, le=255)
    rearm: int = quantity(7, "1", "button that re-arms (start)", ge=0, le=255)
    dead_zone: float = quantity(0.1, "1", "part of the stick's way that counts as its middle", ge=0, lt=1)
    rate: float = quantity(20.0, "Hz", "commands a second", ge=10, le=100)


MANIFEST = Manifest(
    name="teleop-gamepad",
    kind="policy",
    summary="drives by a gamepad's stick while its left shoulder button is held; B is the emergency stop",
    impl="knotwork.plugins.policies.teleop_gamepad.policy:TeleopGamepad",
    config=Config,
    inputs={"state": Port("motion_state", optional=True, summary="shown to the person")},
    outputs={
        "twist": Port("twist", summary="the command"),
        "control": Port("motion_control", summary="emergency stop, re-arm"),
    },
    example="drive: {plugin: teleop-gamepad, speed: 0.15}",
)
