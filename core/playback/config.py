"""The config keys that the drivers of recorded messages share."""

from typing import Self

from pydantic import Field, model_validator

from knotwork.core.manifest import PluginConfig, quantity


class FrameConfig(PluginConfig):
    """How another framework's names of frames are read."""

    base: tuple[str, ...] = Field(
        default=("base", "base_footprint", "base_link"), description="names of the robot's base frame"
    )
    odom: tuple[str, ...] = Field(default=("odom", "odom_combined"), description="names of the odometry frame")
    mounts: dict[str, tuple[float, float, float]] = quantity(
        {}, "m, m, rad", "poses of sensor frames on the base, by frame; before what the log's transforms say"
    )


class PlaybackConfig(PluginConfig):
    """Which recording, which streams and which part of it."""

    path: str = Field(description="the recording; with * and ?, several parts of one, in the order of their names")
    streams: dict[str, str] = Field(
        {},
        description="streams (`node.port`) or topics to give, by output port; without any, all of a run's own "
        "sources, or all that is understood of a foreign recording",
    )
    start: float = quantity(0.0, "s", "begin this long after the recording's first message", ge=0)
    stop: float | None = quantity(
        None, "s", "end this long after the recording's first message; null: at its end", gt=0
    )
    loop: int = quantity(1, "1", "how often it is played; 0: for ever", ge=0)
    strict: bool = Field(False, description="true: damage or a message that cannot be read ends the run")
    frames: FrameConfig = Field(FrameConfig(), description="names of frames in a foreign recording")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.stop is not None and self.stop <= self.start:
            raise ValueError("stop must be after start")
        return self
