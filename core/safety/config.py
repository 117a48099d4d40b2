"""The config block `safety` that every base driver has."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import PluginConfig, quantity


class SafetyConfig(PluginConfig):
    """Limits of a base; the wheels' own limits come from its model and hold as well."""

    speed: float | None = quantity(None, "m/s", "fastest forward speed; none: what the wheels allow", gt=0)
    yaw_rate: float | None = quantity(None, "rad/s", "fastest turning; none: what the wheels allow", gt=0)
    acceleration: float = quantity(1.0, "m/s^2", "at which a wheel's rim speeds up", gt=0)
    deceleration: float = quantity(1.5, "m/s^2", "at which a wheel's rim slows down, also to stop", ge=1.5)
    command_timeout: float = quantity(
        0.25, "s", "age of a command, from its emission, after which the base stops", gt=0, le=1.0
    )
    lidar_silence: float = quantity(
        0.15, "s", "without a lidar packet for so long the base stops; 0: the lidar is not watched", ge=0
    )
    rearm: Literal["manual", "auto"] = Field(
        default="manual",
        description="after a fault the base stands until it is told to go on; auto: until the fault has been "
        "gone for a second (never after an emergency stop)",
    )
