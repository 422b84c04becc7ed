"""Surfaces of revolution as pieces: a profile that is not convex is cut into convex parts."""

from __future__ import annotations

import math
from collections import defaultdict
from functools import lru_cache

import numpy as np

from .pieces import Hull, Lathe, Piece, convex_outline, polygon_area

_SAMPLES = 24  # points of each edge at which it is checked whether a hull sticks out
_LEVEL = 1e-12  # share of the squared size: smaller areas count as zero
_ON_AXIS = 1e-7  # distance from the axis [m], or angle [rad], that is round-off
_SMOOTH = 0.9  # cosine of the angle between two edges of a smooth profile (26 degrees), at least
_BULGE = 1e-3  # share of the extent by which arcs are off their chords, at most; corners are sharp otherwise
_STRAIGHT = 4.0  # ratio of lengths of neighbouring edges from which the longer one is straight
_NEIGHBOURS = 0.125  # share of the extent by which arcs go on beyond a piece, at least
_SECTORS = 1 << 12  # of a ring, at most; a tolerance that needs more is not met


@lru_cache(maxsize=256)
def turns(pieces: tuple[Piece, ...]) -> np.ndarray:
    """Return the projection (3, 3) of rotations about the origin onto those that leave the pieces unchanged.

    It is 1 for balls in the origin, ``a a^T`` for whole turns about an axis a, and 0 for others. A ring of
    sectors counts as a whole turn.
    """
    nothing, directions, sectors = np.zeros((3, 3)), [], defaultdict(float)
    for piece in pieces:
        if isinstance(piece, Lathe):
            directions += [piece.axes[:, 2], piece.origin]
            sectors[piece.profile.tobytes()] += piece.half_angle
        elif isinstance(piece, Hull):
            directions += [*piece.points]
        else:
            return nothing
    if any(abs(angle - math.pi) > _ON_AXIS for angle in sectors.values()):
        return nothing
    lengths = np.linalg.norm(directions, axis=1)
    if not lengths.max() > _ON_AXIS:
        return np.eye(3)
    axis = directions[int(lengths.argmax())] / lengths.max()
    away = np.linalg.norm(np.cross(axis, directions), axis=1).max()
    return nothing if away > _ON_AXIS else np.outer(axis, axis)


def lathe_pieces(profile: np.ndarray, tolerance: float) -> list[Lathe]:
    """Return the pieces of a solid of revolution about z.

    Fewer parts of the profile are wider, and their rings need more sectors: of all numbers of parts, the one
    with the fewest pieces is taken.

    Parameters
    ----------
    profile : (k, 2) array
        Simple polygon of radius and height that bounds the solid's half section [m].
    tolerance : float
        Largest distance by which pieces may stick out of the solid, where it is hollow [m].

    Returns
    -------
    list of Lathe
        Whole ones where the solid reaches the axis, otherwise rings of sectors.
    """
    profile = _counter_clockwise(np.asarray(profile, float))
    stages = _stages(profile, tolerance)
    counts = {
        part: _count(convex_outline(profile[sorted(part)]), profile, tolerance)
        for part in frozenset().union(*stages)
    }
    fewest = min(stages, key=lambda parts: sum(counts[part] for part in parts))
    pieces = []
    normals = _normals(profile)
    for part in fewest:
        arcs = _arcs(profile, part, fewest, counts[part], normals)
        pieces += _turned(convex_outline(profile[sorted(part)]), counts[part], arcs)
    return pieces


def _normals(profile):
    """Return outward normals (k, 2, 2) of a profile at both ends of each edge; equal ones where it is smooth.

    At a corner of a circle the normal is the mean of those of the edges, weighted by each other's length. A
    much longer edge is straight, and has its own.
    """
    along = np.roll(profile, -1, axis=0) - profile
    length = np.linalg.norm(along, axis=1)
    own = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
    before, shorter = np.roll(own, 1, axis=0), np.roll(length, 1)
    mean = before * length[:, None] + own * shorter[:, None]
    mean = np.where((length > _STRAIGHT * shorter)[:, None], own, mean)
    mean = np.where((shorter > _STRAIGHT * length)[:, None], before, mean)
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", before, own)
    wide = np.minimum(np.maximum(length, shorter), _STRAIGHT * np.minimum(length, shorter))
    bulge = wide * np.arccos(np.clip(cosine, -1.0, 1.0)) / 8.0
    smooth = (cosine > _SMOOTH) & (bulge < _BULGE * float(np.ptp(profile, axis=0).max()))
    start, end = (
        np.where(smooth[:, None], mean, own),
        np.roll(np.where(smooth[:, None], mean, before), -1, axis=0),
    )
    tips = np.sign(own) * [0.0, 1.0]
    start = np.where(((profile[:, 0] == 0.0) & (np.abs(own[:, 1]) > _SMOOTH))[:, None], tips, start)
    following = np.roll(profile[:, 0], -1)
    end = np.where(((following == 0.0) & (np.abs(own[:, 1]) > _SMOOTH))[:, None], tips, end)
    return np.stack([start, end], axis=1)


def _arcs(profile, part, parts, count, normals):
    """Return the arcs (n, 2, 4) that sides of a part of a profile stand for: inner ones and chords.

    Neighbouring arcs follow, where the surface is smooth, as far again on either side.
    """
    numbers = {(*profile[k],): k for k in part}
    corners = [numbers[(*point,)] for point in convex_outline(profile[sorted(part)])]
    found = set()
    length = np.linalg.norm(np.roll(profile, -1, axis=0) - profile, axis=1)
    least = _NEIGHBOURS * float(np.ptp(profile, axis=0).max())
    for i, j in zip(corners, [*corners[1:], corners[0]], strict=True):
        edges = (j - i) % len(profile)
        inwards = count > 1 and profile[j, 1] < profile[i, 1]
        if any({i, j} <= other for other in parts if other is not part) or not (edges > 1 or inwards):
            continue  # a seam, or the surface itself
        chain = [(i + k) % len(profile) for k in range(edges)]
        reach = max(least, length[chain].sum())
        found.update(chain)
        for k, step in ((chain[0], -1), (chain[-1], 1)):
            way = 0.0
            while way < reach:
                a, b = (k - 1, k) if step < 0 else (k, (k + 1) % len(profile))
                if normals[a, 1] @ normals[b, 0] < 1.0 - 1e-9:
                    break
                k = (k + step) % len(profile)
                if k in found:
                    break
                found.add(k)
                way += length[k]
    ends = [(k, (k + 1) % len(profile)) for k in sorted(found)]
    return np.array(
        [[[*profile[a], *normals[a, 0]], [*profile[b], *normals[a, 1]]] for a, b in ends]
    ).reshape(-1, 2, 4)


def _count(part, profile, tolerance):
    """Return how many pieces a part of a profile needs: 1 whole lathe, or a ring of at least 3 sectors.

    Half-way between its ends, a sector is the hull of the part and of its copy at the chords.
    """

    def sticks_out(count):
        chords = part * [math.cos(math.pi / count) if count > 1 else 0.0, 1.0]
        return _sticks_out(convex_outline(np.concatenate([part, chords])), profile) > tolerance

    if not sticks_out(1):
        return 1
    low, high = 2, 4
    while high < _SECTORS and sticks_out(high):
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if sticks_out(middle) else (low, middle)
    return high


def _turned(part, count, arcs):
    """Return a convex part of a profile as one whole lathe or as sectors."""
    if count == 1:
        return [Lathe(convex_outline(np.concatenate([part, part * [0.0, 1.0]])), arcs=arcs)]
    half = math.pi / count
    return [Lathe(part, azimuth=half * (2 * k + 1), half_angle=half, arcs=arcs) for k in range(count)]


def convex_parts(polygon: np.ndarray, tolerance: float) -> list[np.ndarray]:
    """Return convex polygons that cover a simple polygon and stick out of it by at most ``tolerance`` [m].

    Triangles are merged in the order of how little the hull of two neighbours sticks out.
    """
    polygon = _counter_clockwise(np.asarray(polygon, float))
    return [convex_outline(polygon[sorted(part)]) for part in _stages(polygon, tolerance)[-1]]


def _stages(polygon, tolerance):
    """Return the parts (their corners) of a polygon after each merge that costs at most a tolerance [m]."""
    parts = {k: frozenset(triangle) for k, triangle in enumerate(_triangles(polygon))}
    following = len(parts)
    costs: dict[tuple[int, int], float] = {}

    def add_costs(new):
        for old, corners in parts.items():
            if old != new and len(corners & parts[new]) >= 2:
                hull = convex_outline(polygon[sorted(corners | parts[new])])
                costs[min(old, new), max(old, new)] = _sticks_out(hull, polygon)

    for k in list(parts):
        add_costs(k)
    stages = [list(parts.values())]
    while costs:
        (a, b), cost = min(costs.items(), key=lambda item: (item[1], item[0]))
        if cost > tolerance:
            break
        parts[following] = parts.pop(a) | parts.pop(b)
        costs = {pair: value for pair, value in costs.items() if not {a, b} & set(pair)}
        add_costs(following)
        following += 1
        stages.append(list(parts.values()))
    return stages


def _counter_clockwise(polygon):
    return polygon if polygon_area(polygon) > 0.0 else polygon[::-1]


def _area(a, b, c):
    """Return twice the signed area of triangles."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
        c[..., 0] - a[..., 0]
    )


def _triangles(polygon):
    """Return triangles (indices) of a simple polygon by clipping the roundest ear first."""
    left = list(range(len(polygon)))
    least = _LEVEL * float(np.ptp(polygon, axis=0).max()) ** 2
    found = []
    while len(left) > 3:
        best, ear = -np.inf, 0
        for k in range(len(left)):
            triangle = left[k - 1], left[k], left[(k + 1) % len(left)]
            a, b, c = polygon[list(triangle)]
            if _area(a, b, c) <= least:
                continue
            others = polygon[[v for v in left if v not in triangle]]
            inside = (
                (_area(a, b, others) > -least)
                & (_area(b, c, others) > -least)
                & (_area(c, a, others) > -least)
            )
            quality = _area(a, b, c) / max(np.sum((b - a) ** 2), np.sum((c - b) ** 2), np.sum((a - c) ** 2))
            if not inside.any() and quality > best:
                best, ear = quality, k
        if best > -np.inf:
            found.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]  # without an ear, a corner on a straight line
    found.append(tuple(left))
    return found


def _sticks_out(hull, polygon):
    """Return the largest distance by which the boundary of a hull is outside a polygon."""
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    points = (hull[:, None] + share[:, None] * (np.roll(hull, -1, axis=0) - hull)[:, None]).reshape(-1, 2)
    return float(outside_polygon(points, polygon).max(initial=0.0))


def outside_polygon(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Return the distances (n,) of points (n, 2) outside of a simple polygon (k, 2)."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    along = b - a
    offset = points[:, None] - a
    t = np.clip((offset * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-300), 0.0, 1.0)
    distance = np.linalg.norm(offset - t[..., None] * along, axis=2).min(axis=1)
    above = (a[:, 1] > points[:, None, 1]) != (b[:, 1] > points[:, None, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = a[:, 0] + (points[:, None, 1] - a[:, 1]) / along[:, 1] * along[:, 0]
    inside = np.sum(above & (points[:, None, 0] < crossing), axis=1) % 2 == 1
    return np.where(inside, 0.0, distance)
