"""Damped Gauss-Newton on one level: scan and prior in one cost, (7.17)-(7.22) with the errata.

cost(xi) = sum of the loss of whitened residuals + (xi - prior)^T I (xi - prior), I the prior's information.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.contracts import Alignment, Loss, NormalEquations
from knotwork.core.kernel import inlined, kernel
from knotwork.core.messages import F64

Array = NDArray[Any]

_SHORTER, _LONGER = 0.1, 3.0  # how much shorter or longer than the last a step may be
_COARSE = 4.0  # how much earlier a level stops that is not the finest


@dataclass(frozen=True, slots=True)
class Settings:
    """How to iterate; see the config."""

    loss: Loss
    scale: float
    iterations: int
    tolerance: float
    settle: tuple[float, float]
    damping: float


@dataclass(frozen=True, slots=True)
class Solution:
    """Where the iteration ended: cost with the prior's share, and the scan's equations there."""

    pose: F64
    cost: float
    equations: NormalEquations
    costs: tuple[float, ...]  # after each accepted step, the start first


@inlined
def _wrapped(angle: float) -> float:
    """Return the angle in [-pi, pi]."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@kernel
def prior_cost(pose: Array, prior: Array, information: Array) -> float:
    """Return (pose - prior)^T information (pose - prior), yaw wrapped."""
    dx = pose[0] - prior[0]
    dy = pose[1] - prior[1]
    da = _wrapped(pose[2] - prior[2])
    cost: float = (
        dx * (information[0, 0] * dx + 2.0 * (information[0, 1] * dy + information[0, 2] * da))
        + dy * (information[1, 1] * dy + 2.0 * information[1, 2] * da)
        + da * information[2, 2] * da
    )
    return cost


@kernel
def propose(
    pose: Array, H: Array, g: Array, prior: Array, information: Array, damping: float, out: Array
) -> tuple[float, float, float, float]:
    """Write the damped step's pose to `out`; return its length [m], turn [rad], the prior's cost there, the slope.

    Solves (A + damping diag(A)) d = -(g + I (pose - prior)), A = H + I, by Cholesky.
    """
    dx = pose[0] - prior[0]
    dy = pose[1] - prior[1]
    da = _wrapped(pose[2] - prior[2])
    b0 = -g[0] - information[0, 0] * dx - information[0, 1] * dy - information[0, 2] * da
    b1 = -g[1] - information[1, 0] * dx - information[1, 1] * dy - information[1, 2] * da
    b2 = -g[2] - information[2, 0] * dx - information[2, 1] * dy - information[2, 2] * da
    more = 1.0 + damping
    tiny = 1e-12
    l00 = math.sqrt(max((H[0, 0] + information[0, 0]) * more, tiny))
    l10 = (H[1, 0] + information[1, 0]) / l00
    l20 = (H[2, 0] + information[2, 0]) / l00
    l11 = math.sqrt(max((H[1, 1] + information[1, 1]) * more - l10 * l10, tiny))
    l21 = (H[2, 1] + information[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(max((H[2, 2] + information[2, 2]) * more - l20 * l20 - l21 * l21, tiny))
    y0 = b0 / l00
    y1 = (b1 - l10 * y0) / l11
    y2 = (b2 - l20 * y0 - l21 * y1) / l22
    d2 = y2 / l22
    d1 = (y1 - l21 * d2) / l11
    d0 = (y0 - l10 * d1 - l20 * d2) / l00
    out[0] = pose[0] + d0
    out[1] = pose[1] + d1
    out[2] = pose[2] + d2
    slope = -2.0 * (b0 * d0 + b1 * d1 + b2 * d2)
    return math.sqrt(d0 * d0 + d1 * d1), abs(d2), prior_cost(out, prior, information), slope


def solve(
    alignment: Alignment,
    level: int,
    start: F64,
    prior: F64,
    information: F64,
    settings: Settings,
    equations: NormalEquations | None = None,
) -> Solution:
    """Return the minimum near `start` (3,), where `equations` may be known; the cost never rises from step to step.

    Near the ridge of a wall a residual is large and its gradient small: a Gauss-Newton step is far too long
    there. The curvature that a step meets, taken or not, sets the damping of the next.
    """
    loss, scale = settings.loss, settings.scale
    settle_t, settle_r = settings.settle
    tolerance, damping = settings.tolerance, settings.damping
    if level < alignment.levels - 1:  # the next level takes it further
        settle_t, settle_r, tolerance = _COARSE * settle_t, _COARSE * settle_r, _COARSE * tolerance
    pose = start
    if equations is None:
        equations = alignment.normal_equations(pose, level, loss, scale)
    cost = equations.cost + prior_cost(pose, prior, information)
    costs = [cost]
    for _ in range(settings.iterations):
        candidate = np.empty(3)
        moved, turned, prior_share, slope = propose(
            pose, equations.H, equations.g, prior, information, damping, candidate
        )
        tried = alignment.normal_equations(candidate, level, loss, scale)
        new = tried.cost + prior_share
        small = moved < settle_t and turned < settle_r
        curvature = new - cost - slope  # twice: the parabola through both costs has its minimum at share
        share = -0.5 * slope / curvature if curvature > 0.0 else _LONGER
        damping = max((1.0 + damping) / min(max(share, _SHORTER), _LONGER) - 1.0, 0.0)
        if new < cost:
            done = small or cost - new < tolerance * cost
            pose, cost, equations = candidate, new, tried
            costs.append(cost)
            if done:
                break
        elif small:
            break
    return Solution(pose, cost, equations, tuple(costs))
