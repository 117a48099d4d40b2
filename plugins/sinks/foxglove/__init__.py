"""Plugin `foxglove`: a run for the Foxglove app, while it goes on."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class FoxgloveConfig(PluginConfig):
    """Where the app finds the run and what it is shown."""

    host: str = Field(
        "127.0.0.1", description="address to listen on; whoever reaches it can look, the protocol knows no token"
    )
    port: int = quantity(8765, "1", "port to listen on; 0 takes a free one", ge=0, le=65535)
    backlog: int = quantity(256, "messages", "kept for a slow viewer; its oldest are dropped beyond", ge=8)
    include: tuple[str, ...] = Field(("*",), description="streams to show, as `node.port` with * and ?")
    exclude: tuple[str, ...] = Field((), description="streams to leave out of these")


MANIFEST = Manifest(
    name="foxglove",
    kind="sink",
    summary="shows the run in the Foxglove app or Lichtblick, over a WebSocket",
    impl="knotwork.plugins.sinks.foxglove.sink:FoxgloveSink",
    config=FoxgloveConfig,
    inputs={"all": Port("*", many=True, summary="every stream that has a view")},
    extra="foxglove",
    requires=("foxglove",),
    example="foxglove: {plugin: foxglove, port: 8765}",
)
