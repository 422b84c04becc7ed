"""Standard normal numbers from keys; equal keys give equal numbers in any order of calls."""

import math
from statistics import NormalDist

import numpy as np

from ..compiler import inner, kernel

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31 = np.uint64(30), np.uint64(27), np.uint64(31)
_S12, _S24, _S36, _S48 = np.uint64(12), np.uint64(24), np.uint64(36), np.uint64(48)

_S11, _ONE, _TO_UNIT = np.uint64(11), np.uint64(1), 2.0**-53

_INDEX_BITS = 12
_INDEX = np.uint64(2**_INDEX_BITS - 1)

#: Number of successive entries read from `normal_table`.
RUN = 32


def normal_table():
    """Return shuffled quantiles of the normal distribution, (4096 + RUN,) float32.

    The end repeats the beginning. The quantiles are the midpoints of 4096 equally likely parts, scaled to
    variance 1. Numbers are read in runs that start at hashed indices (`places`). Each number is any quantile
    with equal probability, independent of other runs. Within a run no quantile repeats, which does not matter
    for the number of samples per contact. Separate draws would cost more than all other work on the numbers.
    """
    count = 2**_INDEX_BITS
    table = np.array([NormalDist().inv_cdf((k + 0.5) / count) for k in range(count)])
    table /= np.sqrt(np.mean(table**2))
    table = np.random.RandomState(0).permutation(table)  # NumPy guarantees this generator's stream
    return np.concatenate([table, table[:RUN]]).astype(np.float32)


@kernel
def mix(key):
    """Return a hash of a uint64 (the finalizer of SplitMix64, Steele, Lea and Flood 2014)."""
    key = (key ^ (key >> _S30)) * _MIX_1
    key = (key ^ (key >> _S27)) * _MIX_2
    return key ^ (key >> _S31)


@kernel
def combine(key, value):
    """Return a key that depends on another key and an integer."""
    return mix((key ^ mix(np.uint64(value) + _GOLDEN)) * _GOLDEN + _GOLDEN)


@inner
def two_normals(key, number):
    """Return two independent standard normal numbers for a key (Box-Muller)."""
    a, b = mix(combine(key, 2 * number)), mix(combine(key, 2 * number + 1))
    size = math.sqrt(-2.0 * math.log(np.float64((a >> _S11) + _ONE) * _TO_UNIT))
    angle = 2.0 * math.pi * np.float64(b >> _S11) * _TO_UNIT
    return size * math.cos(angle), size * math.sin(angle)


@kernel
def keys_of(seed, first, count):
    """Return keys (count,) uint64 of a seed and of the numbers from ``first`` on."""
    keys = np.empty(count, np.uint64)
    for k in range(count):
        keys[k] = combine(np.uint64(seed), first + k)
    return keys


@kernel
def places(key):
    """Return the start indices of nine runs of a key in `normal_table`.

    They are uint64, so that indexing needs no sign check.
    """
    a, b = mix(key + _GOLDEN), mix(key + _GOLDEN + _GOLDEN)
    return (
        a & _INDEX,
        a >> _S12 & _INDEX,
        a >> _S24 & _INDEX,
        a >> _S36 & _INDEX,
        a >> _S48 & _INDEX,
        b & _INDEX,
        b >> _S12 & _INDEX,
        b >> _S24 & _INDEX,
        b >> _S36 & _INDEX,
    )
