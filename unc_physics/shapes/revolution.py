"""Surfaces of revolution as pieces: a profile that is not convex is cut into convex parts."""

from __future__ import annotations

import math
from collections import defaultdict
from functools import lru_cache

import numpy as np

from .pieces import Hull, Lathe, Piece, convex_outline

_SAMPLES = 24  # points of each edge at which it is checked whether a hull sticks out
_LEVEL = 1e-12  # share of the squared size: smaller areas count as zero
_ON_AXIS = 1e-7  # distance from the axis [m], or angle [rad], that is round-off
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


def lathe_pieces(profile: np.ndarray, tolerance: float, both_ways: bool = False) -> list[Lathe]:
    """Return the pieces of a solid of revolution about z.

    Fewer parts of the profile are wider, and their rings need more sectors: of all numbers of parts, the one
    with the fewest pieces is taken.

    Parameters
    ----------
    profile : (k, 2) array
        Simple polygon of radius and height that bounds the solid's half section [m].
    tolerance : float
        Largest distance by which pieces may stick out of the solid, where it is hollow [m].
    both_ways : bool
        Whether hollow sides lie half of this distance too far out and half too far in, as far as walls are
        thick enough. Otherwise pieces cover the solid.

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
    corners = _recessed(profile, fewest, counts) if both_ways else profile
    pieces = []
    for part in fewest:
        outline = [k for k in _numbers(convex_outline(profile[sorted(part)]), profile, part) if k is not None]
        pieces += _turned(convex_outline(corners[outline]), counts[part])
    return pieces


def _numbers(points, profile, part):
    """Return the number of each point among a part's corners of a profile, or None."""
    numbers = {(*profile[k],): k for k in part}
    return [numbers.get((*point,)) for point in points]


def _recessed(profile, parts, counts):
    """Return a profile whose hollow corners are moved into the solid, by half of what pieces stick out there.

    Corners of the solid's convex hull stay, on which it stands, and one that would come close to the other
    side of a thin wall moves less.
    """
    way, depth = np.zeros_like(profile), np.zeros(len(profile))
    for part in parts:
        corners, count = profile[sorted(part)], counts[part]
        hull = convex_outline(corners if count > 1 else np.concatenate([corners, corners * [0.0, 1.0]]))
        numbers = _numbers(hull, profile, part)
        for k, (a, b) in enumerate(zip(hull, np.roll(hull, -1, axis=0), strict=True)):
            ends = {number for number in (numbers[k], numbers[(k + 1) % len(hull)]) if number is not None}
            if len(ends) == 2 and any(ends <= other for other in parts if other is not part):
                continue  # a seam
            points = a + ((np.arange(_SAMPLES) + 0.5) / _SAMPLES)[:, None] * (b - a)
            out = np.array([b[1] - a[1], a[0] - b[0]])
            height = _outside(points, profile).max()
            if out[0] < 0.0 and count > 1:
                height = max(height, _outside(points * [math.cos(math.pi / count), 1.0], profile).max())
            if height > 0.0:
                ends = list(ends)
                way[ends] -= out / np.linalg.norm(out)
                depth[ends] = np.maximum(depth[ends], height)
    step = 0.5 * depth[:, None] * way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    step[profile[:, 0] == 0.0, 0] = 0.0
    outer = {(*point,) for point in convex_outline(np.concatenate([profile, profile * [-1.0, 1.0]]))}
    step[[(*point,) in outer for point in profile]] = 0.0
    share = np.zeros(len(profile))
    for one in (0.125, 0.25, 0.5, 1.0):
        share = np.where(_outside(profile + (1.5 * one) * step, profile) == 0.0, one, share)
    return profile + share[:, None] * step


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


def _turned(part, count):
    """Return a convex part of a profile as one whole lathe or as sectors."""
    if count == 1:
        return [Lathe(convex_outline(np.concatenate([part, part * [0.0, 1.0]])))]
    half = math.pi / count
    return [Lathe(part, azimuth=half * (2 * k + 1), half_angle=half) for k in range(count)]


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
    x, y = polygon.T
    return polygon if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0.0 else polygon[::-1]


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
    return float(_outside(points, polygon).max(initial=0.0))


def _outside(points, polygon):
    """Return the distances (n,) of points (n, 2) outside of a polygon."""
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
