"""Two or four columns of an error state's transition at once, as explicit vector instructions."""

from llvmlite import ir
from numba import types
from numba.core import cgutils

from ...compiler.simd import integer, intrinsic, splat
from ...spatial.layout import EP, ER, ERROR, EV, EW


def _transition_of(columns):
    """Return an intrinsic of `drift_derivative.apply_transition` for so many columns, from ``column`` on."""
    doubles = ir.VectorType(ir.DoubleType(), columns)

    def columns_of(typingctx, rows, first, column, dt, decay, rotation):
        def codegen(context, builder, signature, args):
            array = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=args[0])
            block = cgutils.create_struct_proxy(signature.args[5])(context, builder, value=args[5])
            width = cgutils.unpack_tuple(builder, array.shape)[1]
            at = builder.gep(array.data, [builder.add(builder.mul(args[1], width), args[2])])
            places = []
            for _ in range(ERROR):
                places.append(builder.bitcast(at, doubles.as_pointer()))
                at = builder.gep(at, [width])

            def load(row):
                return builder.load(places[row], align=8)

            def add(a, b, c):
                return builder.fadd(a, builder.fmul(b, c, ("contract",)), ("contract",))

            time, kept = splat(builder, args[3], doubles), splat(builder, args[4], doubles)
            spins = [load(EW + k) for k in range(3)]
            for k in range(3):
                velocity = load(EV + k)
                builder.store(add(load(EP + k), time, velocity), places[EP + k], align=8)
                builder.store(builder.fmul(kept, velocity), places[EV + k], align=8)
                angle = load(ER + k)
                for m in range(3):
                    entry = builder.load(builder.gep(block.data, [integer(3 * k + m)]))
                    angle = add(angle, splat(builder, entry, doubles), spins[m])
                builder.store(angle, places[ER + k], align=8)
            for k in range(3):
                builder.store(builder.fmul(kept, spins[k]), places[EW + k], align=8)
            return context.get_dummy_value()

        d = types.float64
        matrix = types.Array(d, 2, "C")
        return types.void(matrix, types.int64, types.int64, d, d, matrix), codegen

    return intrinsic(columns_of)


two_columns, four_columns = _transition_of(2), _transition_of(4)
