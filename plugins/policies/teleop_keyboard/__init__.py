"""Plugin `teleop-keyboard`: a person drives from the terminal."""

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Config(PluginConfig):
    """How fast, and for how long a key counts."""

    speed: float = quantity(0.2, "m/s", "fastest forward speed", gt=0)
    yaw_rate: float = quantity(1.0, "rad/s", "fastest turning", gt=0)
    speed_step: float = quantity(0.05, "m/s", "change by a key", gt=0)
    yaw_rate_step: float = quantity(0.25, "rad/s", "change by a key", gt=0)
    hold: float = quantity(
        1.0, "s", "without a key for so long the robot stops: a frozen connection must not drive on; 0: never", ge=0
    )
    rate: float = quantity(20.0, "Hz", "commands a second", ge=10, le=100)


MANIFEST = Manifest(
    name="teleop-keyboard",
    kind="policy",
    summary="drives by keys of the terminal: w a s d x, space stops, e is the emergency stop, r re-arms",
    impl="knotwork.plugins.policies.teleop_keyboard.policy:TeleopKeyboard",
    config=Config,
    inputs={"state": Port("motion_state", optional=True, summary="shown to the person")},
    outputs={
        "twist": Port("twist", summary="the command"),
        "control": Port("motion_control", summary="emergency stop, re-arm"),
    },
    push=True,
    example="drive: {plugin: teleop-keyboard, speed: 0.15}",
)
