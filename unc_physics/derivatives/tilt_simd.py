"""SIMD operations on the tilts of a body, eight at once (as in `compiler.simd`)."""

from numba import types
from numba.core import cgutils

from ..compiler.simd import DOUBLES, integer, intrinsic, splat

#: Rows of a room of tilts (4, T), T a multiple of 8: cosine and sine of a tilt, the least depth of spheres
#: at it [m], and which sphere has it.
COS, SIN, DEPTH, LOWEST = range(4)


@intrinsic
def lower_depths(typingctx, room, first, p, q, r, k):
    """Store the depth of a sphere, and its number, at those of eight tilts at which it is the least so far.

    Parameters
    ----------
    room : (4, T) array
    first : int
        Of the eight tilts.
    p, q : float
        Coordinates of the sphere's centre along the normal, and along the tilt [m].
    r : float
        Its radius [m].
    k : float
        Its number.
    """

    def codegen(context, builder, signature, args):
        array = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=args[0])
        size = cgutils.unpack_tuple(builder, array.shape)[1]

        def place(row):
            start = builder.add(builder.mul(size, integer(row)), args[1])
            return builder.bitcast(builder.gep(array.data, [start]), DOUBLES.as_pointer())

        p, q, r, number = (splat(builder, one, DOUBLES) for one in args[2:])
        cosine, sine, depth, lowest = (builder.load(place(row), align=8) for row in range(4))
        new = builder.fsub(builder.fadd(builder.fmul(cosine, p), builder.fmul(sine, q)), r)
        less = builder.fcmp_ordered("<", new, depth)
        builder.store(builder.select(less, new, depth), place(DEPTH), align=8)
        builder.store(builder.select(less, number, lowest), place(LOWEST), align=8)
        return context.get_dummy_value()

    d = types.float64
    return types.void(types.Array(d, 2, "C"), types.int64, d, d, d, d), codegen
