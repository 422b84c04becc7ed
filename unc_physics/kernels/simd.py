"""Eight comparisons at once: the one place that asks LLVM for vectors by name.

A plain loop over eight entries is unrolled by LLVM before its vectoriser sees it and stays scalar, five times
slower. Written as vector instructions, LLVM lowers it to whatever the processor has.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_LANES = 8
_FLOATS = ir.VectorType(ir.FloatType(), _LANES)


def _splat(builder, scalar):
    one = builder.insert_element(ir.Constant(_FLOATS, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), _LANES), [0] * _LANES)
    return builder.shuffle_vector(one, ir.Constant(_FLOATS, ir.Undefined), zeros)


@intrinsic
def overlap_mask(typingctx, bounds, node, x, y, z, radius):
    """Bit m is set where entry m of ``bounds[node]`` (4, 8: x, y, z, radius) overlaps the sphere given by four float32."""

    def codegen(context, builder, signature, args):
        array = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=args[0])
        offset = builder.mul(args[1], ir.Constant(ir.IntType(64), 4))
        rows = builder.bitcast(array.data, _FLOATS.as_pointer())

        def row(k):
            place = builder.gep(rows, [builder.add(offset, ir.Constant(ir.IntType(64), k))])
            return builder.load(place, align=4)

        distance2 = None
        for k in range(3):
            d = builder.fsub(row(k), _splat(builder, args[2 + k]))
            d2 = builder.fmul(d, d)
            distance2 = d2 if distance2 is None else builder.fadd(distance2, d2)
        reach = builder.fadd(row(3), _splat(builder, args[5]))
        hit = builder.fcmp_ordered("<", distance2, builder.fmul(reach, reach))
        return builder.zext(builder.bitcast(hit, ir.IntType(_LANES)), ir.IntType(64))

    f = types.float32
    array = types.Array(f, 3, "C", readonly=not bounds.mutable)
    return types.int64(array, types.int64, f, f, f, f), codegen
