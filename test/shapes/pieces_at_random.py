"""Random pieces and poses, and plain NumPy support functions that judge distances."""

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.shapes.distance import SignedDistance, distance_of_bodies
from unc_physics.shapes.pieces import (
    HalfSpace,
    Hull,
    Lathe,
    ball,
    box,
    capsule,
    cylinder,
    frustum,
    piece_arrays,
)

KINDS = (
    "ball",
    "capsule",
    "box",
    "rounded box",
    "hull",
    "cylinder",
    "cone",
    "disc",
    "bottle",
    "sector",
    "rounded lathe",
)


def distance_of_pieces(pieces_a, frame_a, pieces_b, frame_b):
    """The signed distance of two bodies from their pieces and the rows of their frames (12,)."""
    arrays, frames = piece_arrays([pieces_a, pieces_b]), np.array([frame_a, frame_b])
    gap, found = distance_of_bodies(frames, arrays.pieces, arrays.rows, arrays.first)
    return SignedDistance(float(gap), found[0], found[1] + frame_a[:3], found[2] + frame_a[:3])


def piece(kind, rng):
    """A piece of a kind, 2 to 12 cm large."""
    a, b, c = rng.uniform(0.02, 0.12, 3)
    return {
        "ball": lambda: ball(0.5 * a),
        "capsule": lambda: capsule(0.3 * a, b),
        "box": lambda: box((a, b, c)),
        "rounded box": lambda: box((a, b, c), rounding=0.005),
        "hull": lambda: Hull(rng.normal(0.0, 0.04, (rng.integers(5, 30), 3))),
        "cylinder": lambda: cylinder(0.5 * a, b),
        "cone": lambda: frustum(0.5 * a, 0.0, b),
        "disc": lambda: Lathe([[0.0, 0.0], [0.5 * a, 0.0]], rounding=0.002),
        "bottle": lambda: Lathe([[0, 0], [0.5 * a, 0], [0.6 * a, 0.3 * b], [0.4 * a, b], [0, 1.2 * b]]),
        "sector": lambda: Lathe(
            [[a, 0], [a + 0.02, 0], [a + 0.02, b], [a, b]], azimuth=6.0 * b, half_angle=3.0 * c
        ),
        "rounded lathe": lambda: Lathe(
            [[0, 0], [0.5 * a, 0], [0.3 * a, b], [0, b]], 0.004, (0.02, -0.01, 0.03), turn(rng)
        ),
    }[kind]()


def turn(rng):
    """A random rotation matrix; in two of five cases with axes along edges and diagonals."""
    if rng.random() < 0.4:
        return Rotation.from_euler("xyz", 0.25 * np.pi * rng.integers(0, 8, 3)).as_matrix()
    return Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()


def reach(piece, R, p, n):
    """How far a piece at p with rotation R reaches along unit vectors n (k, 3), from the world's origin."""
    n = np.atleast_2d(n)
    b = n @ R
    if isinstance(piece, HalfSpace):
        along = b @ piece.normal
        return np.where(along > 1.0 - 1e-12, piece.point @ piece.normal, np.inf) + n @ p
    if isinstance(piece, Hull):
        core = (b @ piece.points.T).max(axis=1)
    else:
        d = b @ piece.axes
        azimuth = np.arctan2(d[:, 1], d[:, 0]) - piece.azimuth
        away = np.abs((azimuth + np.pi) % (2.0 * np.pi) - np.pi)
        s = np.hypot(d[:, 0], d[:, 1]) * np.cos(np.maximum(away - piece.half_angle, 0.0))
        core = (s[:, None] * piece.profile[:, 0] + d[:, 2:] * piece.profile[:, 1]).max(
            axis=1
        ) + b @ piece.origin
    return core + piece.rounding + n @ p


def gap_along(a, Ra, pa, b, Rb, pb, n):
    """Gap of two pieces along unit vectors n (k, 3) from a to b: the support function's answer."""
    return -reach(b, Rb, pb, -np.atleast_2d(n)) - reach(a, Ra, pa, n)
