"""Quasi-random standard normal numbers: Sobol's sequence, scrambled, through the quantile function."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ..compiler import kernel
from ..spatial.random import combine

#: Primitive polynomials, the leading and the last bit included, and initial direction numbers, of each
#: dimension but the first (Joe and Kuo 2008, new-joe-kuo-6).
_DIMENSIONS = (
    (3, (1,)), (7, (1, 3)), (11, (1, 3, 1)), (13, (1, 1, 1)), (19, (1, 1, 3, 3)), (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)), (41, (1, 1, 5, 5, 5)), (47, (1, 1, 7, 11, 19)), (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)), (61, (1, 3, 5, 5, 31)), (67, (1, 3, 3, 9, 7, 49)), (91, (1, 1, 1, 15, 21, 21)),
    (97, (1, 3, 1, 13, 27, 49)), (103, (1, 1, 1, 15, 7, 5)), (109, (1, 3, 1, 15, 13, 25)),
    (115, (1, 1, 5, 5, 19, 61)), (131, (1, 3, 7, 11, 23, 15, 103)), (137, (1, 3, 7, 13, 13, 15, 69)),
    (143, (1, 1, 3, 13, 7, 35, 63)), (145, (1, 3, 5, 9, 1, 25, 53)), (157, (1, 3, 1, 13, 9, 35, 107)),
    (167, (1, 3, 1, 5, 27, 61, 31)), (171, (1, 1, 5, 11, 19, 41, 61)), (185, (1, 3, 5, 3, 3, 13, 69)),
    (191, (1, 1, 7, 13, 1, 19, 1)), (193, (1, 3, 7, 5, 13, 19, 59)), (203, (1, 1, 3, 9, 25, 29, 41)),
    (211, (1, 3, 5, 13, 23, 1, 55)), (213, (1, 3, 7, 3, 13, 59, 17)),
)  # fmt: skip
_BITS = 32


@lru_cache(maxsize=32)
def normal_points(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Return scrambled Sobol points as standard normal numbers (count, dimensions); read-only."""
    points = np.empty((count, dimensions))
    _fill(points, _directions(), np.uint64(seed))
    points.flags.writeable = False
    return points


@lru_cache(maxsize=1)
def _directions():
    """Return the direction numbers (D, 32) uint64 of each dimension, the highest bit first."""
    table = np.empty((len(_DIMENSIONS) + 1, _BITS), np.uint64)
    table[0] = [1 << (_BITS - 1 - k) for k in range(_BITS)]
    for d, (polynomial, initial) in enumerate(_DIMENSIONS, 1):
        degree, m = polynomial.bit_length() - 1, list(initial)
        for k in range(degree, _BITS):
            new = m[k - degree] ^ (m[k - degree] << degree)
            for j in range(1, degree):
                if polynomial >> (degree - j) & 1:
                    new ^= m[k - j] << j
            m.append(new)
        table[d] = [m[k] << (_BITS - 1 - k) for k in range(_BITS)]
    return table


@kernel
def _fill(points, directions, seed):
    """Write points (N, D): nested uniform scrambling (Owen 1995) by hashing (Laine and Karras 2011)."""
    count, dimensions = points.shape
    per_set = len(directions)
    for d in range(dimensions):
        which = d // per_set
        key = combine(seed, d)
        order = combine(combine(seed, 2**20 + which), 1)
        for n in range(count):
            index = np.uint64(n)
            if which > 0:
                index = _scrambled(index, order)
            x = np.uint64(0)
            bit = 0
            while index > np.uint64(0):
                if index & np.uint64(1):
                    x ^= directions[d % per_set, bit]
                index >>= np.uint64(1)
                bit += 1
            x = _scrambled(x, key)
            points[n, d] = quantile((float(x) + 0.5) / 4294967296.0)


@kernel
def _scrambled(x, key):
    """Return numbers in which each of 32 bits is flipped by a hash of the bits above it."""
    result = np.uint64(0)
    prefix = key
    for k in range(_BITS):
        shift = np.uint64(_BITS - 1 - k)
        bit = (x >> shift) & np.uint64(1)
        result |= (bit ^ (prefix >> np.uint64(63))) << shift
        prefix = combine(prefix, bit + np.uint64(1))
    return result


@kernel
def quantile(p):
    """Return the standard normal quantile of a probability in (0, 1) (Wichura 1988, AS 241)."""
    q = p - 0.5
    if abs(q) <= 0.425:
        r = 0.180625 - q * q
        return (
            q
            * (((((((2509.0809287301226727 * r + 33430.575583588128105) * r + 67265.770927008700853) * r
                + 45921.953931549871457) * r + 13731.693765509461125) * r + 1971.5909503065514427) * r
                + 133.14166789178437745) * r + 3.387132872796366608)
            / (((((((5226.495278852545925 * r + 28729.085735721942674) * r + 39307.89580009271061) * r
                + 21213.794301586595867) * r + 5394.1960214247511077) * r + 687.1870074920579083) * r
                + 42.313330701600911252) * r + 1.0)
        )  # fmt: skip
    r = math.sqrt(-math.log(p if q < 0.0 else 1.0 - p))
    if r <= 5.0:
        r -= 1.6
        x = (
            (((((((7.7454501427834140764e-4 * r + 0.0227238449892691845833) * r + 0.24178072517745061177) * r
                + 1.27045825245236838258) * r + 3.64784832476320460504) * r + 5.7694972214606914055) * r
                + 4.6303378461565452959) * r + 1.42343711074968357734)
            / (((((((1.05075007164441684324e-9 * r + 5.475938084995344946e-4) * r
                + 0.0151986665636164571966) * r + 0.14810397642748007459) * r + 0.68976733498510000455) * r
                + 1.6763848301838038494) * r + 2.05319162663775882187) * r + 1.0)
        )  # fmt: skip
    else:
        r -= 5.0
        x = (
            (((((((2.01033439929228813265e-7 * r + 2.71155556874348757815e-5) * r
                + 0.0012426609473880784386) * r + 0.026532189526576123093) * r + 0.29656057182850489123) * r
                + 1.7848265399172913358) * r + 5.4637849111641143699) * r + 6.6579046435011037772)
            / (((((((2.04426310338993978564e-15 * r + 1.4215117583164458887e-7) * r
                + 1.8463183175100546818e-5) * r + 7.868691311456132591e-4) * r
                + 0.0148753612908506148525) * r + 0.13692988092273580531) * r
                + 0.59983220655588793769) * r + 1.0)
        )  # fmt: skip
    return -x if q < 0.0 else x
