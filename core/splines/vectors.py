"""Steps of four-wide arithmetic in LLVM's portable vectors, for code that Numba does not vectorise by itself.

They run while Numba generates code: each takes the builder and LLVM values and adds instructions.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function

FLAGS = ("contract", "reassoc", "arcp", "nsz")
DOUBLE = ir.DoubleType()
INT = ir.IntType(64)
LANE = ir.IntType(32)
FOUR = ir.VectorType(DOUBLE, 4)
# The four weights (rows of powers t^0, t^1, ...), their slopes.
WEIGHTS = (
    (1 / 6, 4 / 6, 1 / 6, 0.0),
    (-0.5, 0.0, 0.5, 0.0),
    (0.5, -1.0, 0.5, 0.0),
    (-1 / 6, 0.5, -0.5, 1 / 6),
)
SLOPES = ((-0.5, 0.0, 0.5, 0.0), (1.0, -2.0, 1.0, 0.0), (-0.5, 1.5, -1.5, 0.5))

Values = Any  # an LLVM value while code is being generated


def multiply_add(builder: Values, a: Values, b: Values, c: Values) -> Values:
    """Return a b + c."""
    return builder.fadd(builder.fmul(a, b, flags=FLAGS), c, flags=FLAGS)


def lanes(count: int, start: int, step: int) -> Values:
    """Return the mask of a shuffle: start, start + step, ..."""
    return ir.Constant(ir.VectorType(LANE, count), [start + step * k for k in range(count)])


def spread(builder: Values, scalar: Values) -> Values:
    """Return the scalar in all four lanes."""
    empty = ir.Constant(FOUR, ir.Undefined)
    return builder.shuffle_vector(builder.insert_element(empty, scalar, LANE(0)), empty, lanes(4, 0, 0))


def polynomials(builder: Values, powers: tuple[tuple[float, ...], ...], t: Values) -> Values:
    """Evaluate four polynomials at the scalar t by Horner's rule."""
    place = spread(builder, t)
    rows = [ir.Constant(FOUR, list(row)) for row in powers]
    result = rows[-1]
    for row in reversed(rows[:-1]):
        result = multiply_add(builder, result, place, row)
    return result


def combine(builder: Values, weights: Values, rows: list[Values]) -> Values:
    """Return the sum of rows, each times its lane of `weights`."""
    empty = ir.Constant(FOUR, ir.Undefined)
    factors = [builder.shuffle_vector(weights, empty, lanes(4, k, 0)) for k in range(4)]
    result = builder.fmul(factors[0], rows[0], flags=FLAGS)
    for factor, row in zip(factors[1:], rows[1:], strict=True):
        result = multiply_add(builder, factor, row, result)
    return result


def rounded_down(builder: Values, row: Values) -> Values:
    """Return the floor of each lane."""
    floor = get_or_insert_function(builder.module, ir.FunctionType(FOUR, [FOUR]), "llvm.floor.v4f64")  # type: ignore
    return builder.call(floor, [row])


def dot(builder: Values, a: Values, b: Values) -> Values:
    """Return the scalar product of two vectors."""
    product = builder.fmul(a, b, flags=FLAGS)
    low = builder.shuffle_vector(product, product, lanes(2, 0, 1))
    high = builder.shuffle_vector(product, product, lanes(2, 2, 1))
    pair = builder.fadd(low, high, flags=FLAGS)
    first, second = (builder.extract_element(pair, LANE(k)) for k in range(2))
    return builder.fadd(first, second, flags=FLAGS)


def load_row(builder: Values, data: Values, element: Any, offset: Values) -> Values:
    """Load four neighbours at element `offset` of the flat array as doubles."""
    size, kind = _element(element)
    place = builder.bitcast(builder.gep(data, [offset]), ir.VectorType(kind, 4).as_pointer())
    row = builder.load(place, align=size)
    if isinstance(kind, ir.IntType):
        return builder.sitofp(row, FOUR)
    return builder.fpext(row, FOUR) if size == 4 else row


def store_row(builder: Values, data: Values, element: Any, offset: Values, row: Values) -> None:
    """Store four doubles as neighbours from element `offset` on; whole numbers if the elements are."""
    size, kind = _element(element)
    place = builder.bitcast(builder.gep(data, [offset]), ir.VectorType(kind, 4).as_pointer())
    if isinstance(kind, ir.IntType):
        row = builder.trunc(builder.fptosi(row, ir.VectorType(LANE, 4)), ir.VectorType(kind, 4))
    elif size == 4:
        row = builder.fptrunc(row, ir.VectorType(kind, 4))
    builder.store(row, place, align=size)


def _element(element: Any) -> tuple[int, Values]:
    """Return size [bytes] and LLVM's type of an element of an array."""
    if element == types.int8:
        return 1, ir.IntType(8)
    return (4, ir.FloatType()) if element == types.float32 else (8, DOUBLE)


def transposed(builder: Values, rows: list[Values]) -> list[Values]:
    """Return the columns of four vectors."""
    even, odd = ir.Constant(ir.VectorType(LANE, 4), [0, 4, 2, 6]), ir.Constant(ir.VectorType(LANE, 4), [1, 5, 3, 7])
    low, high = ir.Constant(ir.VectorType(LANE, 4), [0, 1, 4, 5]), ir.Constant(ir.VectorType(LANE, 4), [2, 3, 6, 7])
    pairs = [builder.shuffle_vector(rows[k], rows[k + 1], mask) for mask in (even, odd) for k in (0, 2)]
    return [builder.shuffle_vector(pairs[k], pairs[k + 1], mask) for mask in (low, high) for k in (0, 2)]


def interleaved(builder: Values, a: Values, b: Values) -> list[Values]:
    """Return a0, b0, a1, b1 and a2, b2, a3, b3."""
    kind = ir.VectorType(LANE, 4)
    return [builder.shuffle_vector(a, b, ir.Constant(kind, [k, k + 4, k + 1, k + 5])) for k in (0, 2)]
