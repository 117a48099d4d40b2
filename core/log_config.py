"""The config keys that all log drivers share."""

from typing import Self

from pydantic import Field, model_validator

from knotwork.core.manifest import PluginConfig, quantity


class LogConfig(PluginConfig):
    """Which file, which part of it, and what to do with bad lines."""

    path: str = Field(description="log file: plain, .gz or .xz (told by its content)", min_length=1)
    strict: bool = Field(False, description="true: a malformed line or a cut file ends the run")
    limit: int = quantity(0, "1", "stop after so many scans; 0: all", ge=0)
    start: float = quantity(0.0, "s", "skip what comes before this time after the log's first stamp", ge=0)
    stop: float | None = quantity(None, "s", "stop at this time after the log's first stamp; null: never", gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.stop is not None and self.stop <= self.start:
            raise ValueError("stop must be after start")
        return self
