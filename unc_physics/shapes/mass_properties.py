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
        If a piece is a half-space, a sector or a hull with faces and a rounding. A sector belongs to a ring,
        whose properties come from its profile; those of a rounded box come with its model (`rounded_box`).
    """
    volume, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for k, piece in enumerate(pieces):
        if isinstance(piece, Hull) and len(piece.points) > 2 and piece.rounding == 0.0:
            moments = _hull_moments(piece)
        elif isinstance(piece, Hull) and len(piece.points) < 3:
            moments = _capsule_moments(piece)
        elif isinstance(piece, Lathe) and piece.whole:
            moments = _turned_moments(piece.profile, piece.rounding, piece.origin, piece.axes)
        else:
            kind = {HalfSpace: "half-space", Lathe: "sector", Hull: "rounded hull"}[type(piece)]
            raise InvalidModelError(f"is a {kind}, whose mass properties are not known", field=f"pieces[{k}]")
        volume, first, second = volume + moments[0], first + moments[1], second + moments[2]
    center = first / volume
    second = second / volume - np.outer(center, center)
    return MassProperties(volume, center, np.trace(second) * np.eye(3) - second)


def _hull_moments(hull):
    """Return the integrals of 1, x and x x^T over a hull: tetrahedra from its middle to its faces."""
    middle = hull.points.mean(axis=0)
    total, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for face, normal in zip(hull.faces, hull.normals, strict=True):
        corners = hull.points[face]
        for k in range(1, len(face) - 1):
            a, b, c = triangle = corners[[0, k, k + 1]]
            part = 0.5 * float(normal @ np.cross(b - a, c - a))
            volume = part * float(normal @ (a - middle)) / 3.0
            tetrahedron = np.vstack([triangle, middle])
            s = tetrahedron.sum(axis=0)
            square = volume / 20.0 * (tetrahedron.T @ tetrahedron + np.outer(s, s))
            total, first = total + volume, first + volume * s / 4.0
            second = second + 0.5 * (square + square.T)
    return total, first, second


def _capsule_moments(hull):
    """Return the integrals of 1, x and x x^T over a ball or a capsule, a body of revolution."""
    along = hull.points[-1] - hull.points[0]
    axes = np.linalg.svd(along[None])[2].T[:, ::-1]
    profile = np.outer([-0.5, 0.5], [0.0, float(np.linalg.norm(along))])
    return _turned_moments(profile, hull.rounding, hull.points.mean(axis=0), axes)


def _turned_moments(profile, rounding, origin, axes):
    """Return the integrals of 1, x and x x^T over a swept profile's whole turn, by Green's theorem."""
    area = np.zeros(4)  # of r, r z, r^3 and r z^2
    for r, z, dz in _outline(profile, rounding):
        area += [dz @ r**2 / 2.0, dz @ (r**2 * z) / 2.0, dz @ r**4 / 4.0, dz @ (r**2 * z**2) / 2.0]
    volume, height = 2.0 * math.pi * area[0], 2.0 * math.pi * area[1]
    line = axes @ [0.0, 0.0, height]
    square = axes @ np.diag([math.pi * area[2], math.pi * area[2], 2.0 * math.pi * area[3]]) @ axes.T
    cross = np.outer(origin, line)
    return volume, volume * origin + line, volume * np.outer(origin, origin) + cross + cross.T + square


def _outline(profile, rho):
    """Yield radii, heights and weighted steps dz (16,) along the swept profile of a whole turn."""
    t, w = 0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS
    edges = []
    for p, q in zip(profile, np.roll(profile, -1, axis=0), strict=True):
        if max(p[0], q[0]) > 0.0 or q[1] > p[1]:  # not back along the axis
            along = (q - p) / np.linalg.norm(q - p)
            edges.append((p, q, np.array([along[1], -along[0]])))
    start = next((k for k, (p, _, _) in enumerate(edges) if p[0] == 0.0), 0)  # a ball has no edges
    edges = edges[start:] + edges[:start]
    bend = np.array([0.0, -1.0])
    for p, q, normal in edges:
        yield from _arc(p, bend, normal, rho, t, w)
        x = p + rho * normal + t[:, None] * (q - p)
        yield x[:, 0], x[:, 1], w * (q[1] - p[1])
        bend = normal
    yield from _arc(edges[-1][1] if edges else profile[0], bend, np.array([0.0, 1.0]), rho, t, w)


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
