"""Where to start from when the prior is not to be trusted."""

import math

import numpy as np

from knotwork.core.messages import F64

_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
_TURN = 0.6180339887498949


def around(pose: F64, radius: float, turn: float, count: int) -> F64:
    """Return `count` poses (count, 3) spread evenly over a disc and an interval of headings.

    A sunflower spiral in the plane and a golden-ratio sequence in yaw: no two share a heading, any
    part of the list covers the whole. The first is `pose` itself.
    """
    k = np.arange(count)
    r = radius * np.sqrt(k / max(count - 1, 1))
    out = np.empty((count, 3))
    out[:, 0] = pose[0] + r * np.cos(k * _GOLDEN)
    out[:, 1] = pose[1] + r * np.sin(k * _GOLDEN)
    out[:, 2] = pose[2] + turn * (2.0 * ((k * _TURN + 0.5) % 1.0) - 1.0)
    return out
