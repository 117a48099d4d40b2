"""Do two sets of knots fit each other; are knots even."""

import numpy as np
from numpy.typing import NDArray

from knotwork.core.errors import InputError
from knotwork.core.splines.uniform import UniformBasis


def index_shift(mine: UniformBasis, theirs: UniformBasis) -> int:
    """Return the index in `mine` of function 0 of `theirs`.

    Raises
    ------
    InputError
        If degree or interval differ, or the knots lie between each other.
    """
    shift = (theirs.origin - mine.origin) / mine.step
    if (
        mine.degree != theirs.degree
        or abs(theirs.step - mine.step) > 1e-12 * mine.step
        or abs(shift - round(shift)) > 1e-6
    ):
        raise InputError(f"knots differ: {mine} and {theirs}", hint="refine or fit one of them to the other's knots")
    return round(shift)


def even_knots(knots: NDArray[np.float64]) -> tuple[float, float]:
    """Return first knot and interval of evenly spaced knots; InputError if they are not."""
    step = float(knots[-1] - knots[0]) / (len(knots) - 1)
    even = knots[0] + step * np.arange(len(knots))
    if step <= 0 or np.abs(knots - even).max() > 1e-9 * max(step, float(np.abs(knots).max()) * 1e-6):
        raise InputError("knots are not evenly spaced", hint="fit the values instead")
    return float(knots[0]), step
