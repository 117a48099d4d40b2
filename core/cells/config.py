"""The options that all maps of cells share."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import PluginConfig, quantity

Interpolation = Literal["nearest", "bilinear", "bicubic"]


class CellOptions(PluginConfig):
    """What maps of cells understand beside the shared keys."""

    interpolation: Interpolation = Field(
        "bilinear", description="between cell centres, when a scan is aligned; nearest: slopes by central differences"
    )
    beams: float = quantity(
        180.0, "1", "a scan of more beams than this counts as this many: their errors are not independent", gt=0
    )
    normals: bool = Field(
        default=True,
        description="use a beam's gradient across the wall it hit only; false: the whole gradient",
    )
    free_no_return: float = quantity(
        0.0, "m", "a beam without return is free up to this, and to `range_max`; 0: it says nothing", ge=0
    )
