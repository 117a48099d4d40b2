"""The uniform B-spline basis as an object: knots, weights, matrices, integrals."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotwork.core.errors import InputError
from knotwork.core.splines.basis import MAX_DEGREE, fill_derivative, fill_rows

F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class UniformBasis:
    """Basis functions on evenly spaced, unclamped knots.

    Function i (any integer) is supported on [origin + i step, origin + (i + degree + 1) step).

    Parameters
    ----------
    degree
        1 to 5; derivatives up to degree - 1 are continuous.
    origin
        First knot, in the unit of the parameter.
    step
        Knot interval.
    """

    degree: int = 3
    origin: float = 0.0
    step: float = 1.0

    def __post_init__(self) -> None:
        if not 1 <= self.degree <= MAX_DEGREE:
            raise InputError(f"degree {self.degree}: expected 1 to {MAX_DEGREE}")
        if not (np.isfinite(self.step) and self.step > 0 and np.isfinite(self.origin)):
            raise InputError(f"knots from {self.origin} every {self.step}: expected finite numbers, interval above 0")

    def knots(self, n: int) -> F64:
        """Return the n + degree + 1 knots of n control points."""
        return self.origin + self.step * np.arange(n + self.degree + 1, dtype=np.float64)

    def domain(self, n: int) -> tuple[float, float]:
        """Return where n control points define a spline: the basis sums to one there."""
        return self.origin + self.degree * self.step, self.origin + n * self.step

    def locate(self, tau: ArrayLike) -> tuple[NDArray[np.int64], F64]:
        """Return the last acting function mu and the local coordinate t in [0, 1), (4.12) and (4.15) mended."""
        quotient = (np.asarray(tau, np.float64) - self.origin) / self.step
        whole = np.floor(quotient)
        return whole.astype(np.int64), quotient - whole

    def weights(self, tau: ArrayLike, order: int = 0) -> tuple[NDArray[np.int64], F64]:
        """Return first acting functions (n,) and the weights (n, degree + 1) of it and those after it.

        `order` gives derivatives with respect to tau; (4.13), (4.14) for the cubic.
        """
        mu, t = self.locate(np.atleast_1d(np.asarray(tau, np.float64)))
        out = np.empty((len(t), self.degree + 1))
        fill_rows(t, self.degree, order, out)
        return mu - self.degree, out / self.step**order

    def matrix(self, tau: ArrayLike, n: int, order: int = 0) -> Any:
        """Return the sparse matrix (len(tau), n) that turns n control points into values (or derivatives).

        Raises
        ------
        InputError
            If a tau lies outside the domain of n control points.
        """
        from scipy.sparse import csr_array

        tau = inside(self, np.atleast_1d(np.asarray(tau, np.float64)), n)
        quotient = (tau - self.origin) / self.step
        mu = np.clip(np.floor(quotient).astype(np.int64), self.degree, n - 1)  # the last interval is closed
        first, weights = mu - self.degree, np.empty((len(tau), self.degree + 1))
        fill_rows(quotient - mu, self.degree, order, weights)
        weights /= self.step**order
        columns = first[:, None] + np.arange(self.degree + 1)
        starts = np.arange(len(tau) + 1) * (self.degree + 1)
        return csr_array((weights.ravel(), columns.ravel(), starts), shape=(len(tau), n))

    def bands(self, n: int, order: int) -> F64:
        """Return the upper bands (degree + 1, n) of `gram`, as scipy.linalg.solveh_banded reads them."""
        d = self.degree
        cell = _cell(d, order) * self.step ** (1 - 2 * order)
        out = np.zeros((d + 1, n))
        for a in range(d + 1):
            for b in range(a, d + 1):
                out[d - (b - a), b : n - d + b] += cell[a, b]
        return out

    def gram(self, n: int, order: int = 2) -> Any:
        """Return the sparse (n, n) integrals of products of `order`-th derivatives over the domain, exact."""
        from scipy.sparse import dia_array

        d = self.degree
        bands = self.bands(n, order)
        low = np.zeros_like(bands)
        for k in range(1, d + 1):  # the mirror image: entry (j - k, j) of band k goes to column j - k
            low[d - k, : n - k] = bands[d - k, k:]
        data = np.vstack((bands, low[:d]))
        return dia_array((data, [*range(d, -1, -1), *range(-d, 0)]), shape=(n, n)).tocsr()

    def refined(self, factor: int) -> "UniformBasis":
        """Return the basis with `factor` knots for one and the same first knot."""
        return replace(self, step=self.step / factor)


def inside(basis: UniformBasis, tau: F64, n: int) -> F64:
    """Return tau moved onto the domain if a billionth of an interval outside; an error if more."""
    low, high = basis.domain(n)
    slack = 1e-9 * basis.step
    wrong = ~((tau >= low - slack) & (tau <= high + slack))
    if n <= basis.degree or wrong.any():
        what = f"{int(wrong.sum())} of {len(tau)} parameters" if len(tau) else "the parameters"
        raise InputError(f"{what} lie outside [{low:g}, {high:g}], where {n} control points define a spline")
    return np.clip(tau, low, high)


@cache
def _cell(degree: int, order: int) -> F64:
    """Return the integrals over one unit interval of products of weights' derivatives (Gauss, exact)."""
    nodes, factors = np.polynomial.legendre.leggauss(degree + 1)
    total = np.zeros((degree + 1, degree + 1))
    row = np.empty(degree + 1)
    for node, factor in zip(nodes, factors, strict=True):
        fill_derivative(0.5 * (float(node) + 1.0), degree, order, row)
        total += 0.5 * factor * np.outer(row, row)
    return total


@cache
def refinement_mask(degree: int, factor: int) -> F64:
    """Return the weights with which a function is the sum of functions of `factor` times denser knots.

    Function i of the coarse basis is the sum over k of mask[k] times function factor i + k of the fine one.
    """
    mask = np.ones(1)
    for _ in range(degree + 1):
        mask = np.convolve(mask, np.ones(factor))
    return mask / float(factor) ** degree
