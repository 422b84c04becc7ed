"""Explicit vector instructions: eight comparisons, or two or four columns, at once.

LLVM unrolls a plain loop over eight entries before vectorization, and it stays scalar, which is five times
slower. A loop over columns of a matrix stays scalar because rows might overlap. LLVM maps vector instructions
to the processor's.
"""

from typing import Any

from llvmlite import ir
from numba import extending, types
from numba.core import cgutils

LANES = 8
intrinsic: Any = extending.intrinsic  # callers leave out the first argument
FLOATS = ir.VectorType(ir.FloatType(), LANES)


def integer(value):
    """Return a 64-bit constant."""
    return ir.Constant(ir.IntType(64), value)


def splat(builder, scalar, kind=FLOATS):
    """Return a vector of equal numbers."""
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), zeros)


def chosen(builder, vector, lanes):
    """Return a vector of selected lanes of another vector."""
    places = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes)
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), places)


def _entries(context, builder, signature, args, node):
    """Return centres and radii of the eight entries of a tree node; the first argument holds the bounds."""
    array = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=args[0])
    rows, first = builder.bitcast(array.data, FLOATS.as_pointer()), builder.mul(args[node], integer(4))
    return [builder.load(builder.gep(rows, [builder.add(first, integer(k))]), align=4) for k in range(4)]


def _moved(builder, points, R, t):
    """Transform eight points to another frame by a rotation's rows and a translation."""
    matrix = [cgutils.unpack_tuple(builder, row) for row in cgutils.unpack_tuple(builder, R)]
    moved = []
    for row, start in zip(matrix, cgutils.unpack_tuple(builder, t), strict=True):
        total = splat(builder, start)
        for entry, coordinate in zip(row, points[:3], strict=True):
            term = builder.fmul(splat(builder, entry), coordinate, flags=("contract",))
            total = builder.fadd(total, term, flags=("contract",))
        moved.append(total)
    return moved


@intrinsic
def overlap_mask(typingctx, bounds, node, x, y, z, radius):
    """Return a mask of the entries of ``bounds[node]`` (4, 8: x, y, z, radius) that overlap a sphere.

    The sphere is given by four float32; bit m belongs to entry m.
    """

    def codegen(context, builder, signature, args):
        entries, distance2 = _entries(context, builder, signature, args, 1), None
        for k in range(3):
            d = builder.fsub(entries[k], splat(builder, args[2 + k]))
            d2 = builder.fmul(d, d)
            distance2 = d2 if distance2 is None else builder.fadd(distance2, d2)
        reach = builder.fadd(entries[3], splat(builder, args[5]))
        hit = builder.fcmp_ordered("<", distance2, builder.fmul(reach, reach))
        return builder.zext(builder.bitcast(hit, ir.IntType(LANES)), ir.IntType(64))

    f = types.float32
    array = types.Array(f, 3, "C", readonly=not bounds.mutable)
    return types.uint64(array, types.int64, f, f, f, f), codegen


@intrinsic
def box_mask(typingctx, bounds, node, R, t, low, high, margin):
    """Return a mask of the entries of ``bounds[node]`` that are at most ``margin`` from a box.

    ``low`` and ``high`` are the box's corners, which may be infinite. ``R`` and ``t`` are as in
    `overlap_masks`, into the box's frame. Bit m belongs to entry m.
    """

    def codegen(context, builder, signature, args):
        entries = _entries(context, builder, signature, args, 1)
        moved, nothing = _moved(builder, entries, args[2], args[3]), ir.Constant(FLOATS, [0.0] * LANES)
        low, high = cgutils.unpack_tuple(builder, args[4]), cgutils.unpack_tuple(builder, args[5])
        distance2 = nothing
        for k in range(3):
            under = builder.fsub(splat(builder, low[k]), moved[k])
            over = builder.fsub(moved[k], splat(builder, high[k]))
            most = builder.select(builder.fcmp_ordered(">", under, over), under, over)
            most = builder.select(builder.fcmp_ordered(">", most, nothing), most, nothing)
            distance2 = builder.fadd(distance2, builder.fmul(most, most))
        reach = builder.fadd(entries[3], splat(builder, args[6]))
        hit = builder.fcmp_ordered("<=", distance2, builder.fmul(reach, reach))
        return builder.zext(builder.bitcast(hit, ir.IntType(LANES)), ir.IntType(64))

    f = types.float32
    array, point = types.Array(f, 3, "C", readonly=not bounds.mutable), types.UniTuple(f, 3)
    rotation = types.UniTuple(point, 3)
    return types.uint64(array, types.int64, rotation, point, point, point, f), codegen


@intrinsic
def overlap_masks(typingctx, bounds, a, b, R, t, slack):
    """Return a mask of pairs of entries of ``bounds[a]`` and ``bounds[b]`` that overlap within ``slack``.

    Bit 8 k + m belongs to entry m of the first and entry k of the second. ``R`` (three rows) and ``t``
    transform points of the second to the first frame; all are float32. Entries beyond 1e29 m are empty.
    """

    def codegen(context, builder, signature, args):
        own, other = (_entries(context, builder, signature, args, node) for node in (1, 2))
        far = splat(builder, ir.Constant(ir.FloatType(), 1e29))
        moved = _moved(builder, other, args[3], args[4])
        grown = builder.fadd(other[3], splat(builder, args[5]))
        # move empty entries far from the empty entries of the other node
        moved[0] = builder.select(builder.fcmp_ordered("<", other[0], far), moved[0], builder.fneg(far))
        found = integer(0)
        for k in range(LANES):  # one entry of the second against all of the first
            one, distance2 = [k] * LANES, None
            for c in range(3):
                d = builder.fsub(own[c], chosen(builder, moved[c], one))
                d2 = builder.fmul(d, d, flags=("contract",))
                distance2 = d2 if distance2 is None else builder.fadd(distance2, d2, flags=("contract",))
            reach = builder.fadd(own[3], chosen(builder, grown, one))
            hit = builder.fcmp_ordered("<", distance2, builder.fmul(reach, reach))
            bits = builder.zext(builder.bitcast(hit, ir.IntType(LANES)), ir.IntType(64))
            found = builder.or_(found, builder.shl(bits, integer(LANES * k)))
        return found

    f = types.float32
    array, point = types.Array(f, 3, "C", readonly=not bounds.mutable), types.UniTuple(f, 3)
    return types.uint64(array, types.int64, types.int64, types.UniTuple(point, 3), point, f), codegen


@intrinsic
def lowest_bit(typingctx, mask):
    """Return the index of the lowest set bit of a nonzero 64-bit mask."""

    def codegen(context, builder, signature, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.uint64), codegen
