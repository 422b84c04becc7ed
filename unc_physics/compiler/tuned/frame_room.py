"""Room for Python's frames while the compiler works.

Python keeps frames in pieces of 16 kB, which it takes from the system one by one, and gives each back as soon
as it is empty. Where a loop happens to call a function at the end of a piece, each call costs two system
calls and the page's first touch: 1.2 million times in a first prediction, a sixth of its time.
"""

from types import FunctionType

#: Of a frame [words]: it needs a piece of 1 MB, and leaves half of that to the frames above.
_WORDS = 70_000


def _call(function, *args):
    return function(*args)


#: ``function(*args)``, with room for some thousand frames in one piece.
with_room = FunctionType(_call.__code__.replace(co_stacksize=_WORDS), {}, "with_room")
