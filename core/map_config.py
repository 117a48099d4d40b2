"""The config keys that all maps share, so that changing `plugin:` is the whole swap."""

import itertools
from typing import Annotated

from pydantic import Field, field_validator

from knotwork.core.manifest import PluginConfig, quantity

Positive = Annotated[float, Field(gt=0)]


class MapConfig(PluginConfig):
    """Shared keys of every map; backend-only keys sit under `options: {<plugin>: {...}}`."""

    resolution: tuple[Positive, ...] = quantity(
        (0.30, 0.125, 0.05),
        "m",
        "knot interval or cell side of each level, coarse to fine",
        min_length=1,
        max_length=8,
    )
    range_min: float = quantity(0.05, "m", "returns nearer than this are ignored", ge=0)
    range_max: float = quantity(40.0, "m", "returns at or beyond this count as no return", gt=0)
    hit: float = quantity(1.0, "log-odds", "added where a beam ends", gt=0)
    free: float = quantity(0.1, "log-odds", "taken away where a beam passes", ge=0)
    clamp: float = quantity(25.0, "log-odds", "log-odds are kept within plus and minus this", gt=0)
    publish: float = quantity(
        30.0, "s", "a `grid` message goes out each so many seconds of the log; 0: at the end only", ge=0
    )
    load: str = Field("", description="map file to start from")
    save: str = Field("", description="map file to write at the end, in the run's folder")
    fuse: bool = Field(True, description="false: localise in the loaded map without changing it")

    @field_validator("resolution")
    @classmethod
    def _coarse_to_fine(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if any(fine >= coarse for coarse, fine in itertools.pairwise(value)):
            raise ValueError("must run from coarse to fine, each smaller than the one before")
        return value
