"""Convex pieces: what a body consists of, in its own frame.

A piece is a convex core swept by a ball: the hull of points, a body of revolution (lathe) or a sector of one,
or a half-space.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..checks.array_field import Array, array_field
from ..checks.errors import InvalidModelError
from ..checks.validation import FARTHEST, array, non_negative, numbers
from .columns import (
    AXES,
    AZIMUTH,
    CENTER,
    CORNERS_FROM,
    CORNERS_TO,
    COS_HALF,
    FIRST_ARC,
    FIRST_FACE,
    FIRST_POINT,
    HALF_EXTENT,
    HALF_SPACE,
    HULL,
    KIND,
    LAST_ARC,
    LAST_FACE,
    LAST_POINT,
    LATHE,
    MOST_CORNERS,
    ORIGIN,
    OWNER,
    PIECE,
    RADIUS,
    ROUNDING,
    ROW,
    SIN_HALF,
)

#: Normals of triangles that differ less (1 - cosine), and distances from the plane that differ less (share of
#: the size), belong to one face: round-off of points given in single precision.
_COPLANAR = 1e-10, 1e-7
#: Share of the size by which points may be above a face: what `_COPLANAR` lets through over a wide face.
_FLAT = 1e-5
#: Share of the size by which a profile may be concave: round-off of points given in single precision.
_CONVEX = 1e-7
_WHOLE = math.pi * (1.0 - 1e-12)


@dataclass(frozen=True, eq=False)
class Hull:
    """Convex hull of points, swept by a ball.

    One point makes a ball, two make a capsule, eight a box.

    Attributes
    ----------
    points : (n, 3) array
        Body axes [m]. Points inside the hull are dropped.
    rounding : float
        Radius of the ball that sweeps the hull [m].
    faces : tuple of (k,) int64 arrays, optional
        Corners of each flat face as indices of ``points``, counter-clockwise from outside. None for fewer
        than four points. By default they are computed, which needs SciPy.
    normals : (f, 3) array
        Outward normals of the faces.

    Raises
    ------
    InvalidModelError
        If points are not finite or lie in a plane, there are none, rounding is negative or missing where one
        or two points need it, or the faces are not those of the convex hull.
    """

    points: Array = array_field()
    rounding: float = 0.0
    faces: tuple[np.ndarray, ...] = ()
    normals: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        points = numbers(self.points, "points", InvalidModelError)
        points = array(points, (len(points) if points.ndim else 0, 3), "points", InvalidModelError)
        rounding = non_negative(self.rounding, "rounding", InvalidModelError)
        if not len(points):
            raise InvalidModelError("must have at least one point", field="points")
        if max(np.abs(points).max(), rounding) > FARTHEST:
            raise InvalidModelError(f"must be within {FARTHEST:g} m of the origin", field="points")
        if len(points) < 3 and rounding == 0.0:
            raise InvalidModelError(
                "must be positive for one or two points", field="rounding", value=rounding
            )
        faces = self.faces
        if len(points) > 2 and not len(faces):
            points, faces = _hull(points)
        faces = tuple(np.array(face, np.int64) for face in faces)
        normals = _checked_normals(points, faces) if faces else np.zeros((0, 3))
        stored = {"points": points, "rounding": rounding, "faces": faces, "normals": normals}
        for name, value in stored.items():
            object.__setattr__(self, name, value)
        for value in (points, normals, *faces):
            value.flags.writeable = False

    def moved(self, position: ArrayLike, rotation: ArrayLike) -> Hull:
        """Return the piece rotated by a matrix (3, 3) and then shifted [m]."""
        points = self.points @ np.asarray(rotation, float).T + np.asarray(position, float)
        return Hull(points, self.rounding, self.faces)

    def scaled(self, s: float) -> Hull:
        """Return the piece with all lengths multiplied by ``s``."""
        return Hull(self.points * s, self.rounding * s, self.faces)

    def outline(self) -> np.ndarray:
        """Return points (n, 3) whose hull, swept by the ball, is the piece or contains it."""
        return self.points


@dataclass(frozen=True, eq=False)
class Lathe:
    """Convex profile turned about an axis, whole or as a sector, swept by a ball.

    A sector is the hull of the profile's arcs: its surfaces are round outside and flat towards the axis.

    Attributes
    ----------
    profile : (k, 2) array
        Radius and height of the profile's corners [m], counter-clockwise with the radius to the right.
    rounding : float
        Radius of the ball that sweeps the core [m].
    origin : (3,) array
        Point of the axis at height 0, body axes [m].
    axes : (3, 3) array
        Axes of the lathe as columns, body axes. The third one is the axis of revolution.
    azimuth, half_angle : float
        Middle of the sector about the third axis, from the first one, and half of its angle [rad]; pi is a
        whole turn, and at most pi / 2 is a sector.
    arcs : (k, 2, 4) array
        Parts of the profile of a hollow surface that flat sides of the piece stand for: radius and height of
        both ends [m], and radial and axial part of the outward normals there. Gaps and normals of contacts
        are those of the arcs' turn.

    Raises
    ------
    InvalidModelError
        If numbers are not finite, a radius is negative, the profile is not convex, the axes are no rotation,
        or the angle is not in its range.
    """

    profile: Array = array_field()
    rounding: float = 0.0
    origin: Array = array_field((0.0, 0.0, 0.0))
    axes: Array = array_field(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    azimuth: float = 0.0
    half_angle: float = math.pi
    arcs: Array = array_field(())

    def __post_init__(self):
        profile = numbers(self.profile, "profile", InvalidModelError)
        profile = array(profile, (len(profile) if profile.ndim else 0, 2), "profile", InvalidModelError)
        rounding = non_negative(self.rounding, "rounding", InvalidModelError)
        origin = array(self.origin, (3,), "origin", InvalidModelError)
        axes = array(self.axes, (3, 3), "axes", InvalidModelError)
        azimuth = float(array(self.azimuth, (), "azimuth", InvalidModelError))
        half = float(array(self.half_angle, (), "half_angle", InvalidModelError))
        if np.abs(axes.T @ axes - np.eye(3)).max() > 1e-9 or np.linalg.det(axes) < 0.0:
            raise InvalidModelError("must be a rotation matrix", field="axes", value=axes.tolist())
        if not (0.0 < half <= 0.5 * math.pi or _WHOLE <= half <= math.pi * (1.0 + 1e-12)):
            raise InvalidModelError(
                "must be pi for a whole turn, or at most pi / 2 for a sector", field="half_angle", value=half
            )
        if len(profile) < 2 or not np.ptp(profile, axis=0).any():
            raise InvalidModelError("must have at least two different corners", field="profile")
        if not profile[:, 0].max() > 0.0:
            raise InvalidModelError(
                "must leave the axis; two points make a capsule as a Hull", field="profile"
            )
        if profile[:, 0].min() < 0.0:
            raise InvalidModelError(
                "must have no negative radius", field="profile", value=profile[:, 0].min()
            )
        if half >= _WHOLE and profile[:, 0].min() > 0.0:  # the hull of a whole turn is closed at its ends
            profile = _closed(_convex_profile(profile, "profile"))
        profile = _convex_profile(profile, "profile")
        stored = {"profile": profile, "rounding": rounding, "origin": origin, "axes": axes}
        stored |= {"azimuth": azimuth, "half_angle": min(half, math.pi), "arcs": _checked_arcs(self.arcs)}
        for name, value in stored.items():
            object.__setattr__(self, name, value)
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @property
    def whole(self) -> bool:
        """Whether the profile makes a whole turn."""
        return self.half_angle >= _WHOLE

    def moved(self, position: ArrayLike, rotation: ArrayLike) -> Lathe:
        """Return the piece rotated by a matrix (3, 3) and then shifted [m]."""
        rotation = np.asarray(rotation, float)
        return replace(
            self, origin=rotation @ self.origin + np.asarray(position, float), axes=rotation @ self.axes
        )

    def scaled(self, s: float) -> Lathe:
        """Return the piece with all lengths multiplied by ``s``."""
        lengths = {"profile": self.profile * s, "rounding": self.rounding * s, "origin": self.origin * s}
        return replace(self, **lengths, arcs=self.arcs * [s, s, 1.0, 1.0])

    def outline(self) -> np.ndarray:
        """Return points (n, 3) whose hull, swept by the ball, contains the piece."""
        count = 32 if self.whole else 8
        step = 2.0 * self.half_angle / count
        # tangents of the arcs meet outside the circle, so that the polygon contains it
        angles = self.azimuth - self.half_angle + step * (np.arange(count) + 0.5)
        far = self.profile[:, 0] / math.cos(0.5 * step)
        local = [np.column_stack([far * math.cos(a), far * math.sin(a), self.profile[:, 1]]) for a in angles]
        if not self.whole:
            ends = (self.azimuth - self.half_angle, self.azimuth + self.half_angle)
            r = self.profile[:, 0]
            local += [np.column_stack([r * math.cos(a), r * math.sin(a), self.profile[:, 1]]) for a in ends]
        return np.concatenate(local) @ self.axes.T + self.origin


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """Half-space below a plane, for fixed bodies only.

    Attributes
    ----------
    point : (3,) array
        Point of the plane, body axes [m].
    normal : (3,) array
        Outward normal, body axes; it is normalized.

    Raises
    ------
    InvalidModelError
        If numbers are not finite, or the normal is zero.
    """

    point: Array = array_field((0.0, 0.0, 0.0))
    normal: Array = array_field((0.0, 0.0, 1.0))

    def __post_init__(self):
        point = array(self.point, (3,), "point", InvalidModelError)
        normal = array(self.normal, (3,), "normal", InvalidModelError)
        length = float(np.linalg.norm(normal))
        if not length > 0.0:
            raise InvalidModelError("must not be zero", field="normal", value=normal.tolist())
        for name, value in (("point", point), ("normal", normal / length)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    def moved(self, position: ArrayLike, rotation: ArrayLike) -> HalfSpace:
        """Return the piece rotated by a matrix (3, 3) and then shifted [m]."""
        rotation = np.asarray(rotation, float)
        return HalfSpace(rotation @ self.point + np.asarray(position, float), rotation @ self.normal)

    def scaled(self, s: float) -> HalfSpace:
        """Return the piece with all lengths multiplied by ``s``."""
        return HalfSpace(self.point * s, self.normal)


Piece = Hull | Lathe | HalfSpace


#: Faces of a box whose corners are numbered by the bits x, y, z.
_BOX_FACES = tuple(
    np.array(face)
    for face in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
)


def ball(radius: float, position: ArrayLike = (0.0, 0.0, 0.0)) -> Hull:
    """Return a ball of a radius [m] about a point (3,)."""
    return Hull(np.asarray(position, float).reshape(1, 3), radius)


def capsule(radius: float, length: float) -> Hull:
    """Return a capsule along z; ``length`` is that of its straight part [m]."""
    return Hull([[0.0, 0.0, -0.5 * length], [0.0, 0.0, 0.5 * length]], radius)


def box(size: ArrayLike, position: ArrayLike = (0.0, 0.0, 0.0), rounding: float = 0.0) -> Hull:
    """Return a box with edges ``size`` (3,) along the axes, swept by a ball of radius ``rounding`` [m]."""
    signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return Hull(signs * np.asarray(size, float) + np.asarray(position, float), rounding, _BOX_FACES)


def cylinder(radius: float, length: float) -> Lathe:
    """Return a cylinder along z about the origin [m]."""
    return frustum(radius, radius, length)


def frustum(bottom: float, top: float, length: float) -> Lathe:
    """Return a cone or frustum along z about the origin, with its radii at the bottom and the top [m]."""
    h = 0.5 * length
    return Lathe([[0.0, -h], [bottom, -h], [top, h], [0.0, h]])


def _checked_arcs(arcs):
    arcs = numbers(arcs, "arcs", InvalidModelError)
    arcs = array(
        arcs, (len(arcs) if arcs.ndim else 0, 2, 4) if arcs.size else arcs.shape, "arcs", InvalidModelError
    )
    arcs = arcs.reshape(-1, 2, 4)
    if np.any(np.abs(np.linalg.norm(arcs[:, :, 2:], axis=2) - 1.0) > 1e-6):
        raise InvalidModelError("must have normals of length 1", field="arcs")
    return arcs


def _hull(points):
    """Return the corners of a convex hull, and its faces as loops of corners."""
    from scipy.spatial import ConvexHull, QhullError

    size = float(np.ptp(points, axis=0).max())
    try:
        triangles = ConvexHull(points)
    except QhullError:
        raise InvalidModelError(
            "must not lie in a plane; give one point, two, or a solid's corners",
            field="points",
            value=len(points),
        ) from None
    known, members = np.empty((0, 4)), []
    for corners, plane in zip(triangles.simplices, triangles.equations, strict=True):
        same = known[:, :3] @ plane[:3] > 1.0 - _COPLANAR[0]
        same &= np.abs(known[:, 3] - plane[3]) < _COPLANAR[1] * size
        if same.any():
            members[int(same.argmax())].update(corners)
        else:
            known = np.concatenate([known, plane[None]])
            members.append(set(corners))
    used = np.sort(triangles.vertices)
    place = {int(v): k for k, v in enumerate(used)}
    faces = []
    for plane, group in zip(known, members, strict=True):
        numbers = np.array(sorted(group))
        arm = points[numbers] - points[numbers].mean(axis=0)
        u = arm[0] / np.linalg.norm(arm[0])
        order = np.argsort(np.arctan2(arm @ np.cross(plane[:3], u), arm @ u))
        faces.append([place[int(v)] for v in numbers[order]])
    return np.ascontiguousarray(points[used]), faces


def _checked_normals(points, faces):
    """Return the normals (f, 3) of a hull's faces; raise unless they bound the convex hull of the points."""
    for k, face in enumerate(faces):
        if face.ndim != 1 or len(face) < 3 or face.min() < 0 or face.max() >= len(points):
            raise InvalidModelError(
                f"must be at least three indices of the {len(points)} points",
                field=f"faces[{k}]",
                value=face.tolist(),
            )
    starts = np.concatenate(faces)
    ends = np.concatenate([np.roll(face, -1) for face in faces])
    count = len(points)
    edges, back = starts * count + ends, ends * count + starts
    if len(np.unique(edges)) < len(edges) or not np.array_equal(np.sort(edges), np.sort(back)):
        raise InvalidModelError(
            "must meet in pairs at each edge, counter-clockwise from outside", field="faces"
        )
    if len(np.unique(starts)) < count or count - len(edges) // 2 + len(faces) != 2:
        raise InvalidModelError("must have each point as a corner, in one closed surface", field="faces")
    middle = points.mean(axis=0)
    arms = points[starts] - middle
    of_face = np.repeat(np.arange(len(faces)), [len(face) for face in faces])
    areas = np.zeros((len(faces), 3))  # twice, by Newell's formula
    np.add.at(areas, of_face, np.cross(arms, points[ends] - middle))
    lengths = np.linalg.norm(areas, axis=1)
    if not lengths.min() > 0.0:
        raise InvalidModelError("must have an area", field=f"faces[{int(lengths.argmin())}]")
    normals = areas / lengths[:, None]
    heights = (points - middle) @ normals.T
    planes = np.array([heights[face, k].mean() for k, face in enumerate(faces)])
    above = (heights - planes).max()
    if above > _FLAT * float(np.ptp(points, axis=0).max()):
        raise InvalidModelError(
            f"must bound the convex hull of the points; one is {above:.3g} m outside", field="faces"
        )
    return normals


def convex_outline(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull of points (n, 2), counter-clockwise (Andrew's monotone chain)."""
    ordered = [(float(x), float(y)) for x, y in points[np.lexsort(points.T[::-1])]]
    chains = []
    for direction in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for x, y in direction:
            while len(chain) > 1:
                (a, b), (c, d) = chain[-2:]
                if (c - a) * (y - b) - (d - b) * (x - a) > 0.0:
                    break
                chain.pop()
            chain.append((x, y))
        chains += chain[:-1]
    return np.array(chains)


def polygon_area(points: np.ndarray) -> float:
    """Return the area of a polygon (n, 2), below zero if it is clockwise."""
    x, y = points.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _closed(profile):
    """Return a profile of a whole turn with the ends of its axis, without corners that face the axis."""
    low, high = profile[:, 1].min(), profile[:, 1].max()
    if low == high:
        return np.array([[0.0, low], [profile[:, 0].max(), low]])
    return convex_outline(np.concatenate([[[0.0, low], [0.0, high]], profile]))


def _convex_profile(profile, field):
    """Return a convex profile counter-clockwise, without corners on edges; raise if not convex."""
    size = float(np.ptp(profile, axis=0).max())
    apart = np.hypot(*(profile - np.roll(profile, 1, axis=0)).T) > _CONVEX * size
    profile = profile[apart]  # without corners given twice
    if len(profile) <= 2:
        return profile
    if polygon_area(profile) < 0.0:
        profile = profile[::-1]
    a, b = profile - np.roll(profile, 1, axis=0), np.roll(profile, -1, axis=0) - profile
    turns = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / np.maximum(np.hypot(*(a + b).T), 1e-300)  # heights [m]
    if turns.min() < -_CONVEX * size:
        corner = profile[turns.argmin()]
        raise InvalidModelError(
            "must be convex; cut it into convex parts", field=field, value=corner.tolist()
        )
    kept = profile[turns > 1e-3 * _CONVEX * size]
    return np.ascontiguousarray(
        kept if len(kept) > 2 else profile[[profile[:, 0].argmin(), profile[:, 0].argmax()]]
    )


class Balls(Sequence[Piece]):
    """Balls as pieces, each made when it is asked for: the shape of a model that has only spheres."""

    def __init__(self, centers: np.ndarray, radii: np.ndarray):
        self._centers, self._radii = centers, radii

    def __len__(self):
        return len(self._radii)

    def __getitem__(self, k):
        if isinstance(k, slice):
            return Balls(self._centers[k], self._radii[k])
        return ball(float(self._radii[k]), self._centers[k])

    def farthest(self, directions: np.ndarray) -> np.ndarray:
        """Return `farthest` of the balls."""
        return (directions @ self._centers.T + self._radii).max(axis=1)


def farthest(pieces: Sequence[Piece], directions: np.ndarray) -> np.ndarray:
    """Return how far bounded pieces reach along unit vectors (n, 3) from the body's origin, (n,) [m]."""
    if isinstance(pieces, Balls):
        return pieces.farthest(directions)
    return np.max([_reach(piece, directions) for piece in pieces], axis=0)


def box_about(pieces: Sequence[Piece]) -> np.ndarray:
    """Return the corners (2, 3) of the box about bounded pieces along the body axes [m]."""
    reach = farthest(pieces, np.concatenate([np.eye(3), -np.eye(3)]))
    return np.stack([-reach[3:], reach[:3]])


def _reach(piece, directions):
    if isinstance(piece, Hull):
        return (directions @ piece.points.T).max(axis=1) + piece.rounding
    local = directions @ piece.axes
    across = np.hypot(local[:, 0], local[:, 1])
    if not piece.whole:  # the arc's nearest point to the direction
        off = np.arctan2(local[:, 1], local[:, 0]) - piece.azimuth
        off = np.abs(np.mod(off + np.pi, 2.0 * np.pi) - np.pi)
        across *= np.cos(np.maximum(off - piece.half_angle, 0.0))
    corners = np.outer(across, piece.profile[:, 0]) + np.outer(local[:, 2], piece.profile[:, 1])
    return directions @ piece.origin + corners.max(axis=1) + piece.rounding


class PieceArrays(NamedTuple):
    """Pieces of several bodies as arrays for kernels (`columns`).

    Attributes
    ----------
    pieces : (n, PIECE) array
    rows : (m, ROW) array
        Points and faces.
    first : (B + 1,) int64 array
        Rows of ``pieces`` at which each body's pieces begin, and their number.
    """

    pieces: np.ndarray
    rows: np.ndarray
    first: np.ndarray


def piece_arrays(bodies: Sequence[Sequence[Piece]]) -> PieceArrays:
    """Return the pieces of bodies as arrays."""
    pieces: list[np.ndarray] = []
    rows: list[list[float]] = []

    def add(new):
        rows.extend([*map(float, row), *[0.0] * (ROW - len(row))] for row in new)
        return len(rows) - len(new), len(rows)

    first = [0]
    for k, body in enumerate(bodies):
        for piece in body:
            row = np.zeros(PIECE)
            row[OWNER], row[COS_HALF] = k, -2.0
            points, faces = _FILL[type(piece)](row, piece)
            row[FIRST_POINT], row[LAST_POINT] = add(points)
            ranges = [add(corners) for _, corners in faces]
            row[FIRST_FACE], row[LAST_FACE] = add(
                [(*normal, *between) for (normal, _), between in zip(faces, ranges, strict=True)]
            )
            row[FIRST_ARC], row[LAST_ARC] = add(piece.arcs.reshape(-1, 4) if isinstance(piece, Lathe) else ())
            pieces.append(row)
        first.append(len(pieces))
    return PieceArrays(
        np.array(pieces).reshape(-1, PIECE), np.array(rows).reshape(-1, ROW), np.array(first, np.int64)
    )


def joined(bodies: Sequence[PieceArrays]) -> PieceArrays:
    """Return the arrays of several sets of bodies as one."""
    pieces, rows, first = [], [], [0]
    points = owners = 0
    for body in bodies:
        pieces.append(body.pieces.copy())
        rows.append(body.rows.copy())
        pieces[-1][:, OWNER] += owners
        pieces[-1][:, FIRST_POINT : LAST_ARC + 1] += points
        is_face = rows[-1][:, CORNERS_TO] > 0.0
        rows[-1][is_face, CORNERS_FROM : CORNERS_TO + 1] += points
        points += len(body.rows)
        owners += len(body.first) - 1
        start = first[-1]
        first += [int(k) + start for k in body.first[1:]]
    return PieceArrays(np.concatenate(pieces), np.concatenate(rows), np.array(first, np.int64))


def _bound(row, points, rounding):
    """Fill the bounding sphere and box of points (n, 3) swept by a ball."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high)
    row[CENTER : CENTER + 3] = middle
    row[RADIUS] = np.linalg.norm(points - middle, axis=1).max() + rounding
    row[HALF_EXTENT : HALF_EXTENT + 3] = 0.5 * (high - low) + rounding


def _fill_hull(row, hull):
    row[KIND], row[ROUNDING] = HULL, hull.rounding
    _bound(row, hull.points, hull.rounding)
    return hull.points, [
        (normal, hull.points[_decimated(face)]) for normal, face in zip(hull.normals, hull.faces, strict=True)
    ]


def _decimated(face):
    """Return at most `MOST_CORNERS` corners of a face, evenly chosen."""
    if len(face) <= MOST_CORNERS:
        return face
    return face[np.linspace(0, len(face), MOST_CORNERS, endpoint=False).astype(int)]


def _fill_lathe(row, lathe):
    row[KIND], row[ROUNDING] = LATHE, lathe.rounding
    row[ORIGIN : ORIGIN + 3], row[AXES : AXES + 9] = lathe.origin, lathe.axes.ravel()
    row[AZIMUTH], row[AZIMUTH + 1] = math.cos(lathe.azimuth), math.sin(lathe.azimuth)
    if not lathe.whole:
        row[COS_HALF], row[SIN_HALF] = math.cos(lathe.half_angle), math.sin(lathe.half_angle)
    _bound(row, lathe.outline(), lathe.rounding)
    profile = lathe.profile
    points = np.column_stack([profile[:, 0], np.zeros(len(profile)), profile[:, 1]])
    faces = []
    for k in range(len(profile)):  # a disc has a face on each side
        p, q = profile[k], profile[(k + 1) % len(profile)]
        if lathe.whole and max(p[0], q[0]) < 1e-12:
            continue  # on the axis
        along = (q - p) / np.linalg.norm(q - p)
        faces.append(((along[1], 0.0, -along[0]), points[[k, (k + 1) % len(profile)]]))
    return points, faces


def _fill_half_space(row, plane):
    row[KIND] = HALF_SPACE
    row[CENTER : CENTER + 3] = plane.point
    row[RADIUS] = row[HALF_EXTENT] = row[HALF_EXTENT + 1] = row[HALF_EXTENT + 2] = np.inf
    return [plane.point], [(plane.normal, np.array([plane.point]))]


_FILL = {Hull: _fill_hull, Lathe: _fill_lathe, HalfSpace: _fill_half_space}
