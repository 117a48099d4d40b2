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
    return (
        dx * (information[0, 0] * dx + 2.0 * (information[0, 1] * dy + information[0, 2] * da))
        + dy * (information[1, 1] * dy + 2.0 * information[1, 2] * da)
        + da * information[2, 2] * da
    )


@kernel
def propose(
    pose: Array, H: Array, g: Array, prior: Array, information: Array, damping: float, out: Array
) -> tuple[float, float, float]:
    """Write the damped step's pose to `out`; return the step's length [m], turn [rad] and prior's cost there.

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
    return math.sqrt(d0 * d0 + d1 * d1), abs(d2), prior_cost(out, prior, information)


@kernel
def posterior(
    pose: Array, H: Array, g: Array, information: Array, covariance: Array, mean: Array
) -> None:
    """Write the covariance (H + information)^-1 (3, 3) and the mean (3,) that the scan alone has.

    Directions of which the scan says nothing get its pose's mean and, without a prior, a large variance.
    """
    _invert(H, information, 1e-9, covariance)
    alone = np.empty((3, 3))
    _invert(H, np.zeros((3, 3)), 1e-6, alone)
    for i in range(3):
        mean[i] = pose[i] - alone[i, 0] * g[0] - alone[i, 1] * g[1] - alone[i, 2] * g[2]


@inlined
def _invert(A: Array, B: Array, ridge: float, out: Array) -> None:
    """Write (A + B + ridge diag)^-1, by Cholesky."""
    more = 1.0 + ridge
    tiny = 1e-6
    l00 = math.sqrt((A[0, 0] + B[0, 0]) * more + tiny)
    l10 = (A[1, 0] + B[1, 0]) / l00
    l20 = (A[2, 0] + B[2, 0]) / l00
    l11 = math.sqrt(max((A[1, 1] + B[1, 1]) * more + tiny - l10 * l10, tiny))
    l21 = (A[2, 1] + B[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(max((A[2, 2] + B[2, 2]) * more + tiny - l20 * l20 - l21 * l21, tiny))
    i00 = 1.0 / l00
    i11 = 1.0 / l11
    i22 = 1.0 / l22
    i10 = -l10 * i00 * i11
    i21 = -l21 * i11 * i22
    i20 = (l10 * l21 * i11 - l20) * i00 * i22
    out[0, 0] = i00 * i00 + i10 * i10 + i20 * i20
    out[1, 1] = i11 * i11 + i21 * i21
    out[2, 2] = i22 * i22
    out[0, 1] = out[1, 0] = i10 * i11 + i20 * i21
    out[0, 2] = out[2, 0] = i20 * i22
    out[1, 2] = out[2, 1] = i21 * i22


def solve(
    alignment: Alignment, level: int, start: F64, prior: F64, information: F64, settings: Settings
) -> Solution:
    """Return the minimum near `start` (3,); the cost never rises from step to step."""
    loss, scale = settings.loss, settings.scale
    settle_t, settle_r = settings.settle
    pose = start
    equations = alignment.normal_equations(pose, level, loss, scale)
    cost = equations.cost + prior_cost(pose, prior, information)
    costs = [cost]
    damping = settings.damping
    for _ in range(settings.iterations):
        candidate = np.empty(3)
        moved, turned, prior_share = propose(
            pose, equations.H, equations.g, prior, information, damping, candidate
        )
        tried = alignment.normal_equations(candidate, level, loss, scale)
        new = tried.cost + prior_share
        small = moved < settle_t and turned < settle_r
        if new < cost:
            done = small or cost - new < settings.tolerance * cost
            pose, cost, equations = candidate, new, tried
            costs.append(cost)
            damping *= 0.2
            if done:
                break
        elif small:
            break
        else:
            damping = max(8.0 * damping, 1e-2)
    return Solution(pose, cost, equations, tuple(costs))
