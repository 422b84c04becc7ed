"""Spheres of a packing that can touch a plane: those on its convex hull."""

import math

import numpy as np

from ..compiler import inner, kernel
from ..compiler.arrays import booleans, empty, full, integers
from ..compiler.simd import LANES

_DIRECTIONS, _ROUNDS = 4096, 700
_SHORTER = 0.99  # ratio of successive steps
_WAY = 1.0 / (1.0 - _SHORTER)  # sum of all remaining steps, in units of the next
_APART = 3.0 / math.sqrt(_DIRECTIONS)  # bound on the angle from any direction to the nearest of these [rad]
# relative to the packing's radius: spheres that protrude less count as inside, such as those that just touch
# a face
_TOLERANCE = 1e-8
_RAYS = 1500  # directions for the volume of a hull
_FAST = {"nnan", "nsz", "contract"}  # these flags allow loops to process several spheres at once


@inner(fastmath=_FAST)
def _write_heights(x, y, z, spheres, height):
    """Write the heights of ``spheres`` (4, n), centres and radii, along a direction; return the largest."""
    highest = -np.inf
    for k in range(len(height)):
        up = x * spheres[0, k] + y * spheres[1, k] + z * spheres[2, k] + spheres[3, k]
        height[k] = up
        highest = max(highest, up)
    return highest


@inner
def _first(height, value):
    """Return the first index of a value."""
    k = 0
    while height[k] != value:
        k += 1
    return k


@inner(fastmath=_FAST)
def _compare(d, highest, support, spheres, height, lead, best, most):
    """Record direction ``d`` for spheres nearest to its support; bound their lead in nearby directions."""
    cx, cy, cz = spheres[0, support], spheres[1, support], spheres[2, support]
    for k in range(len(height)):
        up = height[k] - highest
        best[k] = d if up > lead[k] else best[k]
        lead[k] = max(lead[k], up)
        u, v, w = spheres[0, k] - cx, spheres[1, k] - cy, spheres[2, k] - cz
        most[k] = max(most[k], up + _APART * math.sqrt(u * u + v * v + w * w))


@inner
def _direction(d):
    """Return direction ``d`` of `_DIRECTIONS` evenly spread ones."""
    z = 1.0 - (2.0 * d + 1.0) / _DIRECTIONS
    angle = math.pi * (1.0 + math.sqrt(5.0)) * d
    across = math.sqrt(1.0 - z * z)
    return across * math.cos(angle), across * math.sin(angle), z


@inner
def _comes_up(x, y, z, own, supports, height, size):
    """Return whether sphere ``own`` (4,) reaches beyond all ``supports`` in a nearby direction."""
    step = 0.05
    for _ in range(_ROUNDS):
        highest = _write_heights(x, y, z, supports, height)
        up = x * own[0] + y * own[1] + z * own[2] + own[3]
        if up - highest > _TOLERANCE * size:
            return True
        # towards the sphere and away from the support that hides it
        support = _first(height, highest)
        gx, gy = own[0] - supports[0, support], own[1] - supports[1, support]
        gz = own[2] - supports[2, support]
        along = gx * x + gy * y + gz * z
        gx, gy, gz = gx - along * x, gy - along * y, gz - along * z
        length = math.sqrt(gx * gx + gy * gy + gz * gz)
        if length == 0.0 or highest - up > _WAY * step * math.sqrt(length * length + along * along):
            return False  # the remaining steps cannot bring it up
        x, y, z = x + step * gx / length, y + step * gy / length, z + step * gz / length
        length = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        step *= _SHORTER
    return False


@kernel
def hull_spheres(centers, radii):
    """Find the indices of spheres that a plane can touch first.

    Parameters
    ----------
    centers : (n, 3) array
        Body frame [m].
    radii : (n,) array
        [m]

    Returns
    -------
    (h,) int64 array
        Ascending indices.

    Notes
    -----
    The supports in many directions are found first. Turning to a nearby direction raises a sphere by at most
    its distance to the support times the angle. Spheres that stay below their support are inside. The others
    are compared with the supports in their best direction, which is improved iteratively.
    """
    n = len(radii)
    spheres = empty((4, n))
    size = 0.0
    for k in range(n):
        for a in range(3):
            spheres[a, k] = centers[k, a]
        spheres[3, k] = radii[k]
        size = max(size, math.sqrt(centers[k, 0] ** 2 + centers[k, 1] ** 2 + centers[k, 2] ** 2) + radii[k])
    kept = booleans(n)
    lead, most, best, height = full(n, -np.inf), full(n, -np.inf), integers(n), empty(n)
    for d in range(_DIRECTIONS):
        x, y, z = _direction(d)
        highest = _write_heights(x, y, z, spheres, height)
        support = _first(height, highest)
        kept[support] = True
        _compare(d, highest, support, spheres, height, lead, best, most)
    supports = np.ascontiguousarray(spheres[:, np.flatnonzero(kept)])
    height = empty(supports.shape[1])
    for s in range(n):
        if not kept[s] and most[s] >= 0.0:
            x, y, z = _direction(best[s])
            kept[s] = _comes_up(x, y, z, spheres[:, s], supports, height, size)
    return np.flatnonzero(kept)


def hull_volume(centers, radii, normals):
    """Return the volume of the convex hull of spheres [m^3], within about 1 %.

    Parameters
    ----------
    centers : (h, 3) array
        Body frame [m].
    radii : (h,) array
        [m]
    normals : (f, 3) array
        Normals of its flat faces.
    """
    low, high = (centers - radii[:, None]).min(axis=0), (centers + radii[:, None]).max(axis=0)
    half = 0.5 * (high - low)  # scaled to a cube, so that directions are even
    k = np.arange(_RAYS) + 0.5
    z, angle = 1.0 - 2.0 * k / _RAYS, math.pi * (1.0 + math.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    rays = np.column_stack([across * np.cos(angle), across * np.sin(angle), z])
    planes = np.concatenate([rays, np.eye(3), -np.eye(3), normals * half])
    planes /= np.linalg.norm(planes, axis=1)[:, None]
    sides = planes / half
    heights = sides @ (centers - 0.5 * (low + high)).T + np.linalg.norm(sides, axis=1)[:, None] * radii
    with np.errstate(divide="ignore"):
        nearness = np.max(rays @ planes.T / heights.max(axis=1), axis=1)
    return float(np.prod(half) * 4.0 / 3.0 * math.pi * np.mean(nearness**-3.0))


def hull_columns(centers, radii, hull):
    """Return centres and radii of a hull's spheres, (4, H + 8); the padding allows reads of eight columns."""
    columns = np.zeros((4, len(hull) + LANES))
    columns[:3, : len(hull)], columns[3, : len(hull)] = centers[hull].T, radii[hull]
    return columns
