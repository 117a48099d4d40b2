"""Cameras, video files and folders of images as streams of tracked points."""

from pathlib import Path

from pydantic import Field, field_validator

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Tracking(PluginConfig):
    """Calibration and tracking, of files and devices alike."""

    calibration: Path = Field(
        ...,
        description="YAML file with fx, fy, cx, cy [px] and, if the lens distorts, distortion [k1, k2, p1, p2, ...]",
    )
    features: int = quantity(100, "1", "points followed at once", ge=1, le=5000)
    distance: float = quantity(15.0, "px", "least distance between two new points", gt=0)
    quality: float = quantity(0.01, "1", "least corner quality relative to the best corner", gt=0, lt=1)
    window: int = quantity(21, "px", "side of the tracker's window", ge=5, le=101)
    round_trip: float = quantity(0.5, "px", "a point is lost when tracking it forth and back misses it by more", gt=0)


class Config(Tracking):
    """Pictures from files."""

    source: Path = Field(..., description="a video file, or a folder of images in the order of their names")
    rate: float = quantity(
        30.0, "Hz", "frames a second: of a folder's images, and of a video that does not say", gt=0, le=1000
    )


class LiveConfig(Tracking):
    """Pictures from a device."""

    device: int | str = Field(
        0, description="number of the camera, or its path (/dev/v4l/by-id/...) or the address of a network camera"
    )
    latency: float = quantity(
        0.0, "s", "from the exposure of a picture to its arrival: stamps are earlier by that", ge=0, le=2
    )
    size: tuple[int, int] | None = quantity(None, "px", "width and height to ask the camera for; none: its own")
    rate: float | None = quantity(None, "Hz", "frames a second to ask the camera for; none: its own", gt=0)

    @field_validator("device")
    @classmethod
    def _number_or_name(cls, value: int | str) -> int | str:
        number = int(value) if isinstance(value, int) or value.isdecimal() else None
        if number is None:
            if not value:
                raise ValueError("expected a number, a path or an address")
            return value
        if number < 0:
            raise ValueError("the number of a camera is 0 or more")
        return number


_OUTPUTS = {"features": Port("features", summary="tracked points, undistorted and normalised, with stable ids")}

MANIFEST = Manifest(
    name="camera",
    kind="driver",
    summary="points tracked in the pictures of a video file or a folder of images",
    impl="knotwork.plugins.drivers.camera.driver:Camera",
    config=Config,
    outputs=_OUTPUTS,
    extra="vision",
    requires=("cv2",),
    example="camera: {plugin: camera, source: images, calibration: camera.yaml}",
)

LIVE = Manifest(
    name="camera-live",
    kind="driver",
    summary="points tracked in the pictures of a connected camera",
    impl="knotwork.plugins.drivers.camera.live:LiveCamera",
    config=LiveConfig,
    outputs=_OUTPUTS,
    push=True,
    extra="vision",
    requires=("cv2",),
    example="camera: {plugin: camera-live, device: 0, calibration: camera.yaml}",
)


def knotwork_manifests() -> list[Manifest]:
    """Give both drivers."""
    return [MANIFEST, LIVE]
