"""From one knot interval to a whole fraction of it and back, for curves and tiled surfaces.

A function of the coarse basis is a sum of fine ones: function i equals the sum over k of mask[k] times
fine function factor i + k, both bases having the same first knot.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.errors import InputError
from knotwork.core.splines.fitting import solve_banded
from knotwork.core.splines.tiles import SIDE, TiledArray
from knotwork.core.splines.uniform import F64, refinement_mask

Values = NDArray[Any]


def refine_control(control: Values, degree: int, factor: int) -> tuple[int, F64]:
    """Return (index of the first, fine control points) of a curve: those that act on its domain."""
    _check(factor)
    mask = refinement_mask(degree, factor)
    first = degree * (factor - 1)
    return first, _spread(control, mask, factor)[first : factor * len(control)]


def coarsen_control(control: Values, degree: int, factor: int) -> F64:
    """Return the coarse control points whose refinement is nearest in the sum of squares.

    The inverse of `refine_control`: the first fine control point has index degree (factor - 1).
    """
    _check(factor)
    first = degree * (factor - 1)
    count = (first + len(control) - 1) // factor + 1
    matrix = _matrix(count, degree, factor)[first : first + len(control)]
    return _least_squares(matrix, control, degree)


def refine_surface(control: TiledArray, degree: int, factor: int) -> TiledArray:
    """Return the fine control points of a surface, tile by tile."""
    _check(factor)
    mask = refinement_mask(degree, factor)
    made = TiledArray(control.dtype, control.fill)
    tail = len(mask) - factor  # fine control points beyond the tile's own part that it reaches
    reach = degree + 1
    tiles = {(int(a), int(b)) for a, b in control.claimed()[0]}
    for a, b in tiles:
        for da, db in ((0, 0), (1, 0), (0, 1), (1, 1)):
            if (da or db) and (a + da, b + db) in tiles:
                continue
            i, j = (a + da) * SIDE, (b + db) * SIDE
            rows = min(tail, factor * SIDE) if da else factor * SIDE
            columns = min(tail, factor * SIDE) if db else factor * SIDE
            if not rows or not columns:
                continue
            block = control.block(i - reach, j - reach, i + SIDE, j + SIDE).astype(np.float64) - control.fill
            skip = factor * reach
            fine = _spread(_spread(block, mask, factor).T, mask, factor).T[skip:, skip:]
            made.write_block(factor * i, factor * j, fine[:rows, :columns] + control.fill)
    return made


def coarsen_surface(control: TiledArray, degree: int, factor: int) -> TiledArray:
    """Return the coarse control points whose refinement is nearest in the sum of squares."""
    _check(factor)
    made = TiledArray(control.dtype, control.fill)
    i0, j0, i1, j1 = control.bounds()
    if i0 == i1:
        return made
    block = control.block(i0, j0, i1, j1).astype(np.float64) - control.fill
    i, half = _coarsen_padded(block, i0, degree, factor)
    j, whole = _coarsen_padded(half.T, j0, degree, factor)
    for a, b in control.claimed()[0]:  # memory only where there was some
        made.reserve_box(
            *(int(c) * SIDE // factor for c in (a, b)), *(-(-(int(c) + 1) * SIDE // factor) for c in (a, b))
        )
    made.write_block(i, j, whole.T + control.fill, claim=False)
    return made


def _coarsen_padded(block: F64, start: int, degree: int, factor: int) -> tuple[int, F64]:
    """Coarsen along the first axis; `start` is the index of the first row, all rows not given are zero."""
    width = len(refinement_mask(degree, factor))
    low, high = -((width - 1 - start) // factor), (start + len(block) - 1) // factor
    matrix = _matrix(high - low + 1, degree, factor)
    padded = np.zeros((matrix.shape[0], block.shape[1]))
    padded[start - factor * low : start - factor * low + len(block)] = block
    return low, _least_squares(matrix, padded, degree)


def _spread(control: Values, mask: F64, factor: int) -> F64:
    """Return all fine control points (factor (n - 1) + len(mask), ...) of n coarse ones, along the first axis."""
    n = len(control)
    fine = np.zeros((factor * (n - 1) + len(mask), control.shape[1]))
    for k, weight in enumerate(mask):
        fine[k : k + factor * (n - 1) + 1 : factor] += weight * control
    return fine


def _matrix(n: int, degree: int, factor: int) -> Any:
    """Return `_spread` of n control points as a sparse matrix."""
    from scipy.sparse import csr_array

    mask = refinement_mask(degree, factor)
    coarse = np.repeat(np.arange(n), len(mask))
    fine = factor * coarse + np.tile(np.arange(len(mask)), n)
    return csr_array((np.tile(mask, n), (fine, coarse)), shape=(factor * (n - 1) + len(mask), n))


def _least_squares(matrix: Any, fine: Values, degree: int) -> F64:
    normal = (matrix.T @ matrix).tocsr()
    n = normal.shape[0]
    bands = np.zeros((min(degree + 1, n), n))
    for k in range(len(bands)):
        bands[len(bands) - 1 - k, k:] = normal.diagonal(k)
    return solve_banded(bands, matrix.T @ fine)


def _check(factor: int) -> None:
    if factor != int(factor) or factor < 1:
        raise InputError(f"refinement factor {factor}: expected a whole number from 1 on")
