"""Meshes of simple shapes: boxes, sphere, capsule, cylinder and other surfaces of revolution.

A mesh is recognised if its corners are on the shape's surface within `CORNERS` of its extent, and its chords
within `CHORDS` of the largest radius; flat faces have no chords. A mesh of a round shape has corners on a
circle at least every 16 degrees then, and its edges are chords of the circle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import permutations

import numpy as np

from .pieces import Hull, Piece, box, cylinder
from .revolution import lathe_pieces
from .solid_mesh import unique_rows
from .surface_error import distances_outside

#: Distance of a mesh's corners from a shape's surface, as a share of the mesh's extent.
CORNERS = 1e-3
#: Distance of points of a mesh's edges and triangles from a round surface, as a share of the largest radius.
CHORDS = 0.01
#: Relative difference of volumes: chords within `CHORDS` cut off 1.3 % of a cylinder, 2 % of a ball.
_VOLUME = 0.03
#: Relative difference of moments of inertia across an axis: a regular polygon has none, and the tolerance of
#: corners on a bar three times as long as thick changes them by 2 %.
_MOMENTS = 0.05
#: Corners that differ by less are on one circle about the axis, as a share of the extent: six digits of text.
_SAME = 1e-5
#: Corners of a profile that is cut into pieces; a finer one is simplified.
_PROFILE = 64
#: Share of the distance that pieces may stick out that is used up by simplifying a profile.
_SHARE = 0.02
#: Distance that pieces may stick out where it is hollow, as a share of the extent, unless they are too many.
FINEST = 0.004
_CLOSE = 1.03  # ratio of the distances with few enough and with too many pieces at which a search ends
_CELLS = 20_000  # between the planes of faces, at most: a second for the search of what is inside
_SIDE = 0.05  # cosine between a normal of a side and the axis

Found = tuple[str, tuple[Piece, ...]]


def recognized(corners: np.ndarray, most: int, finest: float | None = None) -> Found | None:
    """Return the name and the pieces of the simple shape that a closed mesh has, or None.

    Parameters
    ----------
    corners : (m, 3, 3) array
        Corners of the triangles, counter-clockwise from outside [m].
    most : int
        Number of boxes, at most, and of pieces of a hollow surface of revolution, where fewer stick out more.
    finest : float, optional
        Distance by which they may stick out even if more pieces are allowed [m]; by default 0.4 % of the
        extent. Half of it is on either side of the mesh.
    """
    mesh = _Mesh(corners)
    for test in (_ball, _box):
        if (piece := test(mesh)) is not None:
            return piece
    if (boxes := _boxes(mesh, most)) is not None:
        return boxes
    for axis in mesh.axes():
        for test in (_cylinder, _capsule):
            if (piece := test(mesh, *mesh.refined(axis))) is not None:
                return piece
        if (profile := _profile(mesh, axis)) is not None:
            turn = rotation_to(axis)
            pieces = _few(profile, most, FINEST * mesh.extent if finest is None else finest)
            return "surface of revolution", tuple(piece.moved(mesh.center, turn) for piece in pieces)
    return None


class _Mesh:
    """A closed mesh and what tests of its shape need."""

    def __init__(self, corners):
        import trimesh

        self.corners = corners
        self.points = unique_rows(corners.reshape(-1, 3))[0]
        a, b, c = np.moveaxis(corners, 1, 0)
        self.middles = np.concatenate([0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a), (a + b + c) / 3.0])
        self.extent = float(np.ptp(self.points, axis=0).max())
        cross = np.cross(b - a, c - a)
        lengths = np.linalg.norm(cross, axis=1)
        self.areas = 0.5 * lengths
        self.normals = cross / np.where(lengths > 0.0, lengths, 1.0)[:, None]
        unit = corners / self.extent
        properties = trimesh.triangles.mass_properties(unit, density=1.0)
        self.volume = float(properties.volume) * self.extent**3
        self.center = np.asarray(properties.center_mass) * self.extent
        self._inertia = np.asarray(properties.inertia)

    def axes(self):
        """Yield unit vectors that may be the axis of revolution: normals of large faces, and principal axes.

        Moments of inertia across an axis of revolution are equal. Where all three are, as of some cylinders,
        only the normals are axes.
        """
        principal = np.linalg.eigh(self._inertia)[1].T
        found: list[np.ndarray] = []
        for axis in (*principal[[0, 2, 1]], *self.large_normals(3)):
            across = rotation_to(axis)[:, :2]
            moments = np.linalg.eigvalsh(across.T @ self._inertia @ across)
            if moments[0] < (1.0 - _MOMENTS) * moments[1]:
                continue
            if all(abs(axis @ other) < 1.0 - 1e-6 for other in found):
                found.append(axis)
                yield axis

    def large_normals(self, count):
        """Return the normals (count, 3) of the largest areas, each turned to its upper half-space."""
        up = np.where(self.normals[:, [2]] < -1e-9, -self.normals, self.normals)
        _, member = unique_rows(np.round(up, 4))
        areas = np.bincount(member, weights=self.areas)
        first = np.argsort(-areas, kind="stable")[:count]
        return [up[np.flatnonzero(member == k)[0]] for k in first if areas[k] > 0.0]

    def frames(self):
        """Yield rotation matrices whose columns are the normals of a box's faces, as far as there are any."""
        for first in self.large_normals(3):
            across = [n for n in self.large_normals(6) if abs(n @ first) < CORNERS]
            if across:
                second = across[0] - (across[0] @ first) * first
                second /= np.linalg.norm(second)
                yield np.column_stack([first, second, np.cross(first, second)])

    def refined(self, axis):
        """Return an axis and a point on it, fitted to the sides that are parallel to it, if there are any."""
        point = self.center
        for _ in range(2):
            side = np.abs(self.normals @ axis) < _SIDE
            if not side.any():
                return axis, point
            normals = self.normals[side] * np.sqrt(self.areas[side])[:, None]
            fitted = np.linalg.eigh(normals.T @ normals)[1][:, 0]
            if abs(fitted @ axis) < 0.9:
                return axis, point
            axis = math.copysign(1.0, float(fitted @ axis)) * fitted
            turn = rotation_to(axis)
            flat = (self.corners[side].reshape(-1, 3) - point) @ turn[:, :2]
            # the circle x^2 + y^2 = 2 a x + 2 b y + c through the corners of the sides
            system = np.column_stack([2.0 * flat, np.full(len(flat), self.extent)])
            solution = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)[0]
            point = point + turn[:, :2] @ solution[:2]
        return axis, point

    def fits(self, distance: Callable[[np.ndarray], np.ndarray], chord: float, volume: float) -> bool:
        """Return whether a surface, given by the distance of points from it, is the mesh's."""
        slack = CORNERS * self.extent
        return bool(
            abs(self.volume - volume) <= _VOLUME * volume
            and np.abs(distance(self.points)).max() <= slack
            and np.abs(distance(self.middles)).max() <= slack + chord
        )


def _ball(mesh) -> Found | None:
    system = np.column_stack([2.0 * mesh.points, np.full(len(mesh.points), mesh.extent)])
    center = np.linalg.lstsq(system, (mesh.points**2).sum(axis=1), rcond=None)[0][:3]
    radius = float(np.linalg.norm(mesh.points - center, axis=1).max())

    def distance(points):
        return np.linalg.norm(points - center, axis=1) - radius

    if not mesh.fits(distance, CHORDS * radius, 4.0 / 3.0 * math.pi * radius**3):
        return None
    return "sphere", (Hull(center[None], radius),)


def _box(mesh) -> Found | None:
    for turn in mesh.frames():
        local = mesh.points @ turn
        low, high = local.min(axis=0), local.max(axis=0)
        middle, half = turn @ (0.5 * (low + high)), 0.5 * (high - low)

        def distance(points, turn=turn, middle=middle, half=half):
            return _box_distance(np.abs((points - middle) @ turn) - half)

        if mesh.fits(distance, 0.0, 8.0 * float(half.prod())):
            return "box", (box(2.0 * half).moved(middle, turn),)
    return None


def _boxes(mesh, most) -> Found | None:
    """Return the boxes whose union is a mesh of faces along three axes, as of an L, a table or a bin.

    The planes of faces divide space into cells. Of those that are inside, each box takes as many as it can.
    """
    turn, large = next(iter(mesh.frames()), None), mesh.areas > (_SAME * mesh.extent) ** 2
    if turn is None:
        return None
    cosines = np.abs(mesh.normals[large] @ turn)
    if np.any(cosines.max(axis=1) < 1.0 - CORNERS**2):
        return None
    corners, axis = mesh.corners[large, 0] @ turn, cosines.argmax(axis=1)
    planes = [_levels(corners[axis == k, k], _SAME * mesh.extent) for k in range(3)]
    middles = [0.5 * (heights[1:] + heights[:-1]) for heights in planes]
    shape = tuple(len(heights) for heights in middles)
    if math.prod(shape) > _CELLS:
        return None
    points = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 3) @ turn.T
    inside = (distances_outside(mesh.corners, points) == 0.0).reshape(shape)
    left, pieces = inside.copy(), []
    while left.any():
        if len(pieces) == most:
            return None
        cell = np.argwhere(left)[0]
        found = [_grown(inside, cell, order) for order in permutations(range(3))]
        low, high = max(found, key=lambda ends: int(left[_cells(*ends)].sum()))
        left[_cells(low, high)] = False
        a, b = (np.array([heights[k] for heights, k in zip(planes, at, strict=True)]) for at in (low, high))
        pieces.append(box(b - a).moved(turn @ (0.5 * (a + b)), turn))
    return "boxes", tuple(pieces)


def _levels(heights, same):
    """Return the distinct ones of heights (n,), of which those closer than ``same`` are one."""
    heights = np.sort(heights)
    return np.array(
        [group.mean() for group in np.split(heights, np.flatnonzero(np.diff(heights) > same) + 1)]
    )


def _cells(low, high):
    return tuple(slice(a, b) for a, b in zip(low, high, strict=True))


def _grown(inside, cell, order):
    """Return the ends of a box of cells around a cell, that grows along one axis after the other."""
    low, high = cell.copy(), cell + 1
    for axis in order:
        for ends, step in ((low, -1), (high, 1)):
            while 0 <= ends[axis] + min(step, 0) and ends[axis] + max(step, 0) <= inside.shape[axis]:
                ends[axis] += step
                if not inside[_cells(low, high)].all():
                    ends[axis] -= step
                    break
    return low, high


def _cylinder(mesh, axis, point) -> Found | None:
    radius, height = _meridian(mesh.points, axis, point)
    largest, low, high = radius.max(), height.min(), height.max()
    half = np.array([largest, 0.5 * (high - low)])

    def distance(points):
        r, z = _meridian(points, axis, point)
        return _box_distance(np.column_stack([r, np.abs(z - 0.5 * (low + high))]) - half)

    if not mesh.fits(distance, CHORDS * largest, math.pi * largest**2 * (high - low)):
        return None
    middle = point + 0.5 * (low + high) * axis
    return "cylinder", (cylinder(float(largest), float(high - low)).moved(middle, rotation_to(axis)),)


def _capsule(mesh, axis, point) -> Found | None:
    radius, height = _meridian(mesh.points, axis, point)
    largest = float(radius.max())
    low, high = float(height.min()) + largest, float(height.max()) - largest
    if high - low <= CORNERS * mesh.extent:
        return None

    def distance(points):
        r, z = _meridian(points, axis, point)
        return np.hypot(r, z - np.clip(z, low, high)) - largest

    volume = math.pi * largest**2 * (high - low + 4.0 / 3.0 * largest)
    if not mesh.fits(distance, CHORDS * largest, volume):
        return None
    return "capsule", (Hull(point + np.outer([low, high], axis), largest),)


def _box_distance(beyond):
    """Return signed distances from a box, from how far points are beyond its sides, (n, 2) or (n, 3)."""
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return outside + np.minimum(beyond.max(axis=1), 0.0)


def _meridian(points, axis, point):
    """Return distances from an axis, and heights along it, of points (n, 3)."""
    arm = points - point
    height = arm @ axis
    return np.linalg.norm(arm - np.outer(height, axis), axis=1), height


def rotation_to(axis):
    """Return a rotation matrix whose third column is a unit vector."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first), axis])


def _profile(mesh, axis):
    """Return the profile (k, 2) of a mesh whose triangles join circles about an axis, or None.

    The axis passes through the centre of mass, which is at height 0.
    """
    corners = mesh.corners.reshape(-1, 3)
    turn = rotation_to(axis)
    local = (corners - mesh.center) @ turn
    radius, height = np.hypot(local[:, 0], local[:, 1]), local[:, 2]
    same = _SAME * mesh.extent
    circle, label = _circles(np.column_stack([radius, height]), same)
    if len(circle) > 0.2 * len(mesh.points) + 4 or circle[:, 0].max() <= same:
        return None
    circle[circle[:, 0] <= same, 0] = 0.0
    triangles = np.sort(label.reshape(-1, 3), axis=1)
    if np.any((triangles[:, 0] < triangles[:, 1]) & (triangles[:, 1] < triangles[:, 2])):
        return None  # a triangle over three circles is on no cone
    chord = CHORDS * circle[:, 0].max()
    if not _are_dense(label, np.arctan2(local[:, 1], local[:, 0]), circle, chord):
        return None
    edges, _ = unique_rows(triangles[:, [0, 2]][triangles[:, 0] < triangles[:, 2]])
    order = _traced(edges, len(circle))
    if order is None:
        return None
    profile = circle[order]
    if (order[0], order[-1]) not in {tuple(edge) for edge in edges} | {tuple(edge[::-1]) for edge in edges}:
        # a path: its ends are on the axis, or flat ends close it
        closed = [profile]
        for end, place in ((profile[0], 0), (profile[-1], len(closed))):
            if end[0] > 0.0:
                closed.insert(len(closed) if place else 0, np.array([[0.0, end[1]]]))
        profile = np.concatenate(closed)
    volume = _turned_volume(profile)
    return profile if abs(volume - mesh.volume) <= _VOLUME * volume else None


def _circles(points, same):
    """Return the distinct ones of points (n, 2) that differ by more than ``same``, and the number of each."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    cells, member = unique_rows(np.round(points / same))
    near = KDTree(cells).query_pairs(1.5, output_type="ndarray")
    graph = coo_array((np.ones(len(near), np.int8), (near[:, 0], near[:, 1])), shape=(len(cells),) * 2)
    label = connected_components(graph, directed=False)[1][member]
    counts = np.bincount(label)
    return np.column_stack([np.bincount(label, weights=axis) / counts for axis in points.T]), label


def _are_dense(label, angle, circle, chord):
    """Return whether the chords between neighbouring corners on each circle are within a distance of it."""
    order = np.lexsort((angle, label))
    label, angle = label[order], angle[order]
    first = np.flatnonzero(np.diff(label, prepend=-1))
    last = np.append(first[1:], len(label)) - 1
    gaps = np.diff(angle, append=0.0)
    gaps[last] = angle[first] + 2.0 * np.pi - angle[last]
    return bool(np.all(circle[label, 0] * (1.0 - np.cos(0.5 * np.minimum(gaps, 2.0 * np.pi))) <= chord))


def _traced(edges, count):
    """Return the circles (k,) along a path or a loop that joins all of them, or None."""
    near: list[list[int]] = [[] for _ in range(count)]
    for a, b in edges.tolist():
        near[a].append(b)
        near[b].append(a)
    degrees = np.array([len(some) for some in near])
    ends = np.flatnonzero(degrees == 1)
    if degrees.min() < 1 or degrees.max() > 2 or len(ends) not in (0, 2):
        return None
    order = [int(ends[0]) if len(ends) else 0]
    before = -1
    while True:
        following = [k for k in near[order[-1]] if k != before]
        if not following or following[0] == order[0]:
            break
        before = order[-1]
        order.append(following[0])
    return np.array(order) if len(order) == count else None


def _turned_volume(profile):
    """Return the volume of a profile's turn (Pappus and Guldin)."""
    r, z = profile.T
    s, w = np.roll(r, -1), np.roll(z, -1)
    return abs(float(np.sum((r * r + r * s + s * s) * (w - z)))) * math.pi / 3.0


def _few(profile, most, finest) -> Sequence[Piece]:
    """Return at most so many pieces of a profile's turn, that stick out as little as possible.

    Their number falls with the distance that they stick out, or with its square root.
    """
    low, pieces = finest, _cut(profile, finest)
    high, step = low, len(pieces) / most
    while len(pieces) > most and high < float(np.ptp(profile, axis=0).max()):
        high *= max(step, 1.5)
        pieces = _cut(profile, high)
        if len(pieces) > most:
            low = high
    while high > _CLOSE * low:
        middle = math.sqrt(low * high)
        found = _cut(profile, middle)
        if len(found) <= most:
            high, pieces = middle, found
        else:
            low = middle
    return pieces


def _cut(profile, hollow):
    return lathe_pieces(_simplified(profile, _SHARE * hollow), (1.0 - 2.0 * _SHARE) * hollow)


def _simplified(profile, tolerance):
    """Return at most `_PROFILE` corners of a profile, those that are farthest from chords of the others.

    The rest is within a tolerance [m] of these chords, if so many are enough.
    """
    kept = {0, int(np.linalg.norm(profile - profile[0], axis=1).argmax())}
    while len(kept) < min(_PROFILE, len(profile)):
        ends = sorted(kept)
        worst, at = tolerance, -1
        for a, b in zip(ends, [*ends[1:], ends[0] + len(profile)], strict=True):
            between = np.arange(a + 1, b) % len(profile)
            if len(between) == 0:
                continue
            start, along = profile[a], profile[b % len(profile)] - profile[a]
            arm = profile[between] - start
            share = np.clip(arm @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
            away = np.linalg.norm(arm - share[:, None] * along, axis=1)
            if away.max() > worst:
                worst, at = float(away.max()), int(between[away.argmax()])
        if at < 0:
            break
        kept.add(at)
    return profile[sorted(kept)]
