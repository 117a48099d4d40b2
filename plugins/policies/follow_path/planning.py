"""A way to a goal: searched on a grid, made smooth as a B-spline that provably keeps clear."""

import numpy as np

from knotwork.core.errors import KnotworkError
from knotwork.core.geometry import Pose2, transform_points
from knotwork.core.messages import F64
from knotwork.core.path_planning import plan_path
from knotwork.core.route_search import find_route
from knotwork.core.world.scene import World

_SPACING = 0.25  # m, of the knots
_SAMPLE = 0.02  # m


def way_to(goal: tuple[float, float], world: World, start: Pose2, clearance: float, node: str) -> F64:
    """Return points (k, 2) [m] of a smooth way in the world's frame; `goal` is given in the frame of `start`.

    Raises
    ------
    KnotworkError
        If there is no way, or an end is too near to something; names the node.
    """
    obstacles = world.obstacles()
    there = transform_points(start, np.array([goal]))[0]
    try:
        route = find_route(start[:2], there, obstacles, clearance)
        curve = plan_path(route, obstacles, clearance, spacing=_SPACING)
    except KnotworkError as error:
        error.where = error.where or f"node {node}"
        raise
    length = curve.length()
    return curve(curve.at_length(np.linspace(0.0, length, max(int(length / _SAMPLE), 2))))
