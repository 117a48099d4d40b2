"""What planned paths keep clear of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Obstacle:
    """The convex hull of `points` (k, 2) [m] grown by `radius` [m]: a disc, a wall, a polygon."""

    points: NDArray[np.float64]
    radius: float = 0.0
