"""Values and slopes of a cubic surface at many points: the loop of `Surface.with_gradient`.

One point after the other waits for its own results: locate, load, contract. Here a block of points goes
through three short loops instead, the processor overlaps the points of each, and the last step takes four
points in one vector. With rows r0 ... r3 of control points and t = tx, the sums over the first axis are

    6 b(t)^T C  = r0 + 4 r1 + r2 + 3 t (d + t (e + t q / 3))
    2 b'(t)^T C = d + t (2 e + t q)
    d = r2 - r0, e = r0 - 2 r1 + r2, q = r3 - r0 - 3 (r2 - r1)

and those over the second axis are the same with the four elements of each sum. Thesis (4.16), (4.17), mended.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from knotwork.core.kernel import inlined, kernel
from knotwork.core.splines.basis import Array, locate
from knotwork.core.splines.tiles import BITS, MASK, SIDE, slot_of
from knotwork.core.splines.vectors import (
    FLAGS,
    FOUR,
    INT,
    LANE,
    Values,
    interleaved,
    lanes,
    load_row,
    multiply_add,
    rounded_down,
    spread,
    store_row,
    transposed,
)  # fmt: skip

BLOCK = 64  # points; their intermediate results stay in the first cache
_LAST = SIDE - 4  # the last start of a patch that lies in one tile


def _constant(value: float) -> Values:
    return ir.Constant(FOUR, [value] * 4)


def _sums(builder: Values, rows: list[Values], t: Values, *, slopes: bool = True) -> list[Values]:
    """Return 6 b(t)^T rows and, if asked, 2 b'(t)^T rows, lane by lane."""
    r0, r1, r2, r3 = rows
    outer = builder.fadd(r0, r2, flags=FLAGS)
    d = builder.fsub(r2, r0, flags=FLAGS)
    e = multiply_add(builder, _constant(-2.0), r1, outer)
    inner = builder.fsub(r1, r2, flags=FLAGS)
    q = multiply_add(builder, _constant(3.0), inner, builder.fsub(r3, r0, flags=FLAGS))
    tq = builder.fmul(t, q, flags=FLAGS)
    rise = multiply_add(builder, t, multiply_add(builder, _constant(1 / 3), tq, e), d)
    base = multiply_add(builder, _constant(4.0), r1, outer)
    sums = [multiply_add(builder, builder.fmul(t, _constant(3.0), flags=FLAGS), rise, base)]
    if slopes:
        sums.append(multiply_add(builder, t, multiply_add(builder, _constant(2.0), e, tq), d))
    return sums


def _data(context: Any, builder: Values, signature: Any, args: Any, k: int) -> Values:
    return context.make_array(signature.args[k])(context, builder, args[k]).data


@intrinsic
def _locate_two(_typing: Any, points: Any, at: Any, ox: Any, oy: Any, nx: Any, ny: Any, t: Any, i: Any, k: Any) -> Any:
    """Write t and mu of points `at` and `at` + 1 into rows k and k + 1 of `t` and `i` (BLOCK, 2)."""

    def generate(context: Any, builder: Values, signature: Any, args: Any) -> Values:
        source, places, indices = (_data(context, builder, signature, args, a) for a in (0, 6, 7))
        row = load_row(builder, source, types.float64, builder.shl(args[1], INT(1)))
        pair = ir.Constant(FOUR, ir.Undefined)
        first, per_step = pair, pair
        for lane in range(4):
            first = builder.insert_element(first, args[2 + lane % 2], LANE(lane))
            per_step = builder.insert_element(per_step, args[4 + lane % 2], LANE(lane))
        quotient = builder.fmul(builder.fsub(row, first, flags=FLAGS), per_step, flags=FLAGS)
        whole = rounded_down(builder, quotient)
        offset = builder.shl(args[8], INT(1))
        store_row(builder, places, types.float64, offset, builder.fsub(quotient, whole, flags=FLAGS))
        wide = ir.VectorType(INT, 4)
        target = builder.bitcast(builder.gep(indices, [offset]), wide.as_pointer())
        builder.store(builder.fptosi(whole, wide), target, align=8)
        return context.get_dummy_value()

    if points.layout != "C":
        return None
    kinds = (points, types.int64, *(types.float64,) * 4, t, i, types.int64)
    return types.void(*kinds), generate


@intrinsic
def _sum_rows(_typing: Any, pool: Any, o: Any, t: Any, lines: Any, k: Any) -> Any:
    """Write the sums over the first axis into row k of `lines` (BLOCK, 8): a patch in one tile, first element o."""

    def generate(context: Any, builder: Values, signature: Any, args: Any) -> Values:
        data, target = (_data(context, builder, signature, args, a) for a in (0, 3))
        offsets = [builder.add(args[1], INT(SIDE * row)) for row in range(4)]
        rows = [load_row(builder, data, signature.args[0].dtype, offset) for offset in offsets]
        for part, line in enumerate(_sums(builder, rows, spread(builder, args[2]))):
            store_row(builder, target, types.float64, builder.add(builder.shl(args[4], INT(3)), INT(4 * part)), line)
        return context.get_dummy_value()

    return types.void(pool, types.int64, types.float64, lines, types.int64), generate


@intrinsic
def _sum_split_rows(
    _typing: Any, pool: Any, l0: Any, l1: Any, l2: Any, l3: Any, r0: Any, r1: Any, r2: Any, r3: Any,
    beyond: Any, t: Any, lines: Any, k: Any,
) -> Any:  # fmt: skip
    """Do the same for rows whose last `beyond` elements lie at r0 ... r3, the others at the end of l0 ... l3."""

    def generate(context: Any, builder: Values, signature: Any, args: Any) -> Values:
        data, target = (_data(context, builder, signature, args, a) for a in (0, 11))
        element = signature.args[0].dtype
        rows = []
        for left, right in zip(args[1:5], args[5:9], strict=True):
            near, far = (load_row(builder, data, element, offset) for offset in (left, right))
            row = near
            for count in (1, 2, 3):
                moved = builder.shuffle_vector(near, far, lanes(4, count, 1))
                row = builder.select(builder.icmp_signed("==", args[9], INT(count)), moved, row)
            rows.append(row)
        for part, line in enumerate(_sums(builder, rows, spread(builder, args[10]))):
            store_row(builder, target, types.float64, builder.add(builder.shl(args[12], INT(3)), INT(4 * part)), line)
        return context.get_dummy_value()

    return types.void(pool, *(types.int64,) * 9, types.float64, lines, types.int64), generate


@intrinsic
def _finish_four(
    _typing: Any, lines: Any, t: Any, k: Any, nx: Any, ny: Any, values: Any, gradients: Any, at: Any
) -> Any:
    """Sum over the second axis for points k ... k + 3 of the block; write from row `at` on."""

    def generate(context: Any, builder: Values, signature: Any, args: Any) -> Values:
        source, places, out, partials = (_data(context, builder, signature, args, a) for a in (0, 1, 5, 6))
        f64 = types.float64
        start = builder.shl(args[2], INT(3))
        summed, sloped = (
            transposed(
                builder, [load_row(builder, source, f64, builder.add(start, INT(8 * p + part))) for p in range(4)]
            )
            for part in (0, 4)
        )
        pairs = [load_row(builder, places, f64, builder.add(builder.shl(args[2], INT(1)), INT(o))) for o in (0, 4)]
        ty = builder.shuffle_vector(pairs[0], pairs[1], lanes(4, 1, 2))
        value, across = _sums(builder, summed, ty)
        (along,) = _sums(builder, sloped, ty, slopes=False)
        store_row(builder, out, f64, args[7], builder.fmul(value, _constant(1 / 36), flags=FLAGS))
        along = builder.fmul(along, spread(builder, args[3]), flags=FLAGS)
        across = builder.fmul(across, spread(builder, args[4]), flags=FLAGS)
        for part, row in enumerate(interleaved(builder, along, across)):
            store_row(builder, partials, f64, builder.add(builder.shl(args[7], INT(1)), INT(4 * part)), row)
        return context.get_dummy_value()

    kinds = (lines, t, types.int64, types.float64, types.float64, values, gradients, types.int64)
    return types.void(*kinds), generate


@inlined
def _sum_across(
    pool: Array, directory: Array, oi: int, oj: int, i: int, j: int, t: float, lines: Array, k: int
) -> None:
    """Do as `_sum_rows` for a patch over two or four tiles."""
    r, c = i & MASK, j & MASK
    near, far = slot_of(directory, oi, oj, i, j) << (2 * BITS), slot_of(directory, oi, oj, i, j + 3) << (2 * BITS)
    near3 = slot_of(directory, oi, oj, i + 3, j) << (2 * BITS)
    far3 = slot_of(directory, oi, oj, i + 3, j + 3) << (2 * BITS)
    one, two = r + 1 < SIDE, r + 2 < SIDE
    b0, b1, b2, b3 = r << BITS, ((r + 1) & MASK) << BITS, ((r + 2) & MASK) << BITS, ((r + 3) & MASK) << BITS
    start = min(c, _LAST)
    _sum_split_rows(  # type: ignore
        pool,
        near + b0 + start,
        (near if one else near3) + b1 + start,
        (near if two else near3) + b2 + start,
        near3 + b3 + start,
        far + b0,
        (far if one else far3) + b1,
        (far if two else far3) + b2,
        far3 + b3,
        c - start, t, lines, k,
    )  # fmt: skip


@kernel
def cubic_gradients(
    pool: Array, directory: Array, oi: int, oj: int, ox: float, oy: float, sx: float, sy: float,
    points: Array, values: Array, gradients: Array,
) -> None:  # fmt: skip
    """Write the values (n,) and the partial derivatives (n, 2) at `points` (n, 2); all contiguous."""
    n = points.shape[0]
    t = np.empty((BLOCK, 2))
    mu = np.empty((BLOCK, 2), np.int64)
    lines = np.empty((BLOCK, 8))
    crossing = np.empty(BLOCK, np.int64)
    rows, columns = np.uint64(directory.shape[0]), np.uint64(directory.shape[1])
    nx, ny = 1.0 / sx, 1.0 / sy
    for start in range(0, n, BLOCK):
        count = min(BLOCK, n - start)
        for k in range(0, count - 1, 2):
            _locate_two(points, start + k, ox, oy, nx, ny, t, mu, k)  # type: ignore
        if count & 1:
            mu[count - 1, 0], t[count - 1, 0] = locate(points[n - 1, 0], ox, sx)
            mu[count - 1, 1], t[count - 1, 1] = locate(points[n - 1, 1], oy, sy)
        across = 0
        for k in range(count):
            i, j = mu[k, 0] - 3, mu[k, 1] - 3
            r, c = i & MASK, j & MASK
            whole = (r <= _LAST) & (c <= _LAST)
            crossing[across] = k  # no branch that the processor would guess wrongly one time in ten
            across += 1 - int(whole)
            a, b = np.uint64((i >> BITS) - oi), np.uint64((j >> BITS) - oj)
            o = 0
            if whole & (a < rows) & (b < columns):
                o = (np.int64(directory[a, b]) << (2 * BITS)) + (r << BITS) + c
            _sum_rows(pool, o, t[k, 0], lines, k)  # type: ignore
        for m in range(across):
            k = crossing[m]
            _sum_across(pool, directory, oi, oj, mu[k, 0] - 3, mu[k, 1] - 3, t[k, 0], lines, k)
        for k in range(0, count - 3, 4):
            _finish_four(lines, t, k, nx / 12, ny / 12, values, gradients, start + k)  # type: ignore
        if count & 3:
            k = count & ~3
            few, slopes = np.empty(4), np.empty((4, 2))
            _finish_four(lines, t, k, nx / 12, ny / 12, few, slopes, 0)  # type: ignore
            for m in range(count - k):  # type: ignore[unreachable]
                values[start + k + m] = few[m]
                gradients[start + k + m, 0], gradients[start + k + m, 1] = slopes[m, 0], slopes[m, 1]
