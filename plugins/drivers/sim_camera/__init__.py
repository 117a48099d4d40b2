"""A simulated camera among points: free in space, or carried by a wheeled base."""

from typing import Self

from pydantic import Field, model_validator

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity

Twist6 = tuple[float, float, float, float, float, float]


class Hidden(PluginConfig):
    """Points that something hides for a while."""

    ids: tuple[int, ...] = quantity(..., "1", "which points, by their ids")
    start: float = quantity(..., "s", "time of the run", ge=0)
    end: float = quantity(..., "s", "time of the run", gt=0)


class Config(PluginConfig):
    """The world's frame is the camera's first optical frame: x right, y down, z forward."""

    points: tuple[tuple[float, float, float], ...] = quantity(
        ..., "m", "points of the scene; their ids are 0, 1, ...", min_length=1
    )
    rate: float = quantity(20.0, "Hz", "frames a second; a command holds between two", gt=0, le=1000)
    duration: float = quantity(15.0, "s", "length of the run", gt=0)
    view: tuple[float, float] | None = quantity(
        None, "1", "half width and half height of the image in normalised coordinates; none: all that is in front"
    )
    nearest: float = quantity(0.05, "m", "a point nearer to the camera plane is not seen", gt=0)
    noise: float = quantity(0.0, "1", "standard deviation of a normalised image coordinate", ge=0)
    loss: float = quantity(0.0, "1", "probability that a point is missed in a frame", ge=0, lt=1)
    hidden: tuple[Hidden, ...] = Field((), description="points that are hidden for a while")
    twist_scale: Twist6 = quantity((1.0, 1.0, 1.0, 1.0, 1.0, 1.0), "1", "true over commanded velocity, for each axis")
    twist_noise: tuple[float, float] = quantity(
        (0.0, 0.0), "m/s, rad/s", "standard deviations of each axis of the true velocity, new in each frame"
    )
    base_offset: float | None = quantity(
        None, "m", "carried by a base, this far ahead of its centre: `twist` moves it; none: `camera_twist` does"
    )
    command_timeout: float = quantity(0.5, "s", "an older command is dropped and the camera stands", gt=0)

    @model_validator(mode="after")
    def _something_to_see(self) -> Self:
        if not any(z > self.nearest for _, _, z in self.points):
            raise ValueError(f"no point is in front of the camera: z must exceed {self.nearest} m")
        return self


MANIFEST = Manifest(
    name="sim-camera",
    kind="driver",
    summary="simulated camera that sees points of a 3D scene and moves as it is told",
    impl="knotwork.plugins.drivers.sim_camera.driver:SimCamera",
    config=Config,
    inputs={
        "command": Port("camera_twist", optional=True, summary="the camera's velocity"),
        "twist": Port("twist", optional=True, summary="the base's velocity, with `base_offset`"),
    },
    outputs={
        "applied": Port("camera_twist", summary="the command that held since the last frame, without its errors"),
        "camera": Port("camera_pose", role="truth", summary="true pose"),
        "truth": Port("depths", role="truth", summary="true image and inverse depth of the points in view"),
        "features": Port("features", summary="the points in view, with noise"),
    },
    closed_loop=True,
    example="camera: {plugin: sim-camera, points: [[0.1, 0.1, 1.5], [-0.1, 0.1, 1.2]], inputs: {command: servo.twist}}",
)
