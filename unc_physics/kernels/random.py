"""Standard normal numbers from keys instead of a state: the same key gives the same number, in any order of calls."""

import math

import numpy as np
from numba import njit

_LAYERS = 256
_TAIL = 3.6541528853610088  # where the base layer's tail begins (Doornik 2005, for 256 layers)

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31, _S12, _S8 = (np.uint64(s) for s in (27, 30, 31, 12, 8))
_BYTE = np.uint64(255)
_UNIT = 2.0**-52


def _ziggurat():
    """Right edges of the layers, widest first, and the share of each layer that lies wholly under the curve."""
    density = math.exp(-0.5 * _TAIL**2)
    area = _TAIL * density + math.sqrt(0.5 * math.pi) * math.erfc(_TAIL / math.sqrt(2.0))
    edges = [area / density, _TAIL]
    while len(edges) < _LAYERS:
        edges.append(math.sqrt(-2.0 * math.log(area / edges[-1] + math.exp(-0.5 * edges[-1] ** 2))))
    edges = np.array([*edges, 0.0])
    return edges, edges[1:] / edges[:-1]


_EDGES, _INNER = _ziggurat()


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
def _uniform(bits):
    """A number in (0, 1) from the upper bits of a hash."""
    return (np.float64(bits >> _S12) + 0.5) * _UNIT


@njit(cache=True, nogil=True)
def _beside(bits):
    """A standard normal number where the ziggurat's layer is not wholly under the curve; draws on from ``bits``."""
    while True:
        layer = np.int64(bits & _BYTE)
        u = 2.0 * _uniform(bits) - 1.0
        if abs(u) < _INNER[layer]:
            return u * _EDGES[layer]
        bits = mix(bits + _GOLDEN)
        if layer == 0:
            while True:
                x = math.log(_uniform(bits)) / _TAIL
                bits = mix(bits + _GOLDEN)
                y = math.log(_uniform(bits))
                bits = mix(bits + _GOLDEN)
                if -2.0 * y > x * x:
                    return x - _TAIL if u < 0.0 else _TAIL - x
        x = u * _EDGES[layer]
        outer = math.exp(-0.5 * (_EDGES[layer] ** 2 - x * x))
        inner = math.exp(-0.5 * (_EDGES[layer + 1] ** 2 - x * x))
        if inner + _uniform(bits) * (outer - inner) < 1.0:
            return x
        bits = mix(bits + _GOLDEN)


@njit(cache=True, nogil=True)
def normals(key, out):
    """Fill the vector ``out`` with the standard normal numbers of ``key`` (ziggurat, Marsaglia and Tsang 2000)."""
    for k in range(len(out)):
        bits = mix(key + np.uint64(k) * _GOLDEN)
        layer = np.int64(bits & _BYTE)
        u = 2.0 * _uniform(bits) - 1.0
        out[k] = u * _EDGES[layer] if abs(u) < _INNER[layer] else _beside(bits)
