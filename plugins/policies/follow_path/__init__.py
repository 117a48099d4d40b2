"""Follows a path of waypoints by pure pursuit."""

from typing import Self

from pydantic import Field, model_validator

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class Config(PluginConfig):
    """Where to drive: `waypoints` in the map's frame, a path of a world moved to that frame, or a `goal` in it.

    To a goal a smooth way is planned among the world's obstacles, from where the robot starts.
    """

    waypoints: tuple[tuple[float, float], ...] = quantity((), "m", "points [x, y] in the map's frame")
    world: str = Field("", description="world whose path is followed: a shipped name or a YAML file")
    path: str = Field("tour", description="name of the world's path")
    goal: tuple[float, float] | None = quantity(
        None, "m", "point [x, y] in the map's frame to plan a way to, among the obstacles of the world"
    )
    clearance: float = quantity(0.25, "m", "least distance of a planned way from all obstacles", gt=0)
    start: tuple[float, float, float] | None = quantity(
        None, "m, m, rad", "pose in the world that is the map's origin; none: the world's start"
    )
    loop: bool = Field(False, description="go on from the last waypoint to the first, for ever")
    speed: float = quantity(0.2, "m/s", "speed on straight stretches", gt=0)
    yaw_rate: float = quantity(1.0, "rad/s", "fastest turning", gt=0)
    lateral: float = quantity(0.1, "m/s^2", "lateral acceleration in curves, which slows them down", gt=0)
    braking: float = quantity(0.3, "m/s^2", "deceleration towards the end of the path", gt=0)
    look_ahead: float = quantity(0.25, "m", "distance of the point on the path that is steered at", gt=0)
    turn_above: float = quantity(
        1.0, "rad", "a steering point farther off the heading is first turned to on the spot", gt=0, lt=3.14
    )
    tolerance: float = quantity(0.02, "m", "the path ends this near its last point", gt=0)

    @model_validator(mode="after")
    def _one_path(self) -> Self:
        if bool(self.waypoints) == bool(self.world):
            raise ValueError("give either waypoints or a world with a path")
        if self.waypoints and len(self.waypoints) < 2:
            raise ValueError("waypoints must have at least two points")
        if self.goal is not None and (not self.world or self.loop):
            raise ValueError("a goal needs a world to plan in, and no loop")
        return self


MANIFEST = Manifest(
    name="follow-path",
    kind="policy",
    summary="drives along waypoints or a planned way by pure pursuit, on the predicted pose",
    impl="knotwork.plugins.policies.follow_path.policy:FollowPath",
    config=Config,
    inputs={
        "pose": Port("pose", role="prior", summary="a command goes out for each"),
        "estimate": Port("pose", role="estimate", optional=True, summary="while it says lost, the robot stands"),
    },
    outputs={"twist": Port("twist", summary="the command")},
    example="drive: {plugin: follow-path, world: apartment, path: tour}",
)
