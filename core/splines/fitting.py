"""Least-squares fits: sparse normal equations of scattered data, with a penalty on roughness."""

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotwork.core.errors import InputError
from knotwork.core.splines.curve_kernels import normal_bands
from knotwork.core.splines.uniform import F64, UniformBasis

_UNDETERMINED = "the data do not determine all control points"
_HINT = "give a smoothness above 0 or a longer knot interval"


def fit_curve(basis: UniformBasis, n: int, tau: F64, values: F64, weights: F64, smoothness: float) -> F64:
    """Return n control points (n, dim); banded Cholesky.

    `tau` (k,) within the domain, `values` (k, dim), `weights` (k,).
    """
    bands, right = normal_bands(basis.origin, basis.step, basis.degree, n, tau, values, weights)
    if smoothness:
        bands += smoothness * basis.bands(n, min(2, basis.degree))
    return solve_banded(bands, right)


def solve_banded(bands: F64, right: F64) -> F64:
    """Solve a symmetric positive definite system of upper bands.

    Raises
    ------
    InputError
        If it is singular to working precision.
    """
    from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

    try:
        factor = cholesky_banded(bands)
    except LinAlgError as error:
        raise InputError(_UNDETERMINED, hint=_HINT) from error
    if factor[-1].min() < 1e-8 * np.sqrt(bands[-1].max()):
        raise InputError(_UNDETERMINED, hint=_HINT)
    return np.asarray(cho_solve_banded((factor, False), right), np.float64)


def fit_surface(
    along: UniformBasis,
    across: UniformBasis,
    points: F64,
    values: ArrayLike,
    weights: ArrayLike | None,
    smoothness: float,
) -> tuple[tuple[int, int], F64]:
    """Return (index of the first, block of control points) of a fit to scattered data; sparse LU.

    `points` (k, 2), `values` and `weights` (k,). The block holds all control points that act in the
    bounding box of the points.
    """
    from scipy.sparse import csr_array, kron
    from scipy.sparse.linalg import splu

    z = checked(values, (len(points),), "values")
    w = checked(1.0 if weights is None else weights, (len(points),), "weights")
    if not len(points) or not np.isfinite(points).all():
        raise InputError("no points" if not len(points) else "points are not all finite")
    i, wx = along.weights(points[:, 0])
    j, wy = across.weights(points[:, 1])
    first = int(i.min()), int(j.min())
    width = along.degree + 1
    n, m = int(i.max()) - first[0] + width, int(j.max()) - first[1] + width
    offsets = np.arange(width)
    rows = (i - first[0])[:, None, None] + offsets[:, None]
    columns = ((rows * m) + (j - first[1])[:, None, None] + offsets).reshape(len(points), -1)
    product = (wx[:, :, None] * wy[:, None, :]).reshape(len(points), -1)  # phi = b_x (x) b_y, row-major
    starts = np.arange(len(points) + 1) * width**2
    phi = csr_array((product.ravel(), columns.ravel(), starts), shape=(len(points), n * m))
    normal = phi.T @ (phi * w[:, None])
    if smoothness:
        for factor, a, b in penalty_terms(along, across, n, m, min(2, along.degree)):
            normal = normal + smoothness * factor * kron(a, b)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            factors = splu(normal.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    except (RuntimeError, Warning) as error:
        raise InputError(_UNDETERMINED, hint=_HINT) from error
    pivots = np.abs(factors.U.diagonal())
    if pivots.min() < 1e-14 * pivots.max():
        raise InputError(_UNDETERMINED, hint=_HINT)
    block = factors.solve(phi.T @ (w * z)).reshape(n, m)
    return first, block


def penalty_terms(along: UniformBasis, across: UniformBasis, n: int, m: int, order: int) -> list[tuple[int, Any, Any]]:
    """Return (binomial, integrals along x, integrals along y): the sum of their products is the roughness."""
    if order not in (1, 2) or order > along.degree:
        raise InputError(f"roughness of order {order}: expected 1 or 2, at most the degree {along.degree}")
    factors = (1, 1) if order == 1 else (1, 2, 1)
    return [
        (factor, along.gram(n, order - k), across.gram(m, k))  # order - k derivatives along x, k along y
        for k, factor in enumerate(factors)
    ]


def interpolate(basis: UniformBasis, targets: F64) -> F64:
    """Return control points of the least rough curve through `targets` at the knots of its domain.

    The minimum of c^T G c under B c = targets: a sparse saddle point system.
    """
    from scipy.sparse import bmat
    from scipy.sparse.linalg import spsolve

    k = len(targets)
    n = k - 1 + basis.degree
    low, high = basis.domain(n)
    through = basis.matrix(np.linspace(low, high, k), n)
    penalty = basis.gram(n, min(2, basis.degree))
    system = bmat([[penalty, through.T], [through, None]]).tocsc()
    right = np.vstack((np.zeros((n, targets.shape[1])), targets))
    return np.asarray(spsolve(system, right), np.float64).reshape(len(right), -1)[:n]


def solve_exactly(matrix: Any, values: F64) -> F64:
    """Return the least-squares solution of a sparse system of full rank that has an exact one."""
    from scipy.sparse.linalg import spsolve

    normal = (matrix.T @ matrix).tocsc()
    found = np.asarray(spsolve(normal, matrix.T @ values)).reshape(normal.shape[0], -1)
    correction = np.asarray(spsolve(normal, matrix.T @ (values - matrix @ found))).reshape(found.shape)
    return np.asarray(found + correction, np.float64)


def checked(given: Any, shape: tuple[int, ...], name: str) -> NDArray[np.float64]:
    """Return `given` as contiguous float64 of `shape`, a scalar repeated; InputError if it cannot be."""
    array = np.asarray(given, np.float64)
    if array.ndim and array.shape != shape:
        raise InputError(f"{name} of shape {array.shape}: expected {shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} are not all finite")
    return np.ascontiguousarray(np.broadcast_to(array, shape))
