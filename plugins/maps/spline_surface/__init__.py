"""Map of uniform cubic B-spline surfaces of log-odds, one a level (thesis chapter 7)."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity
from knotwork.core.map_config import MapConfig


class SplineSurfaceConfig(MapConfig):
    """Config of the B-spline surface map."""

    resolution: tuple[float, ...] = quantity(
        (0.30, 0.125, 0.05, 0.03), "m", "knot interval of each level, coarse to fine", min_length=1, max_length=8
    )
    clamp: float = quantity(8.0, "log-odds", "log-odds are kept within plus and minus this", gt=0)


class SplineSurfaceOptions(PluginConfig):
    """What only this map understands."""

    sigma: float = quantity(0.03, "1", "standard deviation of the residual 1 - s / clamp of a good beam", gt=0)
    beams: float = quantity(
        30.0, "1", "a scan of more beams than this counts as this many: their errors are not independent", gt=0
    )
    normals: bool = Field(
        default=True,
        description="use a beam's gradient across the wall it hit only; false: the whole gradient, as the thesis",
    )
    stride: tuple[float, float] = quantity(
        (0.15, 0.15),
        "m, rad",
        "a scan counts once for each of either since the last one that was fused, and at least once",
    )
    strides: float = quantity(4.0, "1", "a scan counts at most so often", ge=1)
    free_step: float = quantity(3.0, "knot intervals", "distance between free samples along a beam", gt=0)
    margin: float = quantity(0.15, "m", "free samples stop this far before the end of a beam", ge=0)
    margin_steps: float = quantity(
        3.0, "knot intervals", "and so many, where that is more: nearer ones take from the wall itself", ge=0
    )
    free_no_return: float = quantity(
        0.0, "m", "a beam without return is free up to this, and to `range_max`; 0: it says nothing", ge=0
    )


MANIFEST = Manifest(
    name="spline-surface",
    kind="map",
    summary="B-spline surfaces of log-odds, several knot intervals, growing with the explored area",
    impl="knotwork.plugins.maps.spline_surface.map:SplineSurface",
    config=SplineSurfaceConfig,
    options=SplineSurfaceOptions,
    outputs={"grid": Port("grid", summary="raster of the map, every `publish` seconds and at the end")},
    provides=("map",),
    example="map: {plugin: spline-surface, resolution: [0.30, 0.125, 0.05, 0.03]}",
)
