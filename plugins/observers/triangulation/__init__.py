"""Depths by triangulation from known camera poses: the geometric baseline."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Config(PluginConfig):
    """Which views are kept and how they are combined."""

    method: Literal["rays", "dlt"] = Field("rays", description="nearest point to the rays, or direct linear transform")
    views: int = quantity(10, "views", "of each feature; the oldest in between is dropped first", ge=2, le=1000)
    baseline: float = quantity(0.005, "m", "a view is kept when the camera has moved this far since the last one", ge=0)
    condition: float = quantity(1e6, "1", "no depth from a geometry with a larger condition number", gt=1)


MANIFEST = Manifest(
    name="triangulation",
    kind="observer",
    summary="inverse depth of each feature by two-view or n-view triangulation from camera poses",
    impl="knotwork.plugins.observers.triangulation.node:Triangulation",
    config=Config,
    inputs={
        "camera": Port("camera_pose", summary="pose of the camera, given before the features of the same frame"),
        "features": Port("features", summary="tracked points"),
    },
    outputs={"depths": Port("depths", role="estimate", summary="NaN where the geometry does not give a depth")},
    example="depths: {plugin: triangulation, method: dlt}",
)
