"""The policy around pure pursuit."""

import math

from knotwork.core.contracts import Context, Policy
from knotwork.core.errors import InputError
from knotwork.core.geometry import inverse, transform_points
from knotwork.core.messages import Pose, Twist
from knotwork.core.world.files import load_world
from knotwork.plugins.policies.follow_path import Config
from knotwork.plugins.policies.follow_path.pursuit import Limits, Polyline, Pursuit


class FollowPath(Policy):
    """Answers every predicted pose with a command; stands while the pose is lost or not a number."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: Config = context.config
        limits = Limits(**{name: getattr(config, name) for name in Limits.__dataclass_fields__})
        self.pursuit = Pursuit(_path(config, context.name), limits)
        self._told = False
        self._lost = False

    def on_estimate(self, message: Pose) -> None:
        """Note whether the localiser believes its pose."""
        if message.lost != self._lost:
            text = "the pose is lost: waiting" if message.lost else "the pose is found: going on"
            self.context.report("info", text)
        self._lost = message.lost

    def on_pose(self, message: Pose) -> None:
        """Emit the command for a pose."""
        x, y, yaw = message.pose.tolist()
        stand = message.lost or self._lost or not math.isfinite(x + y + yaw)
        v, w = (0.0, 0.0) if stand else self.pursuit.command([x, y, yaw])
        if self.pursuit.done and not self._told:
            self._told = True
            self.context.report("info", f"end of the path, {self.pursuit.path.length:.1f} m")
        self.context.emit("twist", Twist(stamp=self.context.now(), vx=v, wz=w))

    def statistics(self) -> dict[str, float]:
        """Say how far along the path the robot came [m]."""
        return {"progress_m": self.pursuit.progress, "path_m": self.pursuit.path.length}


def _path(config: Config, node: str) -> Polyline:
    if config.waypoints:
        points: list[list[float]] = [list(p) for p in config.waypoints]
    else:
        world = load_world(config.world)
        start = config.start or world.start
        if config.goal is not None:
            # Only planning needs compiled kernels, which take a second to load.
            from knotwork.plugins.policies.follow_path.planning import way_to

            way = way_to(config.goal, world, start, config.clearance, node)
            points = transform_points(inverse(start), way).tolist()
        elif config.path in world.paths:
            points = transform_points(inverse(start), world.paths[config.path]).tolist()
        else:
            raise InputError(
                f"the world {world.name} has no path {config.path!r}",
                where=f"node {node}",
                hint=f"it has: {', '.join(world.paths) or 'none'}",
            )
    try:
        return Polyline(points, config.loop)
    except ValueError as error:
        raise InputError(str(error), where=f"node {node}") from error
