"""A camera, a video file or a folder of images as a stream of tracked points."""

from pathlib import Path

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Config(PluginConfig):
    """Source, calibration and tracking."""

    source: int | Path = Field(..., description="number of a camera, a video file, or a folder of images by name")
    calibration: Path = Field(
        ...,
        description="YAML file with fx, fy, cx, cy [px] and, if the lens distorts, distortion [k1, k2, p1, p2, ...]",
    )
    rate: float = quantity(
        30.0, "Hz", "frames a second: of a folder's images, and of a video that does not say", gt=0, le=1000
    )
    features: int = quantity(100, "1", "points followed at once", ge=1, le=5000)
    distance: float = quantity(15.0, "px", "least distance between two new points", gt=0)
    quality: float = quantity(0.01, "1", "least corner quality relative to the best corner", gt=0, lt=1)
    window: int = quantity(21, "px", "side of the tracker's window", ge=5, le=101)
    round_trip: float = quantity(0.5, "px", "a point is lost when tracking it forth and back misses it by more", gt=0)


MANIFEST = Manifest(
    name="camera",
    kind="driver",
    summary="points tracked in the pictures of a camera, a video or a folder of images",
    impl="knotwork.plugins.drivers.camera.driver:Camera",
    config=Config,
    outputs={"features": Port("features", summary="tracked points, undistorted and normalised, with stable ids")},
    extra="vision",
    requires=("cv2",),
    example="camera: {plugin: camera, source: images, calibration: camera.yaml}",
)
