"""Surfaces of revolution as pieces: a profile that is not convex is cut into convex parts."""

from __future__ import annotations

import numpy as np

from .pieces import Lathe, convex_outline, ring

#: Shares of the tolerance for the profile that are tried; the rest is for the chords of a ring's sectors.
_SHARES = 0.2, 0.35, 0.5, 0.65, 0.8
_SAMPLES = 24  # points of each edge at which it is checked whether a hull sticks out
_LEVEL = 1e-12  # share of the squared size: smaller areas count as zero


def lathe_pieces(profile: np.ndarray, tolerance: float) -> list[Lathe]:
    """Return the pieces of a solid of revolution about z.

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
    stages = _stages(profile, max(_SHARES) * tolerance)
    return min((_pieces(profile, stages, tolerance, share) for share in _SHARES), key=len)


def _pieces(profile, stages, tolerance, share):
    """Return pieces that stick out of a profile by a share of a tolerance, and of its turns by the rest."""
    tolerance, chord = share * tolerance, (1.0 - share) * tolerance
    pieces: list[Lathe] = []
    for part in _parts(profile, stages, tolerance):
        low, high = part[:, 1].min(), part[:, 1].max()
        filled = convex_outline(np.concatenate([part, [[0.0, low], [0.0, high]]]))
        if _sticks_out(filled, profile) <= tolerance:
            pieces.append(Lathe(filled))
        else:
            pieces += ring(part, chord)
    return pieces


def convex_parts(polygon: np.ndarray, tolerance: float) -> list[np.ndarray]:
    """Return convex polygons that cover a simple polygon and stick out of it by at most ``tolerance`` [m].

    Triangles are merged in the order of how little the hull of two neighbours sticks out.
    """
    polygon = _counter_clockwise(np.asarray(polygon, float))
    return _parts(polygon, _stages(polygon, tolerance), tolerance)


def _parts(polygon, stages, tolerance):
    """Return the convex polygons of the last stage before one costs more than a tolerance."""
    last = next((k for k, (cost, _) in enumerate(stages) if cost > tolerance), len(stages))
    return [convex_outline(polygon[sorted(part)]) for part in stages[last - 1][1]]


def _stages(polygon, tolerance):
    """Return the corners of parts after each merge that costs at most a tolerance, and the costs [m]."""
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
    stages = [(0.0, list(parts.values()))]
    while costs:
        (a, b), cost = min(costs.items(), key=lambda item: (item[1], item[0]))
        if cost > tolerance:
            break
        parts[following] = parts.pop(a) | parts.pop(b)
        costs = {pair: value for pair, value in costs.items() if not {a, b} & set(pair)}
        add_costs(following)
        following += 1
        stages.append((cost, list(parts.values())))
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
    a, b = polygon, np.roll(polygon, -1, axis=0)
    along = b - a
    offset = points[:, None] - a
    t = np.clip((offset * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-300), 0.0, 1.0)
    distance = np.linalg.norm(offset - t[..., None] * along, axis=2).min(axis=1)
    above = (a[:, 1] > points[:, None, 1]) != (b[:, 1] > points[:, None, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = a[:, 0] + (points[:, None, 1] - a[:, 1]) / along[:, 1] * along[:, 0]
    inside = np.sum(above & (points[:, None, 0] < crossing), axis=1) % 2 == 1
    return float(np.where(inside, 0.0, distance).max(initial=0.0))
