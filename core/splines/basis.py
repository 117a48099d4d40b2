"""Uniform B-spline basis: which control points act at a place, and with which weights.

Conventions, for degree d, first knot `origin` and knot interval `step`: basis function i (any integer)
is supported on [origin + i step, origin + (i + d + 1) step). At tau the d + 1 functions mu - d ... mu
act, mu = floor((tau - origin) / step), and weights come in that order. `t` in [0, 1) is the local
coordinate, the same quotient less its floor. Derivatives here are with respect to t: divide the first
by step, the second by step squared. Thesis equations (4.12) to (4.15), mended.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.kernel import inlined, kernel

Array = NDArray[Any]
Four = tuple[float, float, float, float]

MAX_DEGREE = 5


@inlined
def locate(tau: float, origin: float, step: float) -> tuple[int, float]:
    """Return (mu, t): the last acting function and the local coordinate, of one quotient and one floor."""
    quotient = (tau - origin) / step
    whole = np.floor(quotient)
    return int(whole), quotient - whole


@inlined
def cubic(t: float) -> Four:
    """Return the four cubic weights of control points mu - 3 ... mu."""
    u = 1.0 - t
    t2 = t * t
    u2 = u * u
    return (
        u2 * u * (1.0 / 6.0),
        (2.0 / 3.0) - t2 + 0.5 * t2 * t,
        (2.0 / 3.0) - u2 + 0.5 * u2 * u,
        t2 * t * (1.0 / 6.0),
    )


@inlined
def cubic_slope(t: float) -> Four:
    """Return the derivatives of the four cubic weights with respect to t."""
    u = 1.0 - t
    return -0.5 * u * u, t * (1.5 * t - 2.0), u * (2.0 - 1.5 * u), 0.5 * t * t


@inlined
def cubic_bend(t: float) -> Four:
    """Return the second derivatives of the four cubic weights with respect to t."""
    return 1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t


@kernel
def fill_weights(t: float, degree: int, out: Array) -> None:
    """Write the degree + 1 weights at t into `out` (Cox-de Boor on uniform knots)."""
    out[0] = 1.0
    for p in range(1, degree + 1):
        inverse = 1.0 / p
        carried = 0.0
        for r in range(p):
            share = out[r] * inverse
            out[r] = carried + (1.0 - t + r) * share
            carried = (t + p - 1 - r) * share
        out[p] = carried


@kernel
def fill_derivative(t: float, degree: int, order: int, out: Array) -> None:
    """Write the `order`-th derivatives with respect to t of the degree + 1 weights into `out`.

    d/dt of degree d is the backward difference of the degree d - 1 weights; zeros if order > degree.
    """
    if order > degree:
        for r in range(degree + 1):
            out[r] = 0.0
        return
    fill_weights(t, degree - order, out)
    for p in range(degree - order + 1, degree + 1):
        out[p] = out[p - 1]
        for r in range(p - 1, 0, -1):
            out[r] = out[r - 1] - out[r]
        out[0] = -out[0]


@kernel
def fill_rows(t: Array, degree: int, order: int, out: Array) -> None:
    """Write `fill_derivative` of each t (n,) into the rows of `out` (n, degree + 1)."""
    for k in range(t.shape[0]):
        fill_derivative(t[k], degree, order, out[k])
