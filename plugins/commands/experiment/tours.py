"""Scans of a simulated lidar along a path of a world file, at poses that are known exactly."""

import numpy as np

from knotwork.core.messages import F64, Scan
from knotwork.core.world.files import load_world
from knotwork.core.world.lidar import SimulatedLidar
from knotwork.core.world.parameters import LidarParameters
from knotwork.core.world.raycast import RayCaster


def poses_along(points: F64, step: float) -> F64:
    """Return poses (n, 3) every `step` [m] along waypoints (k, 2), looking ahead."""
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    ends = np.concatenate(([0.0], np.cumsum(lengths)))
    at = np.arange(0.0, ends[-1], step)
    leg = np.minimum(np.searchsorted(ends, at, side="right") - 1, len(legs) - 1)
    share = (at - ends[leg]) / lengths[leg]
    yaw = np.arctan2(legs[leg, 1], legs[leg, 0])
    return np.column_stack((points[leg] + share[:, None] * legs[leg], yaw))


def scans_along(world: str, path: str, step: float, seed: int) -> list[tuple[Scan, F64]]:
    """Return scans with their poses: an LDS-01 with its noise (3.16), without its scale error, the robot at rest."""
    scene = load_world(world)
    lidar = LidarParameters(sweep=0.0, accuracy=0.0)
    sensor = SimulatedLidar(lidar, RayCaster(scene), seed)
    angles: F64 = lidar.angle_min + lidar.angle_increment * np.arange(lidar.beams, dtype=np.float64)
    found = []
    for number, pose in enumerate(poses_along(scene.paths[path], step)):
        ranges = sensor.measure(np.tile(pose, (lidar.beams, 1)), angles)
        scan = Scan(
            stamp=number * 200_000_000,
            scan_id=number,
            ranges=ranges.astype(np.float32),
            angle_min=lidar.angle_min,
            angle_increment=lidar.angle_increment,
            range_min=lidar.range_min,
            range_max=lidar.range_max,
            mount=lidar.mount,
        )
        found.append((scan, pose))
    return found
