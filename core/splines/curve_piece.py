"""The four control points that act at one place of a cubic curve in the plane, in four-wide arithmetic."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from knotwork.core.kernel import inlined
from knotwork.core.splines.basis import Array
from knotwork.core.splines.vectors import (
    FLAGS,
    LANE,
    SLOPES,
    WEIGHTS,
    Values,
    lanes,
    load_row,
    multiply_add,
    polynomials,
)  # fmt: skip

_TWICE = ((0, 0, 1, 1), (2, 2, 3, 3))  # two control points (x, y) stand side by side in a vector


@intrinsic
def _plane_point(_typing: Any, control: Any, offset: Any, t: Any) -> Any:
    """Return x, y and their derivatives with respect to t; `offset` is the element of the first control point."""

    def generate(context: Any, builder: Values, signature: Any, args: Any) -> Values:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        halves = [
            load_row(builder, data, signature.args[0].dtype, builder.add(args[1], ir.Constant(args[1].type, k)))
            for k in (0, 4)
        ]
        out = []
        for powers in (WEIGHTS, SLOPES):
            first, second = (
                polynomials(builder, tuple(tuple(row[k] for k in half) for row in powers), args[2]) for half in _TWICE
            )
            both = multiply_add(builder, first, halves[0], builder.fmul(second, halves[1], flags=FLAGS))
            low, high = (builder.shuffle_vector(both, both, lanes(2, k, 1)) for k in (0, 2))
            point = builder.fadd(low, high, flags=FLAGS)
            out += [builder.extract_element(point, LANE(k)) for k in range(2)]
        return context.make_tuple(builder, signature.return_type, out)

    if control.layout != "C":  # the offset counts elements of a contiguous array
        return None
    kinds = (control, types.int64, types.float64)
    return types.UniTuple(types.float64, 4)(*kinds), generate  # type: ignore[no-untyped-call]


@inlined
def plane_point(control: Array, i: int, t: float) -> tuple[float, float, float, float]:
    """Return x, y, dx/dt, dy/dt of the piece whose first control point is row i of `control` (m, 2)."""
    return _plane_point(control, 2 * i, t)  # type: ignore
