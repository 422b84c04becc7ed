"""Standard normal numbers from keys instead of a state: the same key gives the same numbers, in any order of calls."""

from statistics import NormalDist

import numpy as np
from numba import njit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31 = np.uint64(30), np.uint64(27), np.uint64(31)

_INDEX_BITS = 12
_UNUSED_BITS = 16 - _INDEX_BITS


def normal_table():
    """(4096,) array: the normal distribution's quantiles in the middle of 4096 equally likely parts, of variance 1.

    `normals` draws from these. That a sample has such a step in its distribution is far below what any number of
    samples that a contact is given can show, and a look-up costs a fifth of the quickest exact method (ziggurat).
    """
    count = 2**_INDEX_BITS
    table = np.array([NormalDist().inv_cdf((k + 0.5) / count) for k in range(count)])
    return table / np.sqrt(np.mean(table**2))


@njit(cache=True, nogil=True)
def mix(key):
    """Hash of a uint64 (the finaliser of SplitMix64, Steele, Lea and Flood 2014)."""
    key = (key ^ (key >> _S30)) * _MIX_1
    key = (key ^ (key >> _S27)) * _MIX_2
    return key ^ (key >> _S31)


@njit(cache=True, nogil=True)
def combine(key, value):
    """A key that depends on another key and an integer."""
    return mix((key ^ mix(np.uint64(value) + _GOLDEN)) * _GOLDEN + _GOLDEN)


@njit(cache=True, nogil=True)
def normals(key, out, hashes, indices, table):
    """Fill ``out`` with the standard normal numbers of a key.

    Parameters
    ----------
    key : uint64
    out : (n,) float64
    hashes, indices : (m,) uint64 and (4 m,) uint16, 4 m >= n
        The same memory, as the types that it is written and read as.
    table : (4096,) float64
        From `normal_table`; an argument, since a compiled function copies a global array at every call.
    """
    for k in range(len(hashes)):
        hashes[k] = mix(key + np.uint64(k) * _GOLDEN)
    for k in range(len(out)):
        out[k] = table[indices[k] >> _UNUSED_BITS]
