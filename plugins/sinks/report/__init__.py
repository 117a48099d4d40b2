"""Plugin `report`: a run on one page, to keep and to send."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class ReportConfig(PluginConfig):
    """Where the report goes and what it compares with."""

    name: str = Field("report", pattern=r"^[\w.-]+$", description="file name without ending, in the run's folder")
    relations: str = Field("", description="file of measured relations (`t1 t2 x y z roll pitch yaw`) to score against")
    reference: str = Field("", description="TUM file of a reference trajectory to score against")
    tolerance: float = quantity(0.01, "s", "to match stamps of `relations` and `reference`", ge=0)
    events: int = quantity(200, "1", "most warnings and errors that are listed", ge=0)


MANIFEST = Manifest(
    name="report",
    kind="sink",
    summary="writes report.html, one file: map, trajectory, errors, latencies, config, versions",
    impl="knotwork.plugins.sinks.report.sink:Report",
    config=ReportConfig,
    inputs={"message": Port("*", many=True, summary="every stream of the pipeline")},
    requires=("PIL",),
    example="report: {plugin: report, relations: intel.relations}",
)
