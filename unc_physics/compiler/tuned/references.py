"""NamedTuple arguments as single pointers between compiled functions.

numba passes a NamedTuple as all fields of all its arrays, several hundred for a `World`, at each call. That
is slow to compile, and costs time at each call that is not inlined. A `Reference` is a pointer to these
fields in the outermost function, with the NamedTuple's attributes. Its target is constant and lives until the
function that created it returns. A function that returns such an argument therefore takes it by value.
"""

# pyright: reportAttributeAccessIssue=false, reportArgumentType=false
# numba and llvmlite make much of what they offer at run time

import hashlib
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.imputils import impl_ret_borrowed
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import lower_cast, lower_getattr_generic, register_model

_POINTER = ir.IntType(8).as_pointer()


class Reference(types.Type):
    """Type of a pointer to a NamedTuple of type `of`."""

    def __init__(self, of):
        self.of = of
        digest = hashlib.sha256(str(of).encode()).hexdigest()[:12]
        super().__init__(name=f"{of.instance_class.__name__}_{digest}")  # part of symbols, so kept short

    @property
    def instance_class(self):
        """Class of the NamedTuple."""
        return self.of.instance_class

    def can_convert_from(self, typingctx, other):
        """Allow the NamedTuple itself where a reference is expected."""
        return Conversion.safe if other == self.of else None


def referred(kind: Any) -> Any:
    """Return the type by which a value is passed: NamedTuples by reference, others unchanged."""
    return Reference(kind) if isinstance(kind, types.BaseNamedTuple) else kind


def refers(kind: Any) -> bool:
    """Return whether a type is a reference, or contains one."""
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        return any(map(refers, parts))
    return isinstance(kind, Reference)


@register_model(Reference)
class _Model(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _POINTER)


@infer_getattr
class _Attributes(AttributeTemplate):
    key = Reference

    def generic_resolve(self, reference, attribute):
        if attribute in reference.of.fields:
            return referred(reference.of.types[reference.of.fields.index(attribute)])
        return None


@lower_getattr_generic(Reference)
def _attribute(context, builder, reference, pointer, attribute):
    place = reference.of.fields.index(attribute)
    kind = reference.of.types[place]
    if kind == types.none:
        return context.get_dummy_value()
    struct = builder.bitcast(pointer, context.get_value_type(reference.of).as_pointer())
    member = cgutils.gep_inbounds(builder, struct, 0, place)
    if isinstance(kind, types.BaseNamedTuple):
        return builder.bitcast(member, _POINTER)
    return impl_ret_borrowed(context, builder, kind, _read(builder, member))


def _read(builder, pointer):
    """Read the value at a pointer part by part, so that the optimizer can drop unused parts."""
    kind = pointer.type.pointee
    if not isinstance(kind, ir.LiteralStructType | ir.ArrayType):
        return builder.load(pointer)
    value = ir.Constant(kind, ir.Undefined)
    for place in range(len(kind.elements) if isinstance(kind, ir.LiteralStructType) else kind.count):
        value = builder.insert_value(
            value, _read(builder, cgutils.gep_inbounds(builder, pointer, 0, place)), place
        )
    return value


@lower_cast(types.BaseNamedTuple, Reference)
def _refer(context, builder, kind, reference, value):
    pointer = builder.bitcast(cgutils.alloca_once_value(builder, value), _POINTER)
    # Reads through what this returns cannot move before the value is stored.
    fence = ir.FunctionType(_POINTER, [_POINTER])
    return builder.asm(fence, "", "=r,0,~{memory}", [pointer], side_effect=True)
