"""Pieces as arrays of a model file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..checks.errors import InvalidModelError
from .columns import HULL, LATHE
from .pieces import HalfSpace, Hull, Lathe, Piece

#: Keys of pieces in a model file, with the shapes of their arrays; n pieces have m points together.
KEYS = {
    "piece_kind": ("n",),
    "piece_rounding": ("n",),
    "piece_points": ("m", 3),
    "piece_sizes": ("n",),
    "piece_origin": ("n", 3),
    "piece_axes": ("n", 3, 3),
    "piece_sector": ("n", 2),
    "piece_face_counts": ("n",),
    "piece_face_sizes": ("f",),
    "piece_face_corners": ("c",),
    "piece_arc_counts": ("n",),
    "piece_arcs": ("a", 2, 4),
}
_ADDED = "piece_arc_counts", "piece_arcs"  # files made before these have none of them
_COUNTS = "piece_sizes", "piece_face_counts", "piece_face_sizes", "piece_face_corners", "piece_arc_counts"
#: Most pieces of a file, and most points and corners of faces of all.
PIECES_LIMIT, POINTS_LIMIT = 10_000, 1_000_000
#: Most numbers of each key.
NUMBERS_LIMIT = {
    key: (PIECES_LIMIT if shape[0] == "n" else 3 * POINTS_LIMIT) * int(np.prod(shape[1:]))
    for key, shape in KEYS.items()
}


def piece_entries(pieces: Sequence[Piece]) -> dict[str, np.ndarray]:
    """Return the entries of a model file for pieces.

    Raises
    ------
    InvalidModelError
        If one is a half-space, which is for fixed surroundings only.
    """
    rows = []
    for k, piece in enumerate(pieces):
        if isinstance(piece, HalfSpace):
            raise InvalidModelError("must not be a half-space, which has no end", field=f"pieces[{k}]")
        if isinstance(piece, Hull):
            place = np.zeros(3), np.eye(3), (0.0, 0.0)
            rows.append((HULL, piece.rounding, piece.points, *place, piece.faces, np.zeros((0, 2, 4))))
        else:
            place = piece.origin, piece.axes, (piece.azimuth, piece.half_angle)
            points = piece.profile @ [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
            rows.append((LATHE, piece.rounding, points, *place, (), piece.arcs))
    kinds, roundings, points, origins, axes, sectors, faces, arcs = zip(*rows, strict=True)
    corners = [face for some in faces for face in some]
    return {
        "piece_kind": np.array(kinds, np.int64),
        "piece_rounding": np.array(roundings),
        "piece_points": np.concatenate(points),
        "piece_sizes": np.array([len(some) for some in points], np.int64),
        "piece_origin": np.array(origins),
        "piece_axes": np.array(axes),
        "piece_sector": np.array(sectors),
        "piece_face_counts": np.array([len(some) for some in faces], np.int64),
        "piece_face_sizes": np.array([len(face) for face in corners], np.int64),
        "piece_face_corners": np.concatenate([np.zeros(0, np.int64), *corners]),
        "piece_arc_counts": np.array([len(some) for some in arcs], np.int64),
        "piece_arcs": np.concatenate(arcs),
    }


def pieces_of_entries(entries: Mapping[str, np.ndarray]) -> tuple[Piece, ...]:
    """Return the pieces of a model file's entries.

    Raises
    ------
    InvalidModelError
        If a key is missing, an array has a wrong shape or kind, or a piece is not valid.
    """
    values = {}
    sizes: dict[str, int] = {}
    if not any(key in entries for key in _ADDED) and "piece_kind" in entries:
        none = np.zeros(np.shape(entries["piece_kind"])), np.zeros((0, 2, 4))
        entries = {**entries, **dict(zip(_ADDED, none, strict=True))}
    for key, shape in KEYS.items():
        if key not in entries:
            raise InvalidModelError("is missing, as other keys of pieces are there", field=key)
        value = np.asarray(entries[key])
        if value.dtype.kind not in "fiu" or not np.isfinite(value).all():
            raise InvalidModelError("must hold finite numbers", field=key)
        wanted = tuple(
            sizes.setdefault(size, value.shape[0]) if isinstance(size, str) and value.ndim else size
            for size in shape
        )
        if value.shape != wanted:
            raise InvalidModelError(f"must have shape {wanted}", field=key, value=value.shape)
        values[key] = value
    for key in _COUNTS:
        if np.any(values[key] != np.rint(values[key])) or np.any(values[key] < 0):
            raise InvalidModelError("must hold integers of at least 0", field=key)
        values[key] = values[key].astype(np.int64)
    points = _split(values["piece_points"], "piece_sizes", values)
    faces = _split(values["piece_face_corners"], "piece_face_sizes", values)
    faces = _split(faces, "piece_face_counts", values)
    arcs = _split(values["piece_arcs"], "piece_arc_counts", values)
    pieces: list[Piece] = []
    for k, kind in enumerate(values["piece_kind"].tolist()):
        rounding = values["piece_rounding"][k]
        try:
            if kind == HULL:
                pieces.append(Hull(points[k], rounding, tuple(faces[k])))
            elif kind == LATHE:
                azimuth, half = values["piece_sector"][k]
                origin, axes = values["piece_origin"][k], values["piece_axes"][k]
                profile = points[k][:, [0, 2]]
                pieces.append(Lathe(profile, rounding, origin, axes, azimuth, half, arcs[k]))
            else:
                raise InvalidModelError(
                    f"must be {HULL} (hull) or {LATHE} (lathe)", field="piece_kind", value=kind
                )
        except InvalidModelError as error:
            raise error.at(f"piece {k}: {error.field}") from error
    return tuple(pieces)


def _split(rows, sizes, values):
    """Return rows in parts, whose sizes are those of a key of ``values``."""
    counts = values[sizes]
    if counts.sum() != len(rows):
        raise InvalidModelError(f"must have the sum {len(rows)}", field=sizes, value=int(counts.sum()))
    ends = np.cumsum(counts)
    return [rows[end - count : end] for end, count in zip(ends.tolist(), counts.tolist(), strict=True)]
