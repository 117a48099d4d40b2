"""A simulated planar lidar whose beams are measured one after another while the robot moves."""

import numpy as np

from knotwork.core.messages import F64, Scan
from knotwork.core.world.motion import Motion
from knotwork.core.world.parameters import LidarParameters
from knotwork.core.world.raycast import RayCaster
from knotwork.core.world.seeding import generator


class SimulatedLidar:
    """Casts each beam from the pose of its own instant and adds the errors of the sensor model.

    Parameters
    ----------
    parameters
        Beams, timing, range and errors.
    obstacles
        The world.
    seed
        Of all its errors.
    """

    def __init__(self, parameters: LidarParameters, obstacles: RayCaster, seed: int) -> None:
        self.parameters = parameters
        self._obstacles = obstacles
        offset, increment = parameters.timing
        beams = np.arange(parameters.beams, dtype=np.float64)
        self._angles: F64 = parameters.angle_min + parameters.angle_increment * beams
        self._offsets: F64 = offset + increment * beams
        self._noise = generator(seed, "lidar")
        self.scale = float(1.0 + parameters.accuracy * generator(seed, "range").standard_normal())

    def scan(self, motion: Motion, start: int, scan_id: int) -> Scan:
        """Return the turn that began at `start` [ns], the stamp of its first-measured beam."""
        p = self.parameters
        offset, increment = p.timing
        ranges = self.measure(motion.poses(start, self._offsets), self._angles)
        return Scan(
            stamp=start,
            scan_id=scan_id,
            ranges=ranges.astype(np.float32),
            angle_min=p.angle_min,
            angle_increment=p.angle_increment,
            range_min=p.range_min,
            range_max=p.range_max,
            mount=p.mount,
            time_offset=offset,
            time_increment=increment,
        )

    def measure(self, poses: F64, angles: F64) -> F64:
        """Return the readings of single beams.

        Parameters
        ----------
        poses : shape (n, 3)
            Of the robot in the world, each at its beam's instant.
        angles : shape (n,)
            Of the beams in the sensor frame [rad].

        Returns
        -------
        shape (n,) [m], `inf` beyond `range_max` (no return), NaN below `range_min` (invalid)
        """
        p = self.parameters
        mx, my, myaw = p.mount
        yaw = poses[:, 2]
        c, s = np.cos(yaw), np.sin(yaw)
        origins = np.column_stack((poses[:, 0] + c * mx - s * my, poses[:, 1] + s * mx + c * my))
        heading = yaw + (angles + myaw)
        directions = np.column_stack((np.cos(heading), np.sin(heading)))
        # A reading may come out short by noise: look somewhat farther than the sensor reaches.
        true = self._obstacles.cast(origins, directions, 1.5 * p.range_max)
        a, b = p.precision
        white = self._noise.standard_normal(len(true))
        with np.errstate(invalid="ignore"):  # inf * 0
            ranges = self.scale * true + (a * true + b) * white
        ranges[~(ranges <= p.range_max)] = np.inf
        ranges[ranges < p.range_min] = np.nan
        return ranges
