"""Where to start from when the prior is not to be trusted."""

import math

import numpy as np

from knotwork.core.messages import F64

_ROOT = 1.2207440846057596  # of x^4 = x + 1: its powers give the most even sequence in three dimensions


def around(pose: F64, radius: float, turn: float, count: int) -> F64:
    """Return `count` poses (count, 3) spread evenly over a disc and an interval of headings.

    The additive recurrence of three numbers that are the least alike: any part of the list covers the whole,
    and no heading goes with a bearing. The first is `pose` itself.

    Parameters
    ----------
    radius, turn
        Of the disc [m], and to either side of the heading [rad].
    """
    k = np.arange(count)
    u, v, w = ((k * _ROOT**-power + 0.5) % 1.0 for power in (1, 2, 3))
    out = np.empty((count, 3))
    out[:, 0] = pose[0] + radius * np.sqrt(u) * np.cos(2.0 * math.pi * v)
    out[:, 1] = pose[1] + radius * np.sqrt(u) * np.sin(2.0 * math.pi * v)
    out[:, 2] = pose[2] + turn * (2.0 * w - 1.0)
    out[:1] = pose
    return out
