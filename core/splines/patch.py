"""Cubic surface patches in four-wide arithmetic: the 4 x 4 control points that act at one place.

Numba does not turn sixteen products into vector instructions by itself (twice the time), so the two
innermost steps are written in LLVM's portable vectors; they compile to AVX on x86 and NEON on ARM.
With C the 4 x 4 control points, b and b' the weights and their slopes at the local coordinates (tx, ty):
value b(tx)^T C b(ty), slopes b'(tx)^T C b(ty) and b(tx)^T C b'(ty), thesis (4.16) and (4.17), mended.
Divide slopes by the knot interval.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from knotwork.core.kernel import inlined, kernel
from knotwork.core.splines.basis import Array, cubic
from knotwork.core.splines.tiles import BITS, MASK, SIDE, in_one_tile, slot_of
from knotwork.core.splines.vectors import (
    DOUBLE,
    FLAGS,
    FOUR,
    INT,
    LANE,
    SLOPES,
    WEIGHTS,
    Values,
    combine,
    dot,
    lanes,
    load_row,
    multiply_add,
    polynomials,
    rounded_down,
    spread,
    store_row,
)  # fmt: skip


def _load_split(builder: Values, data: Values, offset: Values, right: Values, split: Values) -> Values:
    """Load `split` elements at `offset` and the other 4 - split at `right`."""
    row = ir.Constant(FOUR, ir.Undefined)
    beyond = builder.sub(right, split)
    for k in range(4):
        start = builder.select(builder.icmp_signed("<", INT(k), split), offset, beyond)
        value = builder.load(builder.gep(data, [builder.add(start, INT(k))]))
        if isinstance(value.type, ir.IntType):
            value = builder.sitofp(value, DOUBLE)
        elif value.type != DOUBLE:
            value = builder.fpext(value, DOUBLE)
        row = builder.insert_element(row, value, LANE(k))
    return row


def _contract(builder: Values, rows: list[Values], tx: Values, ty: Values) -> list[Values]:
    """Return value and both slopes."""
    across = polynomials(builder, WEIGHTS, ty)
    summed = combine(builder, polynomials(builder, WEIGHTS, tx), rows)
    sloped = combine(builder, polynomials(builder, SLOPES, tx), rows)
    one = builder.fmul(sloped, across, flags=FLAGS)
    two = builder.fmul(summed, polynomials(builder, SLOPES, ty), flags=FLAGS)
    even = ir.Constant(ir.VectorType(LANE, 4), [0, 4, 2, 6])
    odd = ir.Constant(ir.VectorType(LANE, 4), [1, 5, 3, 7])
    pairs = builder.fadd(builder.shuffle_vector(one, two, even), builder.shuffle_vector(one, two, odd), flags=FLAGS)
    both = builder.fadd(
        builder.shuffle_vector(pairs, pairs, lanes(2, 0, 1)),
        builder.shuffle_vector(pairs, pairs, lanes(2, 2, 1)),
        flags=FLAGS,
    )
    return [
        dot(builder, summed, across),
        builder.extract_element(both, LANE(0)),
        builder.extract_element(both, LANE(1)),
    ]


@intrinsic
def _whole_rows(_typing: Any, pool: Any, o0: Any, o1: Any, o2: Any, o3: Any, tx: Any, ty: Any) -> Any:
    """Contract four rows of four, each contiguous at its element offset in the flat pool."""

    def generate(context: Any, builder: Values, signature: Any, args: Any) -> Values:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        rows = [load_row(builder, data, signature.args[0].dtype, offset) for offset in args[1:5]]
        return context.make_tuple(builder, signature.return_type, _contract(builder, rows, *args[5:7]))

    kinds = (pool, *(types.int64,) * 4, *(types.float64,) * 2)
    return types.UniTuple(types.float64, 3)(*kinds), generate  # type: ignore[no-untyped-call]


@intrinsic
def _split_rows(
    _typing: Any, pool: Any, o0: Any, o1: Any, o2: Any, o3: Any, r0: Any, r1: Any, r2: Any, r3: Any,
    split: Any, tx: Any, ty: Any,
) -> Any:  # fmt: skip
    """Contract four rows whose last 4 - split elements lie at the offsets r0 ... r3."""

    def generate(context: Any, builder: Values, signature: Any, args: Any) -> Values:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        rows = [_load_split(builder, data, args[1 + k], args[5 + k], args[9]) for k in range(4)]
        return context.make_tuple(builder, signature.return_type, _contract(builder, rows, *args[10:12]))

    kinds = (pool, *(types.int64,) * 9, *(types.float64,) * 2)
    return types.UniTuple(types.float64, 3)(*kinds), generate  # type: ignore[no-untyped-call]


_GOLDEN = 0.6180339887498949  # its multiples are spread evenly


def _shares(builder: Values, dither: Values, row: int) -> Values:
    """Return four numbers in [0, 1), spread evenly among the sixteen of a patch."""
    steps = ir.Constant(FOUR, [((4 * row + lane) * _GOLDEN) % 1.0 for lane in range(4)])
    sums = builder.fadd(spread(builder, dither), steps)
    return builder.fsub(sums, rounded_down(builder, sums))


@intrinsic
def _element(_typing: Any, pool: Any, value: Any, dither: Any) -> Any:
    """Return the value as an element of the pool; if those are whole numbers, the floor of value + dither."""

    def generate(context: Any, builder: Values, signature: Any, args: Any) -> Values:
        element = signature.args[0].dtype
        value = args[1]
        if not isinstance(element, types.Integer):
            return context.cast(builder, value, types.float64, element)
        floor = builder.module.declare_intrinsic("llvm.floor", [DOUBLE])
        value = builder.call(floor, [builder.fadd(value, args[2])])
        return builder.fptosi(value, context.get_value_type(element))

    return pool.dtype(pool, types.float64, types.float64), generate


@intrinsic
def _add_to_rows(
    _typing: Any,
    pool: Any,
    o0: Any,
    o1: Any,
    o2: Any,
    o3: Any,
    tx: Any,
    ty: Any,
    amount: Any,
    low: Any,
    high: Any,
    dither: Any,
) -> Any:
    """Add amount b(tx) b(ty)^T to four contiguous rows, keeping every element within [low, high]."""

    def generate(context: Any, builder: Values, signature: Any, args: Any) -> Values:
        element = signature.args[0].dtype
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        tx, ty, amount, low, high, dither = args[5:11]
        whole = isinstance(element, types.Integer)
        along = polynomials(builder, WEIGHTS, tx)
        across = builder.fmul(polynomials(builder, WEIGHTS, ty), spread(builder, amount), flags=FLAGS)
        floor, ceiling = spread(builder, low), spread(builder, high)
        empty = ir.Constant(FOUR, ir.Undefined)
        for k, offset in enumerate(args[1:5]):
            factor = builder.shuffle_vector(along, empty, lanes(4, k, 0))
            row = multiply_add(builder, factor, across, load_row(builder, data, element, offset))
            row = builder.select(builder.fcmp_ordered("<", row, floor), floor, row)
            row = builder.select(builder.fcmp_ordered(">", row, ceiling), ceiling, row)
            if whole:
                row = rounded_down(builder, builder.fadd(row, _shares(builder, dither, k)))
            store_row(builder, data, element, offset, row)
        return context.get_dummy_value()

    kinds = (pool, *(types.int64,) * 4, *(types.float64,) * 6)
    return types.void(*kinds), generate


@inlined
def cubic_value_gradient(
    pool: Array, directory: Array, oi: int, oj: int, i: int, j: int, tx: float, ty: float
) -> tuple[float, float, float]:
    """Return value and both slopes (with respect to tx and ty) of the patch that starts at element (i, j).

    Whatever was never claimed reads as the background. `i` is mu_x - 3, `j` is mu_y - 3 (`basis.locate`).
    """
    if in_one_tile(i, j, 4):
        o = (slot_of(directory, oi, oj, i, j) << (2 * BITS)) + ((i & MASK) << BITS) + (j & MASK)
        return _whole_rows(pool, o, o + SIDE, o + 2 * SIDE, o + 3 * SIDE, tx, ty)  # type: ignore
    return _value_gradient_across(pool, directory, oi, oj, i, j, tx, ty)


@kernel
def _value_gradient_across(
    pool: Array, directory: Array, oi: int, oj: int, i: int, j: int, tx: float, ty: float
) -> tuple[float, float, float]:
    """Do the same for a patch over two or four tiles."""
    r, c = i & MASK, j & MASK
    upper, lower = min(4, SIDE - r), min(4, SIDE - c)
    o0 = (slot_of(directory, oi, oj, i, j) << (2 * BITS)) + (r << BITS) + c
    r0 = (slot_of(directory, oi, oj, i, j + 3) << (2 * BITS)) + (r << BITS)
    o3 = (slot_of(directory, oi, oj, i + 3, j) << (2 * BITS)) - (upper << BITS) + c
    r3 = (slot_of(directory, oi, oj, i + 3, j + 3) << (2 * BITS)) - (upper << BITS)
    if upper == 4:
        o3, r3 = o0, r0
    return _split_rows(  # type: ignore
        pool,
        o0,
        (o0 if upper > 1 else o3) + SIDE,
        (o0 if upper > 2 else o3) + 2 * SIDE,
        o3 + 3 * SIDE,
        r0,
        (r0 if upper > 1 else r3) + SIDE,
        (r0 if upper > 2 else r3) + 2 * SIDE,
        r3 + 3 * SIDE,
        lower, tx, ty,
    )  # fmt: skip


@inlined
def cubic_value(pool: Array, directory: Array, oi: int, oj: int, i: int, j: int, tx: float, ty: float) -> float:
    """Return the value of the patch that starts at element (i, j)."""
    return cubic_value_gradient(pool, directory, oi, oj, i, j, tx, ty)[0]


@inlined
def cubic_add(
    pool: Array, directory: Array, oi: int, oj: int, i: int, j: int, tx: float, ty: float,
    amount: float, low: float, high: float, dither: float,
) -> None:  # fmt: skip
    """Add `amount` times the 16 weights to the claimed patch at (i, j), each point kept in [low, high].

    The minimum-norm update (7.14) that raises the surface by e is amount = e / `cubic_norm(tx, ty)`.
    Where elements are whole numbers each is rounded up or down, by a share in [0, 1) that is the fraction of `dither`
    plus another for each of the 16: over calls with evenly spread `dither` the sums are right on average. Floats
    ignore it.
    """
    if in_one_tile(i, j, 4):
        o = (slot_of(directory, oi, oj, i, j) << (2 * BITS)) + ((i & MASK) << BITS) + (j & MASK)
        _add_to_rows(pool, o, o + SIDE, o + 2 * SIDE, o + 3 * SIDE, tx, ty, amount, low, high, dither)  # type: ignore
    else:
        _add_across(pool, directory, oi, oj, i, j, tx, ty, amount, low, high, dither)


@kernel
def _add_across(
    pool: Array, directory: Array, oi: int, oj: int, i: int, j: int, tx: float, ty: float,
    amount: float, low: float, high: float, dither: float,
) -> None:  # fmt: skip
    """Do the same for a patch over two or four tiles."""
    along = cubic(tx)
    across = cubic(ty)
    middle = SIDE - (j & MASK)
    for k in range(4):
        a = np.uint64((i + k) & MASK)
        left = np.uint64(slot_of(directory, oi, oj, i + k, j))
        right = np.uint64(slot_of(directory, oi, oj, i + k, j + 3))
        for n in range(4):
            slot, b = left if n < middle else right, np.uint64((j + n) & MASK)
            value = min(max(pool[slot, a, b] + amount * along[k] * across[n], low), high)
            share = dither + (4 * k + n) * _GOLDEN
            pool[slot, a, b] = _element(pool, value, share - math.floor(share))  # type: ignore


@inlined
def cubic_norm(tx: float, ty: float) -> float:
    """Return the squared length of the 16 weights, between 0.21 and 0.25."""
    a0, a1, a2, a3 = cubic(tx)
    b0, b1, b2, b3 = cubic(ty)
    return (a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3) * (b0 * b0 + b1 * b1 + b2 * b2 + b3 * b3)
