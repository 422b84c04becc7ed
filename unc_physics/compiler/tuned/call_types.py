"""Cache of call types during the compilation of a kernel and its callees.

numba has up to a hundred templates for a function such as ``+`` or array indexing, and tries one after
another at each call. The argument types mostly repeat an earlier call.
"""

# pyright: reportAttributeAccessIssue=false
# numba makes much of what it offers at run time

from numba.core.compiler_lock import global_compiler_lock
from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction


def remembering(function, *args):
    """Call ``function(*args)`` with a cache of the types of calls to numba's own functions."""
    with global_compiler_lock:  # no other thread infers types meanwhile
        find = BaseFunction.get_call_type
        if find.__module__ == __name__:  # a caller is being compiled and has a cache already
            return function(*args)
        BaseFunction.get_call_type = _remembered(find)
        try:
            return function(*args)
        finally:
            BaseFunction.get_call_type = find


def _remembered(find):
    """Return a method that caches the results of ``find``; errors are not cached."""
    found = {}

    def get_call_type(called, context, args, kws):
        options = ConfigStack.top_or_none()
        key = id(called), context, tuple(args), tuple(kws.items()), options and options.summary()
        if key not in found:
            found[key] = find(called, context, args, kws), called  # the reference keeps its id unique
        return found[key][0]

    return get_call_type
