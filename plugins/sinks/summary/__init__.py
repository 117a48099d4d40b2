"""Plugin `summary`: what a run did and how long it took, for programs."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class SummaryConfig(PluginConfig):
    """Where the summary goes and how often it is written."""

    name: str = Field("summary", pattern=r"^[\w.-]+$", description="file name without ending, in the run's folder")
    period: float = quantity(60.0, "s", "also written each so many seconds of the log; 0: at the end only", ge=0)


MANIFEST = Manifest(
    name="summary",
    kind="sink",
    summary="writes summary.json: scans, speed, time and drops of each node, path length, map size",
    impl="knotwork.plugins.sinks.summary.writer:SummaryWriter",
    config=SummaryConfig,
    inputs={"message": Port("*", many=True, summary="counted; the runtime's statistics are copied")},
    example="summary: {plugin: summary}",
)
