"""SIMD operations on contacts, eight numbers at once (as in `compiler.simd`)."""

from llvmlite import ir
from numba import types
from numba.core import cgutils

from ..compiler.simd import DOUBLES, LANES, chosen, integer, intrinsic, splat
from .contact_row import AXIS, DIRECTION, DIRECTION_J, PUSH_I, PUSH_J


@intrinsic
def foreseen(typingctx):
    """Keep a branch: prevent the compiler from computing it in advance and selecting the result."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(ir.VoidType(), [])
        builder.call(ir.InlineAsm(kind, "", "", side_effect=True), [])
        return context.get_dummy_value()

    return types.void(), codegen


@intrinsic
def lower_supports(typingctx, score, best, k, base, *more):
    """Store ``k`` in ``best`` where its score is lower than the eight of ``score``; return a mask of these.

    The scores are ``base`` plus and minus each of four numbers, alternating. Bit m of the mask belongs to
    score m.
    """

    def codegen(context, builder, signature, args):
        integers = ir.VectorType(ir.IntType(64), LANES)
        score, best = (
            cgutils.create_struct_proxy(signature.args[n])(context, builder, value=args[n]).data
            for n in (0, 1)
        )
        score = builder.bitcast(score, DOUBLES.as_pointer())
        best = builder.bitcast(best, integers.as_pointer())
        value = ir.Constant(DOUBLES, ir.Undefined)
        for n, number in enumerate(cgutils.unpack_tuple(builder, args[4])):
            for side, combine in enumerate((builder.fadd, builder.fsub)):
                place = ir.Constant(ir.IntType(32), 2 * n + side)
                value = builder.insert_element(value, combine(args[3], number), place)
        before = builder.load(score, align=8)
        lower, same = (builder.fcmp_ordered(sign, value, before) for sign in ("<", "=="))
        builder.store(builder.select(lower, value, before), score, align=8)
        number = splat(builder, args[2], integers)
        builder.store(builder.select(lower, number, builder.load(best, align=8)), best, align=8)
        return builder.zext(builder.bitcast(same, ir.IntType(LANES)), ir.IntType(64))

    d, i = types.float64, types.int64
    return types.uint64(types.Array(d, 1, "C"), types.Array(i, 1, "C"), i, d, types.UniTuple(d, 4)), codegen


@intrinsic
def plane_mask(typingctx, spheres, first, now, later, limit):
    """Return a mask of the spheres, of eight, that are nearer to a plane than ``limit``, now or later.

    The spheres are columns of ``spheres`` (4, n) from ``first`` on. ``now`` and ``later`` each hold the
    coefficients of a centre's coordinates and a constant.
    """

    def codegen(context, builder, signature, args):
        array = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=args[0])
        count = cgutils.unpack_tuple(builder, array.shape)[1]
        x, y, z, r = (
            builder.load(
                builder.bitcast(
                    builder.gep(array.data, [builder.add(args[1], builder.mul(count, integer(row)))]),
                    DOUBLES.as_pointer(),
                ),
                align=8,
            )
            for row in range(4)
        )
        found = None
        for plane in args[2:4]:
            *normal, gap = (splat(builder, entry, DOUBLES) for entry in cgutils.unpack_tuple(builder, plane))
            for entry, coordinate in zip(normal, (x, y, z), strict=True):
                gap = builder.fadd(gap, builder.fmul(entry, coordinate))
            near = builder.fcmp_ordered("<", builder.fsub(gap, r), splat(builder, args[4], DOUBLES))
            found = near if found is None else builder.or_(found, near)
        return builder.zext(builder.bitcast(found, ir.IntType(LANES)), ir.IntType(64))

    d = types.float64
    plane, matrix = types.UniTuple(d, 4), types.Array(d, 2, "C", readonly=not spheres.mutable)
    return types.uint64(matrix, types.int64, plane, plane, d), codegen


def _rows_of(context, builder, signature, args, row, v):
    """Return readers of a contact's row and of bodies' velocities, eight columns at once."""
    row = cgutils.create_struct_proxy(signature.args[row])(context, builder, value=args[row]).data
    v = cgutils.create_struct_proxy(signature.args[v])(context, builder, value=args[v]).data

    def column(k):
        return builder.bitcast(builder.gep(row, [integer(k)]), DOUBLES.as_pointer())

    def body(i):
        at = builder.gep(v, [builder.mul(i, integer(LANES))])
        return builder.bitcast(at, DOUBLES.as_pointer())

    return column, body


@intrinsic
def contact_speeds(typingctx, row, v, i, j):
    """Return the velocity of body i relative to its partner along a contact's three directions [m/s].

    Body j counts if ``j`` is not negative. The motion of the partner's surface (`DRIFT`) is not included.
    ``row`` is a row of `ImplicitWorkspace.rows`, ``v`` (B, 8) one of its velocities.
    """

    def codegen(context, builder, signature, args):
        column, body = _rows_of(context, builder, signature, args, 0, 1)
        v_i = builder.load(body(args[2]), align=8)
        own = []
        for d in range(3):
            own.append(
                builder.fmul(builder.load(column(AXIS * d + DIRECTION), align=8), v_i, flags=("contract",))
            )
        before = builder.block
        with builder.if_then(builder.icmp_signed(">=", args[3], integer(0))):
            v_j, less = builder.fneg(builder.load(body(args[3]), align=8)), []
            for d in range(3):
                part = builder.fmul(
                    builder.load(column(AXIS * d + DIRECTION_J), align=8), v_j, flags=("contract",)
                )
                less.append(builder.fadd(own[d], part, flags=("contract",)))
            inside = builder.block
        speeds = []
        for d in range(3):
            total = builder.phi(DOUBLES)
            total.add_incoming(own[d], before)
            total.add_incoming(less[d], inside)
            speeds.append(total)
        for d in range(3):
            total = speeds[d]
            for width in (4, 2, 1):  # halves are added until one number is left
                low, high = (
                    chosen(builder, total, list(range(first, first + width))) for first in (0, width)
                )
                total = builder.fadd(low, high)
            speeds[d] = builder.extract_element(total, ir.Constant(ir.IntType(32), 0))
        return cgutils.pack_array(builder, speeds)

    d = types.float64
    numbers, matrix = types.Array(d, 1, "C"), types.Array(d, 2, "C")
    return types.UniTuple(d, 3)(numbers, matrix, types.int64, types.int64), codegen


@intrinsic
def apply_impulses(typingctx, row, normal, first, second, v, i, j):
    """Change the bodies' velocities by impulses along a contact's normal and both tangents [N s].

    Arguments are as in `contact_speeds`.
    """

    def codegen(context, builder, signature, args):
        column, body = _rows_of(context, builder, signature, args, 0, 4)
        impulses = [splat(builder, args[1 + d], DOUBLES) for d in range(3)]

        def push(i, block, sign):
            change = None
            for d in range(3):
                part = builder.fmul(
                    builder.load(column(AXIS * d + block), align=8), impulses[d], flags=("contract",)
                )
                change = part if change is None else builder.fadd(change, part, flags=("contract",))
            place = body(i)
            combine = builder.fadd if sign > 0 else builder.fsub
            builder.store(combine(builder.load(place, align=8), change), place, align=8)

        push(args[5], PUSH_I, 1)
        with builder.if_then(builder.icmp_signed(">=", args[6], integer(0))):
            push(args[6], PUSH_J, -1)
        return context.get_dummy_value()

    d = types.float64
    numbers, matrix = types.Array(d, 1, "C"), types.Array(d, 2, "C")
    return types.void(numbers, d, d, d, matrix, types.int64, types.int64), codegen


def _eight(context, builder, signature, args, n, at):
    """Return a pointer to the first eight numbers in row ``at`` of matrix argument ``n``."""
    array = cgutils.create_struct_proxy(signature.args[n])(context, builder, value=args[n])
    width = cgutils.unpack_tuple(builder, array.shape)[1]
    place = builder.gep(array.data, [builder.mul(at, width)])
    return builder.bitcast(place, DOUBLES.as_pointer())


@intrinsic
def copy_eight(typingctx, matrix, to, row):
    """Copy the first eight numbers of a row to another matrix."""

    def codegen(context, builder, signature, args):
        here, there = (_eight(context, builder, signature, args, n, args[2]) for n in (0, 1))
        builder.store(builder.load(here, align=8), there, align=8)
        return context.get_dummy_value()

    matrix = types.Array(types.float64, 2, "C")
    return types.void(matrix, matrix, types.int64), codegen


@intrinsic
def go_on(typingctx, matrix, before, search, share, row):
    """Extrapolate the first eight numbers of a row along their change since ``before``.

    The new ``search`` is this change, plus ``share`` times the old ``search`` if ``share`` is positive. The
    numbers move by the latter term, and ``before`` is set to the result.
    """

    def codegen(context, builder, signature, args):
        places = [_eight(context, builder, signature, args, n, args[4]) for n in range(3)]
        now, before, search = (builder.load(place, align=8) for place in places)
        share = splat(builder, args[3], DOUBLES)
        more = builder.fmul(share, search)
        zero = ir.Constant(DOUBLES, [0.0] * LANES)
        more = builder.select(
            builder.fcmp_ordered(">", args[3], ir.Constant(ir.DoubleType(), 0.0)), more, zero
        )
        search = builder.fadd(builder.fsub(now, before), more)
        now = builder.fadd(now, more)
        for value, place in zip((now, now, search), places, strict=True):
            builder.store(value, place, align=8)
        return context.get_dummy_value()

    d = types.float64
    matrix = types.Array(d, 2, "C")
    return types.void(matrix, matrix, matrix, d, types.int64), codegen
