"""Types of calls that the compiler finds once, and remembers while it compiles a kernel and what that calls.

numba has up to a hundred templates for a function like ``+`` or an array's item, and tries them in turn at
each call, though the types of the arguments are mostly those of a call before.
"""

# pyright: reportAttributeAccessIssue=false
# numba makes much of what it offers at run time

from numba.core.compiler_lock import global_compiler_lock
from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction


def remembering(function, *args):
    """``function(*args)``, where calls of numba's own functions with the same types have the same type."""
    with global_compiler_lock:  # no other thread finds types meanwhile
        find = BaseFunction.get_call_type
        if find.__module__ == __name__:  # a caller is being compiled, and remembers already
            return function(*args)
        BaseFunction.get_call_type = _remembered(find)
        try:
            return function(*args)
        finally:
            BaseFunction.get_call_type = find


def _remembered(find):
    """A method that asks ``find`` for what it was not asked before; errors are not remembered."""
    found = {}

    def get_call_type(called, context, args, kws):
        options = ConfigStack.top_or_none()
        key = id(called), context, tuple(args), tuple(kws.items()), options and options.summary()
        if key not in found:
            found[key] = find(called, context, args, kws), called  # which keeps its id for itself
        return found[key][0]

    return get_call_type
