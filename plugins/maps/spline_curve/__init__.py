"""Map of uniform cubic B-spline curves, one for each stretch of obstacle and level (thesis chapter 6)."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity
from knotwork.core.map_config import MapConfig


class SplineCurveConfig(MapConfig):
    """Config of the B-spline curve map; `hit`, `free` and `clamp` mean nothing to it."""

    resolution: tuple[float, ...] = quantity(
        (0.4, 0.2, 0.1), "m", "knot interval of each level, coarse to fine", min_length=1, max_length=8
    )


class SplineCurveOptions(PluginConfig):
    """What only this map understands."""

    gap_relative: float = quantity(
        3.0, "1", "a gap between neighbouring points this many times the one before ends a cluster", gt=1
    )
    gap: float = quantity(0.7, "knot intervals", "a wider gap ends a cluster", gt=0)
    gap_least: float = quantity(0.2, "m", "but not a gap up to this, however fine the knots", ge=0)
    gap_line: float = quantity(1.0, "m", "nor a gap up to this whose ends lie on one line: a wall seen aslant", ge=0)
    points: int = quantity(8, "points", "a smaller cluster is not made a curve", ge=4)
    gate: float = quantity(0.5, "m", "a point farther from every curve is not aligned", gt=0)
    fuse_gate: float = quantity(
        0.15, "m", "a point farther from every curve, and than half a knot interval, is new", gt=0
    )
    sigma: float = quantity(0.014, "m", "standard deviation of a good beam across the curve it hit", gt=0)
    sigma_along: float = quantity(
        0.0,
        "m",
        "and along it, of what the offset of a whole cluster leaves, as the thesis; 0: an offset for each point",
        ge=0,
    )
    missing: float = quantity(0.2, "m", "a point on no curve costs what one this far off would", gt=0)
    normals: bool = Field(
        default=True,
        description="a beam says how far across the surface it hit only; false: across the curve, noise and all",
    )
    beams: float = quantity(
        20.0, "1", "a scan of more beams than this counts as this many: their errors are not independent", gt=0
    )
    proven: float = quantity(
        1.5,
        "scans",
        "a curve that so many scans have seen is trusted half, one that n have n^2 / (n^2 + proven^2)",
        ge=0,
    )
    slope: float = quantity(
        0.04, "rad", "direction of walls is no better known: so much of what a scan knows across is noise along", ge=0
    )
    smoothness: float = quantity(
        0.1, "1", "weight of the squared second derivative, per knot, against squared distances in a fit", gt=0
    )
    weight: float = quantity(50.0, "scans", "a control point carries the evidence of this many at most", gt=0, le=51)
    stale_margin: float = quantity(0.3, "m", "a curve this far before the end of a beam contradicts the beam", gt=0)
    explained: float = quantity(0.1, "m", "a beam that ends this near to a curve is explained by the map", gt=0)
    front: float = quantity(5.0, "m", "space this far in front of a curve counts as free, if no other is nearer", ge=0)


MANIFEST = Manifest(
    name="spline-curve",
    kind="map",
    summary="B-spline curves along what was hit, several knot intervals: a few bytes a metre of wall",
    impl="knotwork.plugins.maps.spline_curve.map:SplineCurve",
    config=SplineCurveConfig,
    options=SplineCurveOptions,
    outputs={"grid": Port("grid", summary="raster of the map, every `publish` seconds and at the end")},
    provides=("map",),
    example="map: {plugin: spline-curve, resolution: [0.4, 0.2, 0.1]}",
)
