"""Writes the map as navigation stacks read it: `map.pgm` and `map.yaml`."""

from typing import Self

from pydantic import Field, model_validator

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class MapExportConfig(PluginConfig):
    """Where the map goes and from which probability on a cell counts as free or occupied."""

    name: str = Field("map", pattern=r"^[\w.-]+$", description="file name without ending, in the run's folder")
    period: float = quantity(0.0, "s", "also write each so many seconds of the log; 0: at the end only", ge=0)
    occupied_thresh: float = quantity(0.65, "1", "more probably occupied than this is an obstacle", gt=0, lt=1)
    free_thresh: float = quantity(0.196, "1", "less probably occupied than this is free", gt=0, lt=1)

    @model_validator(mode="after")
    def _apart(self) -> Self:
        if self.occupied_thresh - self.free_thresh < 0.02:
            raise ValueError("occupied_thresh must exceed free_thresh by 0.02: unknown cells lie between them")
        return self


MANIFEST = Manifest(
    name="map-export",
    kind="sink",
    summary="writes the last grid as map.pgm and map.yaml (ROS map_server, Nav2)",
    impl="knotwork.plugins.sinks.map_export.export:MapExport",
    config=MapExportConfig,
    inputs={
        "grid": Port("grid", many=True, summary="the second and later producers get files named after them"),
    },
    example="export: {plugin: map-export}",
)
