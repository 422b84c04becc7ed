"""Between what messages hold and the arrays that the core takes."""

from __future__ import annotations

from array import array as packed_array
from collections.abc import Sequence

import numpy as np

from ..physics.layout import ERROR


def xyz(v) -> tuple[float, float, float]:
    """The numbers of a Point or a Vector3."""
    return v.x, v.y, v.z


def xyzw(q) -> tuple[float, float, float, float]:
    """The numbers of a Quaternion."""
    return q.x, q.y, q.z, q.w


def packed(numbers) -> packed_array:
    """Numbers for a field of any length, which takes no NumPy array."""
    return packed_array("d", np.ascontiguousarray(numbers, float).tobytes())


def writable(a) -> np.ndarray:
    """A copy: read-only arrays would compile every kernel once more."""
    return np.array(a)


def block_diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """(12 M, 12 M) from M blocks (12, 12)."""
    count = len(blocks)
    whole = np.zeros((count, ERROR, count, ERROR))
    for k, block in enumerate(blocks):
        whole[k, :, k, :] = block
    return whole.reshape(count * ERROR, count * ERROR)
