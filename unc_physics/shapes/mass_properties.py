"""Exact volume, centre of mass and inertia of pieces at uniform density."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidModelError
from .pieces import HalfSpace, Hull, Lathe, Piece

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(
    16
)  # exact on edges, round-off on arcs of at most a quarter turn
_STRAIGHT = 1e-12  # angle below which two normals are one [rad]


class MassProperties(NamedTuple):
    """Mass properties of a body of uniform density.

    Attributes
    ----------
    volume : float
        [m^3]
    center : (3,) array
        Centre of mass [m].
    inertia : (3, 3) array
        About the centre of mass, per unit mass [m^2].
    """

    volume: float
    center: np.ndarray
    inertia: np.ndarray


def mass_properties(pieces: Iterable[Piece]) -> MassProperties:
    """Return the mass properties of a body of pieces; volume in which pieces overlap counts twice.

    Raises
    ------
    InvalidModelError
        If a piece is a half-space or a sector. A sector belongs to a ring, whose properties come from its
        profile.
    """
    volume, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for k, piece in enumerate(pieces):
        if isinstance(piece, Hull):
            moments = _hull_moments(piece)
        elif isinstance(piece, Lathe) and piece.whole:
            moments = _lathe_moments(piece)
        else:
            kind = "half-space" if isinstance(piece, HalfSpace) else "sector"
            raise InvalidModelError(f"is a {kind}, which has no volume of its own", field=f"pieces[{k}]")
        volume, first, second = volume + moments[0], first + moments[1], second + moments[2]
    center = first / volume
    second = second / volume - np.outer(center, center)
    return MassProperties(volume, center, np.trace(second) * np.eye(3) - second)


def _hull_moments(hull):
    """Return the integrals of 1, x and x x^T over a hull swept by a ball (Steiner's decomposition).

    The parts are the core, a prism on each face, a wedge along each edge and a cone of the ball at each
    corner.
    """
    r, points = hull.rounding, hull.points
    total = [0.0, np.zeros(3), np.zeros((3, 3))]

    def add(volume, line, square):
        total[0] += volume
        total[1] = total[1] + line
        total[2] = total[2] + 0.5 * (square + square.T)

    middle = points.mean(axis=0)
    for face, normal in zip(hull.faces, hull.normals, strict=True):
        corners = points[face]
        area, line, square = 0.0, np.zeros(3), np.zeros((3, 3))
        for k in range(1, len(corners) - 1):
            triangle = corners[[0, k, k + 1]]
            part = 0.5 * float(normal @ np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0]))
            s = triangle.sum(axis=0)
            area, line = area + part, line + part * s / 3.0
            square += part / 12.0 * (triangle.T @ triangle + np.outer(s, s))
            tetrahedron = np.vstack([triangle, middle])
            volume = part * float(normal @ (triangle[0] - middle)) / 3.0
            s = tetrahedron.sum(axis=0)
            add(volume, volume * s / 4.0, volume / 20.0 * (tetrahedron.T @ tetrahedron + np.outer(s, s)))
        cross = np.outer(line, normal)
        prism = r * square + r**2 / 2.0 * (cross + cross.T) + r**3 / 3.0 * area * np.outer(normal, normal)
        add(r * area, r * line + r**2 / 2.0 * area * normal, prism)
    if r == 0.0:
        return tuple(total)
    for a, b, turn, arc, arc_square in _edges(hull):
        length, step = float(np.linalg.norm(b - a)), b - a
        line = length * 0.5 * (a + b)
        square = length * (
            np.outer(a, a) + 0.5 * (np.outer(a, step) + np.outer(step, a)) + np.outer(step, step) / 3.0
        )
        cross = np.outer(line, arc)
        add(
            length * r**2 * turn / 2.0,
            r**2 * turn / 2.0 * line + r**3 / 3.0 * length * arc,
            r**2 * turn / 2.0 * square + r**3 / 3.0 * (cross + cross.T) + r**4 / 4.0 * length * arc_square,
        )
    for corner, solid_angle, cone, cone_square in _corners(hull):
        cross = np.outer(corner, cone)
        add(
            r**3 / 3.0 * solid_angle,
            r**3 / 3.0 * solid_angle * corner + r**4 / 4.0 * cone,
            r**3 / 3.0 * solid_angle * np.outer(corner, corner)
            + r**4 / 4.0 * (cross + cross.T)
            + r**5 / 5.0 * cone_square,
        )
    return tuple(total)


def _edges(hull):
    """Yield each edge's ends, the turn of its normals m, and the integrals of m and m m^T over it."""
    points = hull.points
    if len(points) == 2:
        e = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
        yield points[0], points[1], 2.0 * math.pi, np.zeros(3), math.pi * (np.eye(3) - np.outer(e, e))
        return
    for (i, j), (f, g) in _neighbours(hull).items():
        u, v = hull.normals[f], hull.normals[g]
        turn = math.atan2(float(np.linalg.norm(np.cross(u, v))), float(u @ v))
        if turn < _STRAIGHT:
            continue
        w = v - (u @ v) * u
        w /= np.linalg.norm(w)
        mixed = math.sin(turn) ** 2 / 2.0 * np.outer(u, w)
        square = (turn / 2.0 + math.sin(2.0 * turn) / 4.0) * np.outer(u, u)
        square += (turn / 2.0 - math.sin(2.0 * turn) / 4.0) * np.outer(w, w) + mixed + mixed.T
        yield points[i], points[j], turn, (u + v) * math.tan(turn / 2.0), square


def _neighbours(hull):
    """Return for each edge (i, j), i < j, its two faces: the left one of i to j first."""
    left = {}
    for f, face in enumerate(hull.faces):
        for i, j in zip(face, np.roll(face, -1), strict=True):
            left[int(i), int(j)] = f
    return {(i, j): (f, left[j, i]) for (i, j), f in left.items() if i < j}


def _corners(hull):
    """Yield each corner, its solid angle of normals, and the integrals of m and m m^T over these normals."""
    points = hull.points
    if len(points) == 1:
        yield points[0], 4.0 * math.pi, np.zeros(3), 4.0 * math.pi / 3.0 * np.eye(3)
        return
    if len(points) == 2:
        e = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
        for corner, side in ((points[0], -1.0), (points[1], 1.0)):
            yield corner, 2.0 * math.pi, side * math.pi * e, 2.0 * math.pi / 3.0 * np.eye(3)
        return
    following: list[dict] = [
        {} for _ in points
    ]  # at each corner: from a face to the next one counter-clockwise
    for (i, j), (f, g) in _neighbours(hull).items():
        following[i][g], following[j][f] = f, g
    for corner, turn in zip(points, following, strict=True):
        order = [next(iter(turn))]
        while turn[order[-1]] != order[0]:
            order.append(turn[order[-1]])
        normals = hull.normals[order]
        solid_angle, cone, square = 0.0, np.zeros(3), np.zeros((3, 3))
        for k in range(1, len(normals) - 1):
            a, b, c = normals[[0, k, k + 1]]
            # Van Oosterom and Strackee 1983
            solid_angle += 2.0 * math.atan2(float(a @ np.cross(b, c)), 1.0 + float(a @ b + b @ c + c @ a))
        for a, b in zip(normals, np.roll(normals, -1, axis=0), strict=True):
            pole = np.cross(a, b)
            size = float(np.linalg.norm(pole))
            arc = math.atan2(size, float(a @ b))
            if arc < _STRAIGHT:
                continue
            pole /= size
            along = np.outer(pole, (a + b) * math.tan(arc / 2.0))
            # the Laplacians of m and of m m^T on the sphere are -2 m and 2 - 6 m m^T
            cone += 0.5 * arc * pole
            square += (along + along.T) / 6.0
        yield corner, solid_angle, cone, solid_angle / 3.0 * np.eye(3) + square


def _lathe_moments(lathe):
    """Return the integrals of 1, x and x x^T over a whole lathe, by Green's theorem on its swept profile."""
    area = np.zeros(5)  # of r, r z, r^3 and r z^2
    for r, z, dz in _outline(lathe):
        area[:4] += [dz @ r**2 / 2.0, dz @ (r**2 * z) / 2.0, dz @ r**4 / 4.0, dz @ (r**2 * z**2) / 2.0]
    volume, height = 2.0 * math.pi * area[0], 2.0 * math.pi * area[1]
    square = np.diag([math.pi * area[2], math.pi * area[2], 2.0 * math.pi * area[3]])
    line = lathe.axes @ [0.0, 0.0, height]
    square = lathe.axes @ square @ lathe.axes.T
    cross = np.outer(lathe.origin, line)
    return (
        volume,
        volume * lathe.origin + line,
        volume * np.outer(lathe.origin, lathe.origin) + cross + cross.T + square,
    )


def _outline(lathe):
    """Yield radii, heights and weighted steps dz (16,) along a whole lathe's swept profile."""
    profile, rho = lathe.profile, lathe.rounding
    t, w = 0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS
    edges = []
    for p, q in zip(profile, np.roll(profile, -1, axis=0), strict=True):
        if max(p[0], q[0]) > 0.0:  # not on the axis
            along = (q - p) / np.linalg.norm(q - p)
            edges.append((p, q, np.array([along[1], -along[0]])))
    start = next(k for k, (p, _, _) in enumerate(edges) if p[0] == 0.0)
    edges = edges[start:] + edges[:start]
    bend = np.array([0.0, -1.0])
    for p, q, normal in edges:
        yield from _arc(p, bend, normal, rho, t, w)
        x = p + rho * normal + t[:, None] * (q - p)
        yield x[:, 0], x[:, 1], w * (q[1] - p[1])
        bend = normal
    yield from _arc(edges[-1][1], bend, np.array([0.0, 1.0]), rho, t, w)


def _arc(corner, begin, end, rho, t, w):
    """Yield radii, heights and weighted steps along a corner's arc, in parts of a quarter turn."""
    first, last = math.atan2(begin[1], begin[0]), math.atan2(end[1], end[0])
    turn = (last - first) % (2.0 * math.pi)
    if rho == 0.0 or turn < _STRAIGHT or turn > 2.0 * math.pi - _STRAIGHT:
        return
    parts = math.ceil(turn / (0.5 * math.pi))
    for k in range(parts):
        angle = first + turn * (k + t) / parts
        yield (
            corner[0] + rho * np.cos(angle),
            corner[1] + rho * np.sin(angle),
            w * rho * np.cos(angle) * turn / parts,
        )
