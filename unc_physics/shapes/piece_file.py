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
}
#: Most pieces of a file, and most points of all.
PIECES_LIMIT, POINTS_LIMIT = 10_000, 1_000_000


def piece_entries(pieces: Sequence[Piece]) -> dict[str, np.ndarray]:
    """Return the entries of a model file for pieces.

    Raises
    ------
    InvalidModelError
        If one is a half-space, which is for fixed surroundings only.
    """
    kinds, points, lathes = [], [], []
    for k, piece in enumerate(pieces):
        if isinstance(piece, HalfSpace):
            raise InvalidModelError("must not be a half-space, which has no end", field=f"pieces[{k}]")
        kinds.append(HULL if isinstance(piece, Hull) else LATHE)
        if isinstance(piece, Hull):
            points.append(piece.points)
            lathes.append((np.zeros(3), np.eye(3), (0.0, 0.0)))
        else:
            points.append(
                np.column_stack([piece.profile[:, 0], 0.0 * piece.profile[:, 0], piece.profile[:, 1]])
            )
            lathes.append((piece.origin, piece.axes, (piece.azimuth, piece.half_angle)))
    return {
        "piece_kind": np.array(kinds, np.int64),
        "piece_rounding": np.array([piece.rounding for piece in pieces if not isinstance(piece, HalfSpace)]),
        "piece_points": np.concatenate(points),
        "piece_sizes": np.array([len(some) for some in points], np.int64),
        "piece_origin": np.array([origin for origin, _, _ in lathes]),
        "piece_axes": np.array([axes for _, axes, _ in lathes]),
        "piece_sector": np.array([sector for _, _, sector in lathes]),
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
    counts = values["piece_sizes"]
    if np.any(counts != np.rint(counts)) or np.any(counts < 1) or counts.sum() != len(values["piece_points"]):
        raise InvalidModelError(
            f"must be positive integers with the sum {len(values['piece_points'])}, the rows of piece_points",
            field="piece_sizes",
            value=counts.tolist(),
        )
    pieces: list[Piece] = []
    ends = np.cumsum(counts.astype(np.int64))
    for k, end in enumerate(ends.tolist()):
        points = values["piece_points"][end - int(counts[k]) : end]
        kind, rounding = values["piece_kind"][k], values["piece_rounding"][k]
        try:
            if kind == HULL:
                pieces.append(Hull(points, rounding))
            elif kind == LATHE:
                azimuth, half = values["piece_sector"][k]
                origin, axes = values["piece_origin"][k], values["piece_axes"][k]
                pieces.append(Lathe(points[:, [0, 2]], rounding, origin, axes, azimuth, half))
            else:
                raise InvalidModelError(
                    f"must be {HULL} (hull) or {LATHE} (lathe)", field="piece_kind", value=kind
                )
        except InvalidModelError as error:
            raise InvalidModelError(
                error.problem, field=f"piece {k}: {error.field}", value=error.value
            ) from error
    return tuple(pieces)
