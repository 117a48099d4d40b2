"""Plugin `live`: the run in a browser, while it goes on."""

from typing import Self

from pydantic import Field, model_validator

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class LiveConfig(PluginConfig):
    """Where the page is, who may see it and how often it is told."""

    host: str = Field(
        "127.0.0.1", description="address to listen on; others than this machine's need a token (0.0.0.0: all)"
    )
    port: int = quantity(8420, "1", "port to listen on; 0 takes a free one", ge=0, le=65535)
    token_file: str = Field(
        "",
        description="file with the token that a browser must give; without it a new one is made where one is needed",
    )
    rate: float = quantity(10.0, "Hz", "looks a second", gt=0, le=60)
    viewers: int = quantity(32, "1", "viewers at a time", ge=1, le=1000)
    patience: float = quantity(10.0, "s", "a viewer that reads nothing for so long is dropped", gt=0)
    hold: float = quantity(0.4, "s", "the stick counts no longer than this after the page was last seen alive", gt=0)
    paused: bool = Field(False, description="a log or a simulation waits for the page's play button")

    @model_validator(mode="after")
    def _seen_in_time(self) -> Self:
        if self.hold < 2 / self.rate:
            raise ValueError("hold must be at least two periods of `rate`")
        return self


MANIFEST = Manifest(
    name="live",
    kind="sink",
    summary="shows the run in a browser: map, robot, scan, path, latencies; pause and step, emergency stop",
    impl="knotwork.plugins.sinks.live.sink:Live",
    config=LiveConfig,
    inputs={"all": Port("*", many=True, feedback=True, summary="every stream of the pipeline")},
    outputs={"control": Port("motion_control", summary="emergency stop, re-arm")},
    provides=("stick",),
    requires=("PIL",),
    example="live: {plugin: live}",
)
