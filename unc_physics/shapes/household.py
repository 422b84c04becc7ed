"""Pieces of the library's household models, in the axes of their meshes [m]."""

from __future__ import annotations

import numpy as np

from . import household_meshes as meshes
from .pieces import Hull, Lathe, Piece, box
from .revolution import lathe_pieces

#: Largest distance by which pieces stick out into what is hollow [m]; a tenth takes ten times the pieces. It
#: is below the 0.7 mm that the models are right to, as it is checked at samples.
HOLLOW = 6.95e-4
_HANDLE_PARTS = 9  # hulls along a mug's handle; they stick out by half a millimetre at its bends
_SECTION = 8  # points of a half section of the handle


def bin_pieces() -> list[Piece]:
    """Return the bottom, walls and flange of a bin."""
    x, y, h, wall, flange = meshes.BIN
    u, v = x - 2.0 * flange, y - 2.0 * flange
    parts: list[Piece] = [box((u, v, wall), (0.0, 0.0, 0.5 * wall))]
    for side in (-1.0, 1.0):
        parts.append(box((wall, v, h), (side * 0.5 * (u - wall), 0.0, 0.5 * h)))
        parts.append(box((u, wall, h), (0.0, side * 0.5 * (v - wall), 0.5 * h)))
        width = flange + wall
        parts.append(box((width, y, wall), (side * 0.5 * (x - width), 0.0, h - 0.5 * wall)))
        parts.append(box((x, width, wall), (0.0, side * 0.5 * (y - width), h - 0.5 * wall)))
    return parts


def mug_pieces() -> list[Piece]:
    """Return the body and the handle of a mug."""
    middle, out = meshes.handle_loop(_HANDLE_PARTS + 1)
    thin, wide = meshes.HANDLE
    rounding = thin**2 / wide  # least radius of curvature of the elliptic section
    radius, _, wall, _ = meshes.MUG
    middle[:, 0] = np.maximum(
        middle[:, 0], radius - wall + rounding
    )  # the ends are round, and within the wall
    turn = 2.0 * np.pi * (np.arange(2 * _SECTION) + 0.5) / (2 * _SECTION)
    point = np.column_stack([thin * np.cos(turn), wide * np.sin(turn)])
    normal = np.column_stack([np.cos(turn) / thin, np.sin(turn) / wide])
    point -= rounding * normal / np.linalg.norm(normal, axis=1, keepdims=True)
    sections = middle[:, None] + point[:, :1] * out[:, None] + point[:, 1:] * np.array([0.0, 1.0, 0.0])
    # tangents on the loop's outside and chords on its inside enclose the bend
    bend = (1.0 / np.cos(0.5 * np.pi / _HANDLE_PARTS) - 1.0) * (meshes.HANDLE_LOOP + thin)
    sections = np.concatenate([sections, sections + bend * out[:, None]], axis=1)
    handle = [Hull(np.concatenate(sections[k : k + 2]), rounding) for k in range(_HANDLE_PARTS)]
    return [*lathe_pieces(meshes.mug_profile(), HOLLOW), *handle]


def can_pieces() -> list[Piece]:
    """Return the rims and the body between them of a can; what the lids lie below the rims is filled in."""
    profile = meshes.can_profile()[2:-2]
    low, high = profile[4, 1], profile[-5, 1]  # where the rims end, so that a can stands on its rim alone
    heights = profile[:, 1]
    parts = [profile[heights <= low], profile[(low <= heights) & (heights <= high)], profile[heights >= high]]
    return [Lathe(part) for part in parts]


def rounded_box_pieces() -> list[Piece]:
    """Return the cube of the recorded tosses."""
    size, radius = 0.1048, 0.005
    return [box((size - 2.0 * radius,) * 3, (0.0, 0.0, 0.5 * size), radius)]
