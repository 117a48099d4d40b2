"""Gaussian-process occupancy map: maps along a known trajectory, for comparison; nothing aligns with it."""

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity
from knotwork.core.map_config import MapConfig


class GpConfig(MapConfig):
    """Config of the Gaussian-process map; `hit`, `free` and `clamp` say nothing here, the finest cells count."""

    resolution: tuple[float, ...] = quantity(
        (0.10,), "m", "side of the cells at which the process is kept, the finest counts", min_length=1, max_length=8
    )


class GpOptions(PluginConfig):
    """What only this map understands."""

    length: float = quantity(0.25, "m", "length scale of the Matern 3/2 kernel", gt=0)
    noise: float = quantity(0.1, "1", "standard deviation of a label (occupied 1, free -1)", gt=0)
    free_step: float = quantity(0.5, "m", "distance between free samples along a beam", gt=0)
    margin: float = quantity(0.25, "m", "free samples stop this far before the end of a beam", ge=0)
    points: int = quantity(600, "1", "most training points of a scan: the time grows with their cube", ge=10)
    fuse_motion: tuple[float, float] = quantity(
        (0.5, 0.5), "m, rad", "a scan is fused once the robot has moved by either since the last fused one"
    )


MANIFEST = Manifest(
    name="gp",
    kind="map",
    summary="Gaussian-process occupancy map of scans at estimated poses; for comparison, not for a localiser",
    impl="knotwork.plugins.maps.gp.map:GpMap",
    config=GpConfig,
    options=GpOptions,
    inputs={
        "scan": Port("scan", optional=True, summary="fused at the pose of the same scan"),
        "pose": Port("pose", role="estimate", optional=True, summary="of another map's localiser"),
    },
    outputs={"grid": Port("grid", summary="raster of the map, every `publish` seconds and at the end")},
    extra="gp",
    requires=("sklearn",),
    example="second: {plugin: gp}",
)
