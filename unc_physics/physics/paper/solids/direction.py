"""Unit vectors with a defined value for zero vectors."""

import math

from ....compiler import inner

_NOWHERE = 1e-150  # m: the squares of shorter vectors underflow


@inner(error_model="numpy", forceinline=True)
def unit(x, y, z):
    """Return the length of a vector and its direction; the x axis if the length underflows."""
    length = math.sqrt(x * x + y * y + z * z)
    if _NOWHERE < length < math.inf:
        return length, (x / length, y / length, z / length)
    return length, (1.0, 0.0, 0.0)
