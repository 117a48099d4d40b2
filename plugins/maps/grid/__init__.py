"""Occupancy grid map: log-odds cells of one byte, several sides, interpolated for alignment."""

from knotwork.core.cells.config import CellOptions
from knotwork.core.manifest import Manifest, Port, quantity
from knotwork.core.map_config import MapConfig


class GridConfig(MapConfig):
    """Config of the occupancy grid map."""

    resolution: tuple[float, ...] = quantity(
        (0.30, 0.125, 0.05), "m", "cell side of each level, coarse to fine", min_length=1, max_length=8
    )
    clamp: float = quantity(4.0, "log-odds", "log-odds are kept within plus and minus this", gt=0)


class GridOptions(CellOptions):
    """What only this map understands."""

    sigma: float = quantity(0.05, "1", "standard deviation of the residual 1 - log-odds / clamp of a good beam", gt=0)
    beams: float = quantity(
        10.0, "1", "a scan of more beams than this counts as this many: a grid's errors are far from independent", gt=0
    )
    margin: float = quantity(0.1, "m", "cells this near to the end of a beam are not freed by it", ge=0)


MANIFEST = Manifest(
    name="grid",
    kind="map",
    summary="occupancy grid of log-odds, 1 byte a cell, nearest, bilinear or bicubic for alignment",
    impl="knotwork.plugins.maps.grid.map:GridMap",
    config=GridConfig,
    options=GridOptions,
    outputs={"grid": Port("grid", summary="raster of the map, every `publish` seconds and at the end")},
    provides=("map",),
    example="map: {plugin: grid, resolution: [0.30, 0.125, 0.05], options: {grid: {interpolation: bicubic}}}",
)
