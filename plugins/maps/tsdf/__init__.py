"""Truncated signed distance map: distance to the nearest seen surface, with weights, at several cell sides."""

from typing import Literal

from pydantic import Field

from knotwork.core.cells.config import CellOptions
from knotwork.core.manifest import Manifest, Port, quantity
from knotwork.core.map_config import MapConfig


class TsdfConfig(MapConfig):
    """Config of the signed distance map; `clamp` says nothing here, `free` over `hit` is what a passing beam weighs."""

    resolution: tuple[float, ...] = quantity(
        (0.30, 0.125, 0.05), "m", "cell side of each level, coarse to fine", min_length=1, max_length=8
    )


class TsdfOptions(CellOptions):
    """What only this map understands."""

    sigma: float = quantity(0.02, "m", "standard deviation of the distance between a good beam's end and the map", gt=0)
    beams: float = quantity(
        90.0, "1", "a scan of more beams than this counts as this many: their errors are not independent", gt=0
    )
    truncation: float = quantity(0.15, "m", "distances are kept within plus and minus this", gt=0)
    truncation_cells: float = quantity(3.0, "cells", "and within so many cells, where that is more", ge=2)
    distance: Literal["projective", "normal"] = Field(
        "normal",
        description="of a cell: along the beam, or to the line through the beam's end along the wall it hit",
    )
    weight_max: int = quantity(
        25, "1", "a cell's distance is the mean of so many measurements, then follows", ge=1, le=255
    )
    behind: float = quantity(
        1.0, "1", "share of the truncation behind a surface to which its distance is drawn", gt=0, le=1
    )


MANIFEST = Manifest(
    name="tsdf",
    kind="map",
    summary="truncated signed distances with weights, 3 bytes a cell; scans are aligned on the distance",
    impl="knotwork.plugins.maps.tsdf.map:TsdfMap",
    config=TsdfConfig,
    options=TsdfOptions,
    outputs={"grid": Port("grid", summary="raster of the map, every `publish` seconds and at the end")},
    provides=("map",),
    example="map: {plugin: tsdf, resolution: [0.30, 0.125, 0.05], options: {tsdf: {truncation: 0.3}}}",
)
