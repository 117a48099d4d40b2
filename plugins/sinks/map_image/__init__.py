"""Draws the map and the robot's path on it: `map.png`."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class MapImageConfig(PluginConfig):
    """Where the picture goes, how large it is and how often it is drawn."""

    name: str = Field("map", pattern=r"^[\w.-]+$", description="file name without ending, in the run's folder")
    period: float = quantity(0.0, "s", "also draw each so many seconds of the log; 0: at the end only", ge=0)
    size: int = quantity(1600, "px", "longer side of the picture, roughly", ge=200, le=4000)
    margin: float = quantity(0.5, "m", "kept around what is known of the map", ge=0, le=100)
    trajectory: bool = Field(True, description="draw the robot's path")


MANIFEST = Manifest(
    name="map-image",
    kind="sink",
    summary="draws the last grid with the estimated path over it (PNG)",
    impl="knotwork.plugins.sinks.map_image.image:MapImage",
    config=MapImageConfig,
    inputs={
        "grid": Port("grid", many=True, summary="the second and later producers get files named after them"),
        "pose": Port("pose", role="estimate", optional=True, summary="the path that is drawn"),
        "trajectory": Port("trajectory", optional=True, summary="corrects the path"),
    },
    requires=("PIL",),
    example="picture: {plugin: map-image, period: 60}",
)
