"""A wheeled base backs up until its camera knows the depths, then drives to a goal view."""

from typing import Self

from pydantic import model_validator

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Config(PluginConfig):
    """Goal view, speeds, and when depths are good enough."""

    goal: dict[int, tuple[float, float]] = quantity(
        {},
        "1",
        "where each feature shall be seen, by its id, in normalised image coordinates; none: as in the first frame",
    )
    offset: float = quantity(0.08, "m", "how far the camera is ahead of the base's centre")
    v_max: float = quantity(0.20, "m/s", "largest speed; a TurtleBot3 Burger does 0.2097", gt=0)
    w_max: float = quantity(1.0, "rad/s", "largest yaw rate", gt=0)
    gain: float = quantity(1.0, "1", "of the drive to the goal pose", gt=0)
    back: float = quantity(0.3, "m", "longest way back", ge=0)
    pause: float = quantity(0.5, "s", "standing before the way back and, with a depth still uncertain, after it", ge=0)
    swing: float = quantity(0.2, "rad", "of the heading to both sides on the way back: shows points ahead", ge=0)
    deviation: float = quantity(
        0.015, "1", "depths are good when the relative standard deviation of each is below this", gt=0
    )
    tolerance: float = quantity(0.005, "1", "image error per coordinate (RMS) at which the base stops", gt=0)
    timeout: float = quantity(0.5, "s", "without depths for so long, the base stops", gt=0)
    needed: int = quantity(2, "1", "fewest features from which the goal pose is computed", ge=2)

    @model_validator(mode="after")
    def _no_or_two_points(self) -> Self:
        if len(self.goal) == 1:
            raise ValueError("goal: expected two features or more, or none for the view of the first frame")
        return self


MANIFEST = Manifest(
    name="active-base",
    kind="policy",
    summary="drives a wheeled base so that its camera's depths converge, then to a goal view",
    impl="knotwork.plugins.policies.active_base.policy:ActiveBase",
    config=Config,
    inputs={
        "depths": Port("depths", role="estimate", summary="with variances; a command goes out for each"),
        "odometry": Port("odometry", optional=True, summary="how far it really went; none: as commanded"),
    },
    outputs={
        "twist": Port("twist", summary="the command"),
        "state": Port("servo_state", summary="phase 1: backing up, 2: driving to the goal, 3: there"),
    },
    example='drive: {plugin: active-base, goal: {"0": [0.1, 0.0], "1": [-0.1, 0.0]}}',
)
