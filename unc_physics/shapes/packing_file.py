"""Sphere packings and the ``.npz`` files that hold them (numpy only: no mesh library is needed
to read one).
"""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..checks.errors import InvalidModelError, LimitExceededError, UncPhysicsError
from ..checks.validation import FARTHEST, instance
from .piece_file import KEYS, NUMBERS_LIMIT, PIECES_LIMIT, piece_entries, pieces_of_entries
from .pieces import Balls, Hull, Lathe, Piece, box_about

_PROPORTION = 1e12  # of an inertia and the square of its body's reach, to either side
#: Kind of the piece of a mesh that is neither convex nor cut into convex pieces.
HULL = "hull of a mesh that is not convex"
ROUND_OFF = 1e-9  # relative; what a file written in decimal or by another program may lose


@dataclass(frozen=True, eq=False)
class SpherePacking:
    """Spheres that stand for a solid body, in nested order: the first k spheres are the k-sphere packing.

    All coordinates are in the body frame, whose origin is the centre of mass (COM) of the solid. Arrays are
    float64, C-contiguous and read-only.

    Attributes
    ----------
    name : str
    centers : ndarray (n, 3)
        Sphere centres [m].
    radii : ndarray (n,)
        Sphere radii [m].
    inertia : ndarray (3, 3)
        Inertia tensor about the COM per unit mass [m^2].
    volume : float
        Volume of the solid [m^3], not of the spheres.
    origin : ndarray (3,)
        Origin of the source mesh's own coordinates, in the body frame [m]. Poses from perception refer to it.
    bounding_radius : float
        Radius of a COM-centred ball that holds the solid, its spheres included [m].
    mesh_sha256 : str or None
        SHA-256 of the source mesh's file, or of its vertices and triangles when a program made the mesh.
    mass : float or None
        Default mass [kg]; None when the source says nothing about it.
    bounds : ndarray (2, 3) or None
        Corners of the mesh's bounding box along the body axes [m].
    surface_gap : float or None
        The farthest that a point of the mesh's surface lies from the nearest sphere [m], for these spheres.
    measured_spheres : ndarray (k,) or None
        Numbers of first spheres for which `extent_losses` are known, ascending.
    extent_losses : ndarray (k,) or None
        How much farther the mesh reaches than these spheres, in the direction where that is most [m].
    source, licence : str or None
        Where the mesh comes from, and under which terms.
    pieces : sequence of Piece
        Convex pieces whose union is the solid; by default one ball for each sphere. A prefix keeps given
        ones.
    pieces_kind : str or None
        What the pieces are: names of shapes, 'hull', 'convex decomposition' or 'recipe'.
    pieces_error : ndarray (4,) or None
        Distances between the surfaces of mesh and pieces, as a `SurfaceError`: mean, 99th percentile, and how
        far at most the mesh is outside the pieces and the pieces outside the mesh [m].

    Raises
    ------
    InvalidModelError
        If a field has a wrong shape, a value that is not finite or out of its range, or contradicts another.
    """

    name: str
    centers: np.ndarray
    radii: np.ndarray
    inertia: np.ndarray
    volume: float
    origin: np.ndarray
    bounding_radius: float
    mesh_sha256: str | None = None
    mass: float | None = None
    bounds: np.ndarray | None = None
    surface_gap: float | None = None
    measured_spheres: np.ndarray | None = None
    extent_losses: np.ndarray | None = None
    source: str | None = None
    licence: str | None = None
    pieces: Sequence[Piece] = ()
    pieces_kind: str | None = None
    pieces_error: np.ndarray | None = None

    def __post_init__(self):
        for field, (shape, _) in _FIELDS.items():
            if getattr(self, field) is not None:
                value = _array(field, getattr(self, field), shape)
                if field in _POSITIVE and not value > 0.0:
                    raise InvalidModelError("must be positive", field=field, value=float(value))
                if field in _NOT_NEGATIVE and np.any(value < 0.0):
                    raise InvalidModelError("must not be negative", field=field, value=value.tolist())
                self._set(field, value if shape else float(value))
        _check_spheres(self.centers, self.radii)
        reach = spheres_reach(self.centers, self.radii)
        check_inertia(self.inertia, reach)
        self._check_measures()
        self._check_pieces()
        if reach > self.bounding_radius * (1.0 + ROUND_OFF):
            raise InvalidModelError(
                f"is less than the spheres' reach from the centre of mass, {reach}",
                field="bounding_radius",
                value=self.bounding_radius,
            )

    def _check_pieces(self):
        """Raise `InvalidModelError` unless all pieces are bounded; without any, each sphere is one."""
        if isinstance(self.pieces, Balls) or len(self.pieces) == 0:
            self._set("pieces", Balls(self.centers, self.radii))
            return
        if len(self.pieces) > PIECES_LIMIT:
            raise LimitExceededError(
                f"must be at most {PIECES_LIMIT}", field="pieces", value=len(self.pieces)
            )
        for k, piece in enumerate(self.pieces):
            if not isinstance(piece, (Hull, Lathe)):
                raise InvalidModelError("must be a Hull or a Lathe", field=f"pieces[{k}]", value=piece)
        self._set("pieces", tuple(self.pieces))

    def _check_measures(self):
        """Raise `InvalidModelError` for malformed measures, and drop measures without numbers of spheres."""
        if self.measured_spheres is None:
            self._set("extent_losses", None)
            return
        lengths = self.measured_spheres
        if np.any(np.diff(lengths) <= 0.0) or np.any(lengths < 1.0) or np.any(lengths != np.rint(lengths)):
            raise InvalidModelError(
                "must be positive integers, ascending", field="measured_spheres", value=lengths.tolist()
            )
        if self.extent_losses is not None and len(self.extent_losses) != len(lengths):
            raise InvalidModelError(
                f"must have as many entries as measured_spheres, {len(lengths)}",
                field="extent_losses",
                value=self.extent_losses.shape,
            )

    def _set(self, field, value):
        object.__setattr__(self, field, value)

    def __repr__(self):
        return f"SpherePacking({self.name!r}, {len(self)} spheres, fill {100.0 * self.fill:.1f} %)"

    def __len__(self):
        return len(self.radii)

    @property
    def sphere_volume(self) -> float:
        """Sum of the spheres' volumes [m^3]."""
        return float(4.0 / 3.0 * np.pi * np.sum(self.radii**3))

    @property
    def fill(self) -> float:
        """The part of the solid's volume that the spheres fill (more than 1 where foreign
        spheres overlap).
        """
        return self.sphere_volume / self.volume

    @property
    def has_only_spheres(self) -> bool:
        """Whether there are no pieces but the spheres: a small body can then pass between them."""
        return isinstance(self.pieces, Balls)

    @property
    def extent_loss(self) -> float | None:
        """How much farther the mesh reaches than the spheres, in the direction where that is most [m].

        An upper bound; None where it was not measured for so few spheres.
        """
        losses = self.extent_losses
        return None if losses is None or len(losses) == 0 else float(losses[-1])

    @property
    def corners(self) -> np.ndarray:
        """Corners (2, 3) of the box about the pieces along the body axes [m]."""
        return box_about(self.pieces)

    def prefix(self, k: int) -> SpherePacking:
        """Return the packing of the first k spheres, with the whole body's COM, inertia, volume and mass.

        Raises
        ------
        InvalidModelError
            If k is not an integer between 1 and the number of spheres.
        """
        if isinstance(k, bool) or not isinstance(k, (int, np.integer)) or k < 1:
            raise InvalidModelError("must be a positive integer", field="spheres", value=k)
        if k > len(self):
            raise InvalidModelError(
                f"is more than the {len(self)} spheres of model '{self.name}'", field="spheres", value=k
            )
        return self if k == len(self) else self._first(k)

    def _first(self, k):
        known = int(np.sum(self.measured_spheres <= k)) if self.measured_spheres is not None else 0
        parts = {"centers": k, "radii": k, "measured_spheres": known, "extent_losses": known}
        first = {
            field: value[:n] for field, n in parts.items() if (value := getattr(self, field)) is not None
        }
        return replace(self, surface_gap=None, **first)

    def named(self, name: str) -> SpherePacking:
        """Return the packing with another name."""
        return replace(self, name=name)

    def scaled(self, s: float) -> SpherePacking:
        """Return the packing with all lengths multiplied by s; its default mass, if any, keeps the density.

        Raises
        ------
        InvalidModelError
            If s is not a positive finite number.
        """
        scale = float(_array("scale", s, ()))
        if not scale > 0.0:
            raise InvalidModelError("must be positive", field="scale", value=s)
        if not 1e-50 < scale < 1e50:  # the cube stays within the range of numbers
            raise InvalidModelError("must be between 1e-50 and 1e50", field="scale", value=s)
        if scale == 1.0:
            return self
        scaled = {
            field: value * scale**power
            for field, (_, power) in _FIELDS.items()
            if (value := getattr(self, field)) is not None and power > 0
        }
        if not self.has_only_spheres:
            scaled["pieces"] = tuple(piece.scaled(scale) for piece in self.pieces)
        return replace(self, **scaled)


_VERSION = "format_version"
#: Fields of numbers: shape, of which None is any length, and the power of a length by which it scales.
_FIELDS: dict[str, tuple[tuple[int | None, ...], int]] = {
    "centers": ((None, 3), 1),
    "radii": ((None,), 1),
    "inertia": ((3, 3), 2),
    "volume": ((), 3),
    "origin": ((3,), 1),
    "bounding_radius": ((), 1),
    "mass": ((), 3),
    "bounds": ((2, 3), 1),
    "surface_gap": ((), 1),
    "measured_spheres": ((None,), 0),
    "extent_losses": ((None,), 1),
    "pieces_error": ((4,), 1),
}
_POSITIVE = ("volume", "bounding_radius", "mass")
_NOT_NEGATIVE = ("surface_gap", "extent_losses", "pieces_error")
_TEXTS = ("name", "mesh_sha256", "source", "licence", "pieces_kind")
#: Most spheres of a file, and most characters of a text in it: a small file may say that it holds terabytes.
SPHERES_LIMIT, _TEXT_LIMIT = 10_000_000, 100_000
#: Version of the format that is written; files without one are of version 1, which had no pieces.
FORMAT_VERSION = 2
_HEADER = 10_000  # bytes, of an array; more than NumPy reads


def load_packing(path: str | os.PathLike[str]) -> SpherePacking:
    """Read and check a model file.

    A file without ``inertia`` gets it from its solid spheres (overlaps count twice) and is recentred at their
    centroid; one without ``volume`` gets the sum of its spheres' volumes, one without ``origin`` the origin
    of the file's coordinates, one without ``bounding_radius`` the farthest point of its spheres.

    Parameters
    ----------
    path : str or path-like
        An ``.npz`` file with at least ``centers`` (n, 3) and ``radii`` (n,), both in metres.

    Raises
    ------
    InvalidModelError
        If the file cannot be read, or a field is missing, malformed or inconsistent; the message names the
        file, the field and the value.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            _check_sizes(zipfile.ZipFile(stream), path)
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as file:
                known = {field.name for field in fields(SpherePacking)} - {"pieces"} | {_VERSION, *KEYS}
                values: dict[str, Any] = {key: file[key] for key in file.files if key in known}
    except UncPhysicsError:
        raise
    except Exception as error:
        reason = getattr(error, "strerror", None) or "it is no .npz archive of plain arrays"
        raise InvalidModelError(f"cannot be read: {reason}", field=f"model file {path}") from error
    for field in ("centers", "radii"):
        if field not in values:
            raise InvalidModelError(f"has no '{field}'", field=f"model file {path}")
    for field in _TEXTS:
        if field in values:
            if values[field].shape != () or values[field].dtype.kind not in "US":
                raise InvalidModelError("must be a text", field=f"model file {path}: {field}")
            values[field] = str(values[field][()])
    values.setdefault("name", path.stem)
    try:
        _check_version(values.pop(_VERSION, 1))
        return SpherePacking(**_completed(_with_pieces(values)))
    except InvalidModelError as error:
        raise error.at(f"model file {path}: {error.field}") from error


def _check_version(version):
    """Raise `InvalidModelError` unless this release reads files of a version."""
    if version not in range(1, FORMAT_VERSION + 1):
        raise InvalidModelError(
            f"must be 1 to {FORMAT_VERSION}; a newer release of unc_physics may read the file",
            field=_VERSION,
            value=version,
        )


def _with_pieces(values) -> dict[str, Any]:
    """Return the fields of a file with pieces in place of their keys, if there are any."""
    entries = {key: values[key] for key in KEYS if key in values}
    others = {key: value for key, value in values.items() if key not in KEYS}
    return others | {"pieces": pieces_of_entries(entries)} if entries else others


def _check_sizes(archive, path):
    """Refuse arrays that are too large, by what the archive says of them before they are unpacked."""
    numbers = {"centers": 3 * SPHERES_LIMIT, "radii": SPHERES_LIMIT} | dict.fromkeys(_TEXTS, _TEXT_LIMIT)
    numbers |= NUMBERS_LIMIT
    for entry in archive.infolist():
        field = entry.filename.removesuffix(".npy")
        most = 8 * numbers.get(field, 100) + _HEADER
        if entry.file_size > most:
            raise LimitExceededError(
                f"must be at most {most}, and {field} is larger ({SPHERES_LIMIT} spheres are the limit)",
                field=f"model file {path}: bytes",
                value=entry.file_size,
            )


def _completed(values):
    """Return the fields of a file, with missing ones computed from the spheres."""
    centers, radii = (_array(field, values[field], _FIELDS[field][0]) for field in ("centers", "radii"))
    _check_spheres(centers, radii)
    values = dict(values)
    values.setdefault("origin", np.zeros(3))
    values.setdefault("volume", 4.0 / 3.0 * np.pi * np.sum(radii**3))
    if "inertia" not in values:
        centroid, values["inertia"] = solid_spheres_inertia(centers, radii)
        centers = centers - centroid
        values["centers"] = centers
        values["origin"] = _array("origin", values["origin"], (3,)) - centroid
        values.pop("bounding_radius", None)  # was about another point
        values["pieces"] = [piece.moved(-centroid, np.eye(3)) for piece in values.get("pieces", ())]
        if "bounds" in values:
            values["bounds"] = _array("bounds", values["bounds"], (2, 3)) - centroid
    values.setdefault("bounding_radius", spheres_reach(centers, radii))
    return values


def save_packing(path: str | os.PathLike[str], packing: SpherePacking) -> Path:
    """Write a model file, compressed, with the same bytes for the same packing.

    The file appears whole or not at all: it is written beside its place and then moved there.
    """
    instance(path, (str, os.PathLike), "path")
    instance(packing, SpherePacking, "packing")
    path = Path(path)
    values = {field.name: getattr(packing, field.name) for field in fields(packing)}
    pieces = values.pop("pieces")
    values |= {_VERSION: FORMAT_VERSION, **({} if packing.has_only_spheres else piece_entries(pieces))}
    given: dict[str, Any] = {key: np.asarray(value) for key, value in values.items() if value is not None}
    handle, partial = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            np.savez_compressed(stream, **given)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(partial, 0o666 & ~_umask())
        os.replace(partial, path)
    except BaseException:  # Ctrl-C too: leave nothing behind
        if os.path.exists(partial):
            os.unlink(partial)
        raise
    return path


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


def solid_spheres_inertia(centers, radii):
    """Return the centroid (3,) [m] of a body made of solid spheres, and its inertia (3, 3) about that.

    The inertia is per unit mass [m^2]. The spheres have ``centers`` (n, 3) and ``radii`` (n,) [m]; overlaps
    count twice.
    """
    weights = (radii / radii.max()) ** 3
    weights = weights / weights.sum()
    centroid = weights @ centers
    arm = centers - centroid
    own = 0.4 * np.sum(weights * radii**2)
    steiner = np.sum(weights * np.sum(arm**2, axis=1))
    return centroid, (own + steiner) * np.eye(3) - (arm.T * weights) @ arm


def spheres_reach(centers, radii) -> float:
    """Return the largest distance from the origin to a point of a sphere [m]."""
    return float(np.max(np.linalg.norm(centers, axis=1) + radii))


def check_inertia(inertia, reach=None):
    """Raise `InvalidModelError` if an array (3, 3) is no inertia tensor per unit mass [m^2].

    An inertia tensor is symmetric and positive definite, and its principal moments obey the triangle
    inequality, all to round-off. They must also fit a body that reaches ``reach`` [m] from its centre of
    mass, within a factor of 1e12.
    """
    size = np.abs(inertia).max()
    if np.abs(inertia - inertia.T).max() > ROUND_OFF * size:
        raise InvalidModelError("is not symmetric", field="inertia", value=inertia.tolist())
    moments = np.linalg.eigvalsh(inertia)
    if not moments[0] > 0.0:
        raise InvalidModelError(
            "has a principal moment that is not positive", field="inertia", value=moments.tolist()
        )
    if moments[2] > (moments[0] + moments[1]) * (1.0 + ROUND_OFF):
        raise InvalidModelError(
            "belongs to no solid, as one principal moment is more than the sum of the others",
            field="inertia",
            value=moments.tolist(),
        )
    if reach is not None and not reach**2 / _PROPORTION < moments[0] <= moments[2] < reach**2 * _PROPORTION:
        raise InvalidModelError(
            f"is out of all proportion: per unit mass, a body that reaches {reach:.3g} m from its centre of"
            f" mass has some {0.1 * reach**2:.1g} m^2",
            field="inertia",
            value=moments.tolist(),
        )


def _check_spheres(centers, radii):
    if len(radii) == 0:
        raise InvalidModelError("is empty: a packing needs at least one sphere", field="radii")
    if len(centers) != len(radii):
        raise InvalidModelError(
            f"must have as many rows as radii has entries, {len(radii)}", field="centers", value=centers.shape
        )
    largest = float(max(np.abs(centers).max(), radii.max()))
    if largest > FARTHEST:
        raise InvalidModelError(f"must be at most {FARTHEST:g} m", field="centers and radii", value=largest)
    worst = int(np.argmin(radii))
    if not radii[worst] > 0.0:
        raise InvalidModelError("must be positive", field=f"radii[{worst}]", value=float(radii[worst]))


def _array(field, value, shape):
    """Return a read-only, C-contiguous, finite float64 array of a shape; None in it matches any length."""
    raw = np.asarray(value)
    if raw.dtype.kind not in "fiu":
        raise InvalidModelError("must hold real numbers", field=field, value=value)
    if raw.ndim != len(shape) or any(
        want not in (None, got) for want, got in zip(shape, raw.shape, strict=True)
    ):
        wanted = ", ".join("n" if n is None else str(n) for n in shape) + "," * (len(shape) == 1)
        raise InvalidModelError(f"must have shape ({wanted})", field=field, value=raw.shape)
    array = np.array(raw, dtype=np.float64, order="C")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        where = "".join(f"[{i}]" for i in index)
        raise InvalidModelError("is not a finite number", field=field + where, value=float(array[index]))
    array.flags.writeable = False
    return array
