"""Stack space for Python frames during compilation.

Python allocates frames in chunks of 16 kB and frees each as soon as it is empty. If a loop calls a function
at the end of a chunk, each call costs two system calls and a page fault. That happens 1.2 million times in a
first prediction, a sixth of its time.
"""

from types import FunctionType

#: Size of a frame [words] that requires a chunk of 1 MB and leaves half of it to the frames above.
_WORDS = 70_000


def _call(function, *args):
    return function(*args)


#: Call ``function(*args)`` with room for some thousand frames in one chunk.
with_room = FunctionType(_call.__code__.replace(co_stacksize=_WORDS), {}, "with_room")
